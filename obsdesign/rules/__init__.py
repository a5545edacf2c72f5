"""What a schedule of sensors must keep to: one file each."""
