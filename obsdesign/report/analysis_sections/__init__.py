"""Sections of the page of verdicts: one file each, which answers one question."""
