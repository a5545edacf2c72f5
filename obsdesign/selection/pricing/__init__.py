"""The schedules that keep every rule, and the best of them for given prices."""
