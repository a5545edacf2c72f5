"""Criteria: one number that says how good an information matrix is."""
