"""What a log is replayed with: system, prior and settings, of a scenario, or of a file that holds its beacons itself."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion, Over
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.system import System
from obsdesign.errors import InputError
from obsdesign.logs.log import Log
from obsdesign.logs.npz import RANGING, TAGS, beacon_places, load_npz
from obsdesign.logs.reading import read_log
from obsdesign.logs.truth import LogTruth
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.prior import Prior
from obsdesign.rules.abstract import AbstractRule
from obsdesign.scenario.schema import Scenario
from obsdesign.scenario.tables import ReplayTable
from obsdesign.sensors.range import Range
from obsdesign.study.recorded_tags import TagRanges, Trolley
from obsdesign.vehicles.unicycle import Unicycle

_RANGING_STD = {"x": 3.0, "y": 3.0, "heading": 0.3}
_TAG_STD = {"x": 0.1, "y": 0.1, "heading": 0.1, "speed": 0.5, "turn_rate": 0.5}
_RANGE_SIGMA, _TAG_SIGMA = 1.0, 0.1  # m, to begin a calibration with
_LATE = 1.0  # s: truth that begins so much later than the log does not tell its start
_MOVES = 0.2  # m: shorter ways between true positions tell no direction


@dataclass(frozen=True)
class LogChoice:
    """How sensors of a log are chosen: so many on at a time, for so long each [s], by what, under which rules; see select_for_filter.

    unasked: keys of the scenario's selection that are not for logs.
    """

    per_segment: int = 1
    segment: float = 10.0
    over: Over = "mean"
    criterion: AbstractCriterion | None = None
    rules: tuple[AbstractRule, ...] = ()
    gap: float = 1e-2
    unasked: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class LogSetup:
    """A log with what it is replayed with, before it is calibrated.

    start: states that are known to begin with, by name; std: standard deviation of each state before the first sample.
    """

    title: str
    file: Path
    system: AbstractSystem
    log: Log
    start: dict[str, float]
    std: dict[str, float]
    settings: ReplayTable
    disturbance_psd: DisturbancePsd
    input_psd: InputPsd
    choice: LogChoice
    landmarks: dict[str, tuple[float, float]]

    @property
    def prior(self) -> Prior:
        """Of the state at the log's beginning: what is given, else the truth, else 0 where the prior is no narrower than the heading's.

        Raises InputError where the position is told by neither.
        """
        names, told = self.system.model.state_names, self._told
        mean = self._untold | told
        missing = [name for name in self.settings.about if name not in told]
        if missing:
            raise InputError(f"start: missing key {missing[0]!r}: the log holds no truth of it there; say in [start] where the log begins")
        return Prior([mean[name] for name in names], std=[self.std[name] for name in names])

    @property
    def _told(self) -> dict[str, float]:
        """States at the log's beginning: what is given, else the truth there."""
        angles = tuple(signal.name for signal in self.system.model.states if signal.is_angle)
        return _first_truth(self.log, angles) | self.start

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on states whose beginning nobody tells, and on what is not asked of logs."""
        untold = ((name, value) for name, value in self._untold.items() if name not in self._told)
        begins = tuple(
            f"{name} begins at {value:g}, as uncertain as the prior says: neither [start] nor the truth tells it" for name, value in untold
        )
        keys = ", ".join(self.choice.unasked)
        return (*begins, f"of [selection] not asked of a log: {keys}; sensors are chosen for the filter") if keys else begins

    @property
    def _untold(self) -> dict[str, float]:
        """What states are where nobody tells: 1 for the scale of a sensor, else 0."""
        sensors = self.system.sensors if isinstance(self.system, System) else ()
        scales = {sensor.scale for sensor in sensors}
        return {name: 1.0 if name in scales else 0.0 for name in self.system.model.state_names}


def _choice_of(scenario: Scenario) -> LogChoice:
    """Return how a scenario chooses among the samples of a log: always for the filter."""
    table = scenario.selection
    is_weighted = isinstance(table.over, tuple)
    unasked = {"question": table.question not in (None, "filter"), "over": is_weighted} | {
        key: bool(getattr(table, key)) for key in ("requirements", "cost", "start", "robust_to", "pareto")
    }
    return LogChoice(
        table.per_segment,
        scenario.time.segment,
        "mean" if is_weighted else table.over,
        scenario.filter_criterion if "criterion" in table.model_fields_set else None,
        scenario.rules_for("filter"),
        table.gap if "gap" in table.model_fields_set else LogChoice.gap,
        tuple(key for key, is_given in unasked.items() if is_given),
    )


def from_first_truth(log: Log, about: tuple[str, ...]) -> Log:
    """Return the log from where the truth of what counts begins, where that is later than the log does: nothing else tells the start."""
    truth = log.truth
    columns = [] if truth is None else [truth.names.index(name) for name in about if name in truth.names]
    if truth is None or not columns:
        return log
    told = truth.t[np.isfinite(truth.x[:, columns]).all(axis=1)]
    first, last = log.span
    if not len(told) or told[0] - first <= _LATE or told[0] >= last:
        return log
    part = log.stretch(float(told[0]), last)
    note = f"replayed from t = {told[0]:.9g} s on, where the truth begins: no [start] says where the log does"
    return replace(part, notes=(*part.notes, note))


def _first_truth(log: Log, angles: tuple[str, ...]) -> dict[str, float]:
    """The true value of each state where the log begins, or a moment later; none of those that are told only later, or only earlier."""
    if log.truth is None:
        return {}
    first, told = log.span[0], {}
    at_first = log.truth.at(np.array([first]), angles)[0]
    for column, name in enumerate(log.truth.names):
        is_known = np.isfinite(log.truth.x[:, column]) & (log.truth.t >= first) & (log.truth.t <= first + _LATE)
        if np.isfinite(at_first[column]):
            told[name] = float(at_first[column])
        elif is_known.any():
            told[name] = float(log.truth.x[is_known, column][0])
    return told


def scenario_setup(file: Path, scenario: Scenario, topics: Path | None) -> LogSetup:
    """Return a log read as a scenario says."""
    named = scenario.replay.topics
    chosen = topics or (Path(scenario.file).parent / named if named else None)
    start = dict(scenario.start) if "start" in tomllib.loads(scenario.source) else {}
    log = read_log(file, scenario.system, chosen)
    log = log if start else from_first_truth(log, scenario.replay.about)
    return LogSetup(
        scenario.title,
        file,
        scenario.system,
        log,
        start,
        dict(scenario.prior),
        scenario.replay,
        scenario.disturbance_psd,
        scenario.input_psd,
        _choice_of(scenario),
        _landmarks_of(scenario.system),
    )


def file_setup(file: Path) -> LogSetup:
    """Return a log whose file holds its beacons: an NPZ of ranges to beacons with odometry, or of tags to anchors without.

    Raises InputError for other files, which need a scenario.
    """
    if file.suffix.lower() != ".npz":
        raise InputError(f"{file}: needs --scenario, a TOML file with [vehicle], [[sensors]] and [prior]: the file does not say what moved")
    arrays = load_npz(file)
    if set(RANGING) <= set(arrays):
        return _ranging_setup(file, arrays)
    if set(TAGS) <= set(arrays):
        return _tag_setup(file, arrays)
    raise InputError(f"{file}: needs --scenario: its arrays {', '.join(arrays)} are of no known layout")


def _ranging_setup(file: Path, arrays: dict[str, np.ndarray]) -> LogSetup:
    beacons = {f"beacon_{name:g}": place for name, place in beacon_places(file, arrays["beacons"]).items()}
    system = System(Unicycle(), tuple(Range(place, _RANGE_SIGMA, name=name) for name, place in beacons.items()))
    log = from_first_truth(_facing_forward(read_log(file, system)), ("x", "y"))
    return LogSetup(file.stem, file, system, log, {}, _RANGING_STD, ReplayTable(), None, None, LogChoice(), beacons)


def _tag_setup(file: Path, arrays: dict[str, np.ndarray]) -> LogSetup:
    height = float(np.median(arrays["pose"][:, 2]))
    tags = tuple((float(a), float(b), float(c) + height) for a, b, c in arrays["tags_body"])
    anchors = {f"anchor_{i}": (float(x), float(y), float(z)) for i, (x, y, z) in enumerate(arrays["anchors"])}
    sensors = tuple(TagRanges(anchor=place, tags=tags, sigma=_TAG_SIGMA, name=name) for name, place in anchors.items())
    system = System(Trolley(), sensors)
    places = {name: (x, y) for name, (x, y, _) in anchors.items()}
    return LogSetup(file.stem, file, system, read_log(file, system), {}, _TAG_STD, ReplayTable(), None, None, LogChoice(), places)


def _facing_forward(log: Log) -> Log:
    """Return the log with true headings that are those of the motion, where the vehicle drove backwards and counts that as forward."""
    truth = log.truth
    if truth is None or not {"x", "y", "heading"} <= set(truth.names):
        return log
    x, y, heading = (truth.x[:, truth.names.index(name)] for name in ("x", "y", "heading"))
    step = max(len(x) // 2000, 1)
    dx, dy = np.diff(x[::step]), np.diff(y[::step])
    ahead = dx * np.cos(heading[::step][:-1]) + dy * np.sin(heading[::step][:-1])
    moves = np.hypot(dx, dy) > min(_MOVES, float(np.nanmedian(np.hypot(dx, dy)))) if len(dx) else np.zeros(0, dtype=bool)
    if not moves.any() or np.nanmean(ahead[moves] > 0) > 0.5:
        return log
    turned = truth.x.copy()
    turned[:, truth.names.index("heading")] += np.pi
    note = "the true heading is against the motion: it is turned by 180 degrees"
    return replace(log, truth=LogTruth(truth.names, truth.t, turned), notes=(*log.notes, note))


def _landmarks_of(system: AbstractSystem) -> dict[str, tuple[float, float]]:
    """The places of sensors that look at one beacon, by their names."""
    return {channel.name: channel.landmarks[0] for channel in system.model.channels if len(channel.landmarks) == 1}
