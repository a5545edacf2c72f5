"""The command line: the only place that prints and exits. `table.py` lists the verbs, `verbs/` has a file for each."""

from obsdesign.cli.command import main

__all__ = ["main"]
