"""QGC WPL 110: way points as text, a row per item, as Mission Planner, MAVProxy and MAVSDK read it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from obsdesign.errors import InputError
from obsdesign.exchange.abstract import read_text
from obsdesign.exchange.mission import ABSOLUTE, RELATIVE, WAYPOINT, AbstractMission, MissionItem, mission_of, track_of_mission
from obsdesign.exchange.track import About, GeodeticOrigin, Track

_HEAD = "QGC WPL 110"
_COLUMNS = 12
_ROW = "\t".join(["%d"] * 4 + ["%.3f"] * 4 + ["%.8f"] * 2 + ["%.3f", "1"])


@dataclass(frozen=True)
class WaypointText(AbstractMission):
    """Tabs and line feeds; for ArduPilot row 0 is home, for PX4 the first way point.

    Readers take no other lines, so that origin (for PX4) and sensors stand in the table beside the file.
    """

    @property
    def suffix(self) -> str:
        """.waypoints, as Mission Planner calls them."""
        return ".waypoints"

    def write(self, track: Track, target: Path) -> None:
        """Write the rows: number, current, frame, command, seven parameters, autocontinue."""
        items = mission_of(track, self.autopilot, self.switches)
        if self.autopilot == "ardupilot":
            origin = track.origin or GeodeticOrigin(0.0, 0.0)
            place = (origin.latitude, origin.longitude, origin.altitude)
            items.insert(0, MissionItem(WAYPOINT, ABSOLUTE, (0.0, 0.0, 0.0, 0.0, *place)))
        rows = [_HEAD, *(_row(item, number) for number, item in enumerate(items))]
        target.write_text("\n".join(rows) + "\n", encoding="ascii", newline="\n")

    def parse(self, file: Path) -> Track:
        """Return the way points; row 0 is home where it is absolute and the next row is not."""
        head, *lines = read_text(file).splitlines() or [""]
        if head.strip() != _HEAD:
            raise InputError(f"line 1 is {head[:40]!r}: must be {_HEAD!r}")
        items = [_item(line.split(), number) for number, line in enumerate(lines, 2) if line.strip() and not line.startswith("#")]
        if len(items) < 2:
            raise InputError(f"has {len(items)} items: must have at least two way points")
        has_home = items[0].frame == ABSOLUTE and items[1].frame == RELATIVE
        home = (items[0].parameters[4], items[0].parameters[5], items[0].parameters[6]) if has_home else None
        return track_of_mission(items[1:] if has_home else items, About(), home, file.stem)


def _row(item: MissionItem, number: int) -> str:
    return _ROW % (number, number == 0, item.frame, item.command, *item.parameters)


def _item(cells: list[str], line: int) -> MissionItem:
    if len(cells) != _COLUMNS:
        raise InputError(f"line {line} has {len(cells)} columns: must have {_COLUMNS}")
    parameters = tuple(map(float, cells[4:11]))
    if any(map(math.isinf, parameters)):
        raise InputError(f"line {line} holds an infinite number")
    return MissionItem(int(cells[3]), int(cells[2]), parameters)
