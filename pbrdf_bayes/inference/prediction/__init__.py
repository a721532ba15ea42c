"""What a posterior says of readings: bands, residuals, discrepancy, hold-outs."""
