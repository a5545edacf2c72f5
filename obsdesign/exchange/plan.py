"""QGroundControl's plan: a mission with its home, as QGroundControl and MAVSDK read it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from obsdesign.errors import InputError
from obsdesign.exchange.abstract import read_json
from obsdesign.exchange.mission import RELATIVE, WAYPOINT, AbstractMission, MissionItem, mission_of, track_of_mission
from obsdesign.exchange.track import GeodeticOrigin, Track, about_text, read_about

_FIRMWARE = {"px4": 12, "ardupilot": 3}  # MAV_AUTOPILOT
_FIXED_WING, _ROVER = 1, 10  # MAV_TYPE
_ABOVE_HOME = 1  # QGroundControl's AltitudeMode


@dataclass(frozen=True)
class QgcPlan(AbstractMission):
    """Simple items above the planned home, with the empty fence and rally points that MAVSDK asks for; origin and sensors beside them."""

    @property
    def suffix(self) -> str:
        """.plan."""
        return ".plan"

    def write(self, track: Track, target: Path) -> None:
        """Write the plan."""
        items = mission_of(track, self.autopilot, self.switches)
        origin, speed = track.origin or GeodeticOrigin(0.0, 0.0), 15.0 if track.cruise is None else track.cruise
        plan = {
            "fileType": "Plan",
            "version": 1,
            "groundStation": "QGroundControl",
            "mission": {
                "version": 2,
                "firmwareType": _FIRMWARE[self.autopilot],
                "vehicleType": _FIXED_WING if track.position[:, 2].any() else _ROVER,
                "cruiseSpeed": speed,
                "hoverSpeed": speed,
                "globalPlanAltitudeMode": _ABOVE_HOME,
                "plannedHomePosition": [origin.latitude, origin.longitude, origin.altitude],
                "items": [_simple_item(item, number) for number, item in enumerate(items, 1)],
            },
            "geoFence": {"version": 2, "circles": [], "polygons": []},
            "rallyPoints": {"version": 2, "points": []},
            "obsdesign": about_text(track),
        }
        target.write_text(json.dumps(plan, allow_nan=False, separators=(",", ":")) + "\n", encoding="utf-8")

    def parse(self, file: Path) -> Track:
        """Return the way points of a plan of simple items."""
        plan = read_json(file)
        if plan.get("fileType") != "Plan":
            raise InputError(f"has fileType {plan.get('fileType')!r}: must be 'Plan'")
        mission = plan["mission"]
        items = [_item(entry, number) for number, entry in enumerate(mission["items"])]
        home = tuple(float(value) for value in mission["plannedHomePosition"])
        beside = plan.get("obsdesign")
        about = read_about(beside if isinstance(beside, str) else None)
        return track_of_mission(items, about, (home[0], home[1], home[2]), file.stem)


def _simple_item(item: MissionItem, number: int) -> dict[str, Any]:
    parameters: list[float | None] = list(item.parameters)
    if any(map(math.isnan, item.parameters)):
        parameters = [None if math.isnan(value) else value for value in item.parameters]
    simple = {
        "type": "SimpleItem",
        "command": item.command,
        "frame": item.frame,
        "params": parameters,
        "autoContinue": True,
        "doJumpId": number,
    }
    if item.command != WAYPOINT:
        return simple
    mode = _ABOVE_HOME if item.frame == RELATIVE else 2
    return simple | {"Altitude": item.parameters[6], "AltitudeMode": mode, "AMSLAltAboveTerrain": None}


def _item(entry: Any, number: int) -> MissionItem:  # noqa: ANN401  # whatever a file holds
    if entry["type"] != "SimpleItem":
        raise InputError(f"item {number} is a {entry['type']!r}: must be a SimpleItem")
    given = entry["params"]
    parameters = tuple(map(float, given if None not in given else (math.nan if value is None else value for value in given)))
    if len(parameters) != 7:
        raise InputError(f"item {number} has {len(parameters)} params: must have 7")
    return MissionItem(int(entry["command"]), int(entry["frame"]), parameters)
