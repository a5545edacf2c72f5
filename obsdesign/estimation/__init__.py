"""Filters that check the promise."""
