"""Schedules for what a filter knows along the way: their cost, and bounds that hold for every schedule."""
