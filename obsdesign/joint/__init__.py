"""A path and a sensor schedule chosen together."""
