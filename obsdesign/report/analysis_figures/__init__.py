"""Figures of verdicts: one file each, which returns its picture with its caption to the page."""
