"""Many studies of one scenario whose keys are varied."""
