"""Many paint samples: what is to be done, who does it, and the index of what came out."""
