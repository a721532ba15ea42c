"""What is inferred: names, symbols, units, meanings, priors."""
