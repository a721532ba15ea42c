"""The model for direct use, in degrees: BRDF, DHR, effects, polarimetry, simulation."""
