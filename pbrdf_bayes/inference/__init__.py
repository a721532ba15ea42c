"""From a measurement to a posterior and what it says; knows no plotting, pandas or paths."""
