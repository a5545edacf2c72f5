"""What a mission imposes on a path."""
