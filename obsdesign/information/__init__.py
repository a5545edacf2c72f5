"""How much the samples along a path say about the state."""
