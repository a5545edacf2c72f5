"""Recorded runs: what a log holds, and a reader for each format."""
