"""Readings checked against themselves, before any model."""
