"""Formulas as text: their grammar, their units, what CasADi makes of them."""
