"""A scenario that only asks what its sensors can see: what the question does without need not be said."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_TIME = {"duration": 1.0, "step": 1.0, "segment": 1.0}  # s


def with_analysis_defaults(data: dict[str, Any]) -> dict[str, Any]:
    """Return the TOML data with a title, question, start, prior and time where there are none; of an empty start nothing is asked."""
    time = data.get("time", {})
    defaults = {"title": "A system", "question": "What can its sensors see?", "start": {}, "prior": {}}
    return defaults | data | ({"time": _TIME | dict(time)} if isinstance(time, Mapping) else {})
