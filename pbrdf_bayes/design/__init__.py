"""Which measurement next: expected information of candidates, for each and for each minute."""
