"""The JSON Schema of what a scenario for a log need not say."""

from __future__ import annotations

from typing import Any

from obsdesign.scenario.log_defaults import OF_LANDMARKS

_Json = dict[str, Any]
_BY_THE_LOG = ("title", "question", "start", "time")  # keys that a log does without
_TIMES = ("duration", "step", "segment")
_OF_A_BEACON: _Json = {"if": {"properties": {"kind": {"enum": list(OF_LANDMARKS)}}, "required": ["kind"]}, "then": {"required": ["beacon"]}}
_PARTS = [{"required": ["vehicle"]}, {"required": ["sensors"]}]
_VEHICLE_OR_TEXT: _Json = {
    "oneOf": [{"allOf": _PARTS, "not": {"required": ["system"]}}, {"required": ["system"], "not": {"anyOf": _PARTS}}]
}


def require_unless_replayed(schema: _Json) -> None:
    """Let a scenario's schema ask for start, times and beacons only where there is no table `replay`."""
    schema["required"] = [key for key in schema["required"] if key not in _BY_THE_LOG]
    needed = {"time": {"required": list(_TIMES)}, "sensors": {"items": _OF_A_BEACON}}
    schema["allOf"] = [_VEHICLE_OR_TEXT]
    schema |= {"if": {"not": {"required": ["replay"]}}, "then": {"required": list(_BY_THE_LOG), "properties": needed}}


def without_times(schema: _Json) -> None:
    """Let the schema of the table `time` ask for nothing: the scenario's does."""
    del schema["required"]


def required_of(kind: str, keys: list[str]) -> list[str]:
    """Return which keys a table of that kind needs in any scenario."""
    return [key for key in keys if key != "beacon" or kind not in OF_LANDMARKS]
