"""Missions as autopilots hold them: numbered items in MAVLink's terms."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from obsdesign.errors import InputError
from obsdesign.exchange.abstract import AbstractFormat, Precision
from obsdesign.exchange.geodesy import geodetic, local
from obsdesign.exchange.track import About, GeodeticOrigin, Track, compass_degrees
from obsdesign.study.thinned_path import Autopilot

Switches = tuple[tuple[str, int], ...]

# of MAVLink's common.xml
WAYPOINT, CHANGE_SPEED, SET_RELAY, SET_ACTUATOR = 16, 178, 181, 187
ABSOLUTE, MISSION, RELATIVE = 0, 2, 3  # frames: above the height reference, none, above home
_ABSOLUTE, _RELATIVE = (0, 5), (3, 6)  # the latter of each in scaled integers
_VISITED = (16, 17, 18, 19, 21, 82)  # commands that lead to their position: way point, loiter, land, spline
MAX_SWITCH = {"px4": 6, "ardupilot": 15}


@dataclass(frozen=True)
class AbstractMission(AbstractFormat):
    """A format of missions for an autopilot; switches: (sensor, number) that the mission switches as the schedule says."""

    autopilot: Autopilot = "px4"
    switches: Switches = ()

    @property
    def precision(self) -> Precision:
        """Eight decimals of degrees, three of metres; no times."""
        return Precision(1.5e-3, None, None)

    @property
    def is_mission(self) -> bool:
        """Way points."""
        return True


class MissionItem(NamedTuple):
    """A command in a frame with its seven parameters; NaN where the autopilot is to choose."""

    command: int
    frame: int
    parameters: tuple[float, ...]


def mission_of(track: Track, autopilot: Autopilot, switches: Switches) -> list[MissionItem]:
    """Return the items that fly a track: a way point per point, the speed after the first, switches where sensors change.

    Way points lie above home, with the heading of the nose in degrees; speeds are air speeds where the vehicle moves through a medium.
    A switch is a relay of ArduPilot (DO_SET_RELAY) or an actuator of PX4 (DO_SET_ACTUATOR, 1 on, -1 off).
    """
    points, headings = geodetic(track, "a mission"), compass_degrees(track.nose)
    places = np.column_stack([np.round(headings, 2) % 360, np.round(points[:, :2], 8), np.round(track.position[:, 2], 3)])
    items: list[MissionItem] = []
    due = _switch_items(track, autopilot, switches)
    for k, (heading, latitude, longitude, height) in enumerate(places.tolist()):
        items.append(MissionItem(WAYPOINT, RELATIVE, (0.0, 0.0, 0.0, heading, latitude, longitude, height)))
        if k == 0 and track.cruise is not None:
            kind = 0.0 if track.through_medium else 1.0
            items.append(MissionItem(CHANGE_SPEED, MISSION, (kind, round(track.cruise, 3), -1.0, 0.0, 0.0, 0.0, 0.0)))
        items += due.get(k, ())
    return items


def _require_switches(track: Track, autopilot: Autopilot, switches: Switches) -> None:
    names = () if track.sensors is None else track.sensors.names
    for name, number in switches:
        if name not in names:
            raise InputError(f"there is no sensor {name!r} to switch (accepted: {', '.join(names) or 'none'})")
        first = 1 if autopilot == "px4" else 0
        if not first <= number <= MAX_SWITCH[autopilot]:
            raise InputError(f"switch of {name} is {number}: must be from {first} to {MAX_SWITCH[autopilot]} for {autopilot}")


def way_point_at(track: Track, time: float) -> int:
    """Return the index of the last point that is reached by a time [s]."""
    return max(int(np.searchsorted(track.t, time + 1e-9)) - 1, 0)


def _switch_items(track: Track, autopilot: Autopilot, switches: Switches) -> dict[int, list[MissionItem]]:
    """Return the items that follow each way point: the switches of sensors that change there."""
    _require_switches(track, autopilot, switches)
    sensors = track.sensors
    due: dict[int, list[MissionItem]] = {}
    if sensors is None:
        return due
    for k, (name, number) in product(sensors.changes, switches):
        column = sensors.names.index(name)
        is_on = bool(sensors.chosen[k, column])
        if k == 0 or is_on != sensors.chosen[k - 1, column]:
            due.setdefault(way_point_at(track, float(sensors.t[k])), []).append(_switch(autopilot, number, is_on))
    return due


def _switch(autopilot: Autopilot, number: int, is_on: bool) -> MissionItem:
    if autopilot == "ardupilot":
        return MissionItem(SET_RELAY, MISSION, (float(number), float(is_on), 0.0, 0.0, 0.0, 0.0, 0.0))
    values = [math.nan] * 6
    values[number - 1] = 1.0 if is_on else -1.0
    return MissionItem(SET_ACTUATOR, MISSION, (*values, 0.0))


def sensors_table(track: Track, autopilot: Autopilot, switches: Switches) -> str:
    """Return a table of which sensors are on when, and from which item on, by both ways of counting; "" without sensors.

    PX4 counts items from 0, ArduPilot from 1, home being its item 0.
    """
    sensors = track.sensors
    if sensors is None:
        return ""
    lines = [",".join(("segment", "from [s]", "to [s]", "PX4 item", "ArduPilot item", *(f'"{name}"' for name in sensors.names)))]
    numbers = _way_point_numbers(track, autopilot, switches)
    for k, (first, row) in enumerate(zip(sensors.t.tolist(), sensors.chosen.astype(int).tolist(), strict=False)):
        number = int(numbers[way_point_at(track, first)])
        lines.append(",".join(map(str, (k, first, sensors.t[k + 1], number, number + 1, *row))))
    return "\n".join(lines) + "\n"


def _way_point_numbers(track: Track, autopilot: Autopilot, switches: Switches) -> np.ndarray:
    """Return the number of each way point among the items of mission_of, counted from 0."""
    following = np.zeros(len(track.t), dtype=int)
    following[0] = track.cruise is not None
    for k, switch_items in _switch_items(track, autopilot, switches).items():
        following[k] += len(switch_items)
    return np.arange(len(following)) + np.cumsum(following) - following


def track_of_mission(items: Iterable[MissionItem], about: About, home: tuple[float, float, float] | None, name: str) -> Track:
    """Return the way points of a mission as a track; without times of its own, those at which its speed, or 1 m/s, would reach them.

    home: latitude, longitude, altitude, the origin where `about` tells none. Raises InputError for frames that are neither above home
    nor absolute, and for missions of fewer than two way points.
    """
    visited = [item for item in items if item.command in _VISITED]
    speeds = [item.parameters[1] for item in items if item.command == CHANGE_SPEED and item.parameters[1] > 0]
    wrong = [item.frame for item in visited if item.frame not in (*_ABSOLUTE, *_RELATIVE)]
    if wrong:
        raise InputError(f"frame {wrong[0]}: must be one of {', '.join(map(str, (*_ABSOLUTE, *_RELATIVE)))}")
    if len(visited) < 2:
        raise InputError(f"has {len(visited)} way points: must have at least two")
    places = np.array([item.parameters[4:] for item in visited])
    start = about.origin or GeodeticOrigin(*(home or (places[0, 0], places[0, 1], 0.0)))
    above = np.array([0.0 if item.frame in _ABSOLUTE else start.altitude for item in visited])
    origin, position = local(places[:, 0], places[:, 1], places[:, 2] + above, start)
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    moving = np.append(True, steps > 0)
    cruise = speeds[0] if speeds else None
    t = np.cumsum(np.append(0.0, steps))[moving] / (cruise or 1.0)
    return Track(t, position[moving], None, origin, about.epoch, about.sensors, name, cruise)
