"""What files hold: typed records, from which their JSON schemas are made."""
