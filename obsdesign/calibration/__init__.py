"""From a log to the noises, biases and scales that explain it."""
