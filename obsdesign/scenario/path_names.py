"""What a study calls its paths."""

from __future__ import annotations

STRAIGHT, SHORTEST, WEAVE, DESIGNED = "straight", "shortest", "weave", "designed"
"""Its own: one that flies straight on, one straight to where it has to be, one that weaves, and the designed one."""
GIVEN = "given"
"""One that was read from a file."""
