"""From a log to an answer: what could be seen on a drive, how well, how well a filter did, and what mattered when."""
