"""Sections of the page of a replayed log: one file for each question."""
