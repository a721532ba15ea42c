"""Bayesian inference of the four-parameter polarised BRDF model."""

__version__ = "0.1.0"
