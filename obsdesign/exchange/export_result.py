"""A result's path in the formats of planners and autopilots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.calculus import wrap
from obsdesign.errors import InputError
from obsdesign.exchange.formats import format_of, write_track
from obsdesign.exchange.mission import Switches
from obsdesign.exchange.schedule_csv import read_schedule_csv
from obsdesign.exchange.track import GeodeticOrigin, SensorTimes, Track, sensor_changes
from obsdesign.exchange.trajectory_csv import read_trajectory_csv
from obsdesign.exchange.words import MISSION_WORDS, PLACED_WORDS
from obsdesign.scenario.loading import load_scenario_of_path
from obsdesign.scenario.schema import Scenario
from obsdesign.scenario.tables import PlaceTable
from obsdesign.study.record import Study
from obsdesign.study.thinned_flight import Thinning, judge_way_points, way_points_of
from obsdesign.study.thinned_path import Autopilot, ThinnedPath
from obsdesign.trajectory import Trajectory

WAY_POINT_TOLERANCE = 2.0  # [m] that the way points of missions keep to the path, unless another is asked for


@dataclass(frozen=True)
class Export:
    """What was written of a result's path, and what leaving points out of it costs."""

    files: tuple[Path, ...]
    """The file, or the folder of a bag; beside a mission the table of its sensors."""
    points: int
    """How many points it has."""
    thinned: ThinnedPath | None
    """What the way points cost where points were left out; None where all are there, or where nothing could fly them."""
    notes: tuple[str, ...] = ()
    """What is to be said about it, in words."""


@dataclass(frozen=True)
class ExportSettings:
    """Which points are written, and for whom.

    tolerance: points are left out as long as the path stays within so many metres of the rest; None = 2 m for missions, else all stay.
    every: the first point of every so many seconds instead. autopilot: whose items a mission has, and whose guidance flies the way
    points to see what leaving points out costs. switches: (sensor, number): a relay of ArduPilot or an actuator of PX4 that a mission
    switches as the schedule says. Raises InputError where tolerance and every are both given.
    """

    tolerance: float | None = None
    every: float | None = None
    autopilot: Autopilot = "px4"
    switches: Switches = ()

    def __post_init__(self) -> None:
        if self.tolerance is not None and self.every is not None:
            raise InputError("tolerance and every are both given: must be one of them")

    def thinning(self, is_mission: bool) -> Thinning:
        """Return which points stay."""
        is_told = not is_mission or self.tolerance is not None or self.every is not None
        return Thinning(self.tolerance if is_told else WAY_POINT_TOLERANCE, self.every)


@validate_arguments
def export(
    result: str | Path,
    to: str,
    out: str | Path | None = None,
    *,
    tolerance: float | None = None,
    every: float | None = None,
    autopilot: Autopilot = "px4",
    switches: Mapping[str, int] | None = None,
) -> Export:
    """Write the path and the schedule of a result's folder in a format of autopilots and planners.

    Arguments:
        result: folder that a run wrote: its question.toml, trajectory.csv and schedule.csv are read.
        to: plan, wpl, kml, gpx, geojson, czml, tum, bag, csv or npz.
        out: file, for a bag folder, to write; None = path with the format's ending in the result's folder.
        tolerance: points are left out as long as the path stays within so many metres of the rest; None = 2 m for missions, else all stay.
        every: the first point of every so many seconds [s] instead.
        autopilot: whose items a mission has, and whose guidance flies the way points to see what leaving points out costs.
        switches: sensor -> number of the relay of ArduPilot, or the actuator of PX4, that a mission switches as the schedule says.
    Raises InputError for a folder or a format that is none, for what the format cannot hold, and for a target that cannot be written.
    """
    settings = ExportSettings(tolerance, every, autopilot, tuple((switches or {}).items()))
    folder, kind = Path(result), format_of(to)
    scenario = load_scenario_of_path(_part(folder, "question.toml"))
    path = read_trajectory_csv(scenario.system, _part(folder, "trajectory.csv")).path
    sensors = read_schedule_csv(_part(folder, "schedule.csv"), scenario.sensor_names)
    target = folder / f"path{kind.suffix}" if out is None else Path(out)
    return export_path(scenario, path, sensors, to, target, settings)


