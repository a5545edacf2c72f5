"""Sensors: what is measured, how well, how often."""
