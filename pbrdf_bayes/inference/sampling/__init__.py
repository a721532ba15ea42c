"""Draws of the posterior: ensembles, moves, proposals, importance weights."""
