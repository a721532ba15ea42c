"""Simulated studies: are the uncertainties what they say? Run by ``make validate``."""
