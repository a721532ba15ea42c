"""Optima of the posterior and of least squares, and the Laplace approximation at them."""