def require_exportable(scenario: Scenario, words: tuple[str, ...]) -> None:
    """Raise InputError for what a scenario's path cannot be written as, before any work is done."""
    for word in words:
        if scenario.place is None and word in PLACED_WORDS:
            raise InputError(f"{word} needs a place on Earth: give [place] latitude, longitude in the scenario")
        if word in MISSION_WORDS and scenario.place is not None and scenario.place.height is None:
            raise InputError("place.height: missing key: at what height above the place way points lie [m], 0 on the ground")


def export_study(study: Study, to: str, folder: Path, settings: ExportSettings) -> Export:
    """Write the main path of a study and its schedule into a folder; see export."""
    times = study.main.path.t[study.main.nodes]
    sensors = SensorTimes(study.scenario.sensor_names, times, study.selection.chosen)
    return export_path(study.scenario, study.main.path, sensors, to, folder / f"path{format_of(to).suffix}", settings)


def export_path(scenario: Scenario, path: Trajectory, sensors: SensorTimes, to: str, target: Path, settings: ExportSettings) -> Export:
    """Write a path and a schedule of a scenario; see export."""
    kind = format_of(to)
    require_exportable(scenario, (to,))
    thinning = settings.thinning(kind.is_mission)
    track = track_of(scenario, path, sensors)
    always = tuple(i for i, _ in sensor_changes(track)) if kind.is_mission else ()
    points = way_points_of(scenario, path, thinning, always)
    files = write_track(track.part(points), to, target, settings.autopilot, settings.switches)
    if len(points) == len(path.t):
        return Export(files, len(points), None)
    try:
        thinned = judge_way_points(scenario, path, sensors.chosen, points, thinning, settings.autopilot)
    except InputError as error:
        return Export(files, len(points), None, (f"what leaving points out costs is not told: {error}",))
    return Export(files, len(points), thinned)


def track_of(scenario: Scenario, path: Trajectory, sensors: SensorTimes | None) -> Track:
    """Return a path of a scenario as files hold it: metres east and north of the place, x and y themselves where there is none."""
    place, names = scenario.place, scenario.state_names
    if "x" not in names or "y" not in names:
        raise InputError(f"a path in files has states x and y: the vehicle has {', '.join(names)}")
    x, y = path.x[:, names.index("x")], path.x[:, names.index("y")]
    height = 0.0 if place is None else place.height or 0.0
    angle, offset = (0.0, (0.0, 0.0)) if place is None else (np.pi / 2 - place.bearing, (place.east, place.north))
    east = offset[0] + x * np.cos(angle) - y * np.sin(angle)
    north = offset[1] + x * np.sin(angle) + y * np.cos(angle)
    heading = path.x[:, names.index("heading")] + angle if "heading" in names else None
    speed, through_medium = _cruise(scenario, path, x, y)
    return Track(
        t=path.t,
        position=np.column_stack([east, north, np.full(len(path.t), height)]),
        heading=None if heading is None else -wrap(-heading),
        origin=None if place is None else _origin(place),
        epoch=Track.epoch if place is None else place.begins,
        sensors=sensors,
        name=scenario.title,
        cruise=speed,
        through_medium=through_medium,
    )


def _origin(place: PlaceTable) -> GeodeticOrigin:
    return GeodeticOrigin(place.latitude, place.longitude, place.altitude, place.height_reference)


def _cruise(scenario: Scenario, path: Trajectory, x: np.ndarray, y: np.ndarray) -> tuple[float | None, bool]:
    """Return the mean speed [m/s], through the medium where the scenario has wind; None where nothing moves."""
    model = scenario.system.model
    states, unknown = model.state_names, [signal.name for signal in model.unknown_inputs]
    steps, through_medium = np.column_stack([np.diff(x), np.diff(y)]), "wind_x" in (*states, *unknown)
    velocity = steps / np.diff(path.t)[:, None]
    if "wind_x" in states and "wind_y" in states:
        velocity -= path.x[:-1][:, [states.index("wind_x"), states.index("wind_y")]]
    speed = float(np.linalg.norm(velocity, axis=1).mean())
    return (speed if speed > 0 else None), through_medium


def _part(result: Path, name: str) -> Path:
    if not (result / name).is_file():
        raise InputError(f"{result}: has no {name}: must be a folder that obsdesign run or select wrote")
    return result / name
