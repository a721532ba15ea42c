"""The likelihood of the readings: rows, groups, filters, and their slopes."""
