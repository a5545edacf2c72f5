"""From the relaxation to one schedule with a proof."""
