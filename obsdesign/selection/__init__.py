"""Which sensors need to be on, when."""
