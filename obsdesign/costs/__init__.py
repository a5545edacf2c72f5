"""Costs of a path, for a price or a budget."""
