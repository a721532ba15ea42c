"""Conformity with tolerance limits."""
