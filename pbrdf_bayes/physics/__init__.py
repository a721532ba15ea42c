"""The four-parameter polarised BRDF model: numpy and numba; knows no data, priors or files."""
