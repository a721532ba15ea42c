"""What accuracy costs in time on this machine: measured, tabulated, drawn."""
