"""Sequential quadratic programming with matrix inequalities; knows nothing of paths or sensors."""
