"""The nonlinear program of a design: parameters to inputs, path, information and margins, with derivatives."""
