"""Files in and out: tidy CSV, configuration, run folder. The only place with paths."""
