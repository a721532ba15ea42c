"""The verbs of the command line: their arguments, and the workflow called; no science."""
