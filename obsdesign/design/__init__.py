"""Shaping a path so that the sensors see the state well."""
