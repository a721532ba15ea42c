"""Verdicts on a run: what each compares, with which limit, and what follows."""
