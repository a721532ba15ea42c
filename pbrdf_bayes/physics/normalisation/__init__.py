"""Normalisation integrals of the surface lobe over the unit disk."""
