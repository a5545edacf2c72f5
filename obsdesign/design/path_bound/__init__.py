"""A proven bound on every path: relaxation, multipliers, and the check that needs no solver."""
