"""Which effects the readings call for."""
