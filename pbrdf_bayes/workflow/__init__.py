"""The stages from a file to a report, a prediction, a verdict or a plan; knows all other parts."""
