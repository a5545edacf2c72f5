"""Planning in flight: the same problem again from where the vehicle is, and a filter in the loop."""
