"""Figures of a replayed log: one file each, which returns its picture with its caption to the page."""
