"""Vehicles: how the state moves."""
