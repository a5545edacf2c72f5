"""What is timed and counted, with the tables that came out: `make bench`."""
