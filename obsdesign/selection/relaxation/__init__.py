"""The relaxation of a selection problem: bounds, and mixtures of schedules that reach them."""
