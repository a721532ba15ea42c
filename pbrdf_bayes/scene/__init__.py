"""What a scene needs of the model: BRDF, DHR and Stokes components."""
