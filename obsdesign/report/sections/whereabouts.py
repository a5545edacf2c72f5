"""Where along a path each sensor is on: in turns or on straight stretches, near its beacon or far, early or late."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from obsdesign.report.derived_quantities import segment_nodes
from obsdesign.report.number_format import joined
from obsdesign.study.record import Study

TURNING = 0.2  # share of the fastest segment's turn rate above which a segment counts as a turn
_SLOWEST = 0.002  # rad/s: below it nothing counts as a turn
_MOST = 0.8  # share of a sensor's time that makes a "where"


@dataclass(frozen=True, eq=False)
class Whereabouts:
    """turning (K,) bool; near (K, S) bool: nearer to the sensor's beacon than half of the path is, False without one; seconds (K,)."""

    turning: np.ndarray
    near: np.ndarray
    has_beacon: tuple[bool, ...]
    seconds: np.ndarray

    @property
    def is_mixed(self) -> bool:
        """Whether there are both turns and straight stretches."""
        return bool(self.turning.any() and not self.turning.all())

    def share(self, on: np.ndarray, where: np.ndarray) -> float:
        """Share of the time of segments `on` (K,) that lies in `where` (K,); NaN if they are never on."""
        total = float(self.seconds @ on)
        return float(self.seconds @ (on & where)) / total if total else float("nan")


def whereabouts(study: Study) -> Whereabouts:
    """Return where the segments of the study's path lie."""
    path, nodes, scenario = study.main.path, study.main.nodes, study.scenario
    seconds = np.diff(segment_nodes(study))
    turning = np.zeros(len(seconds), dtype=bool)
    if "heading" in scenario.state_names:
        rates = np.abs(np.diff(path.x[:, scenario.state_names.index("heading")])) / path.step
        mean = np.add.reduceat(rates, nodes[:-1]) / np.diff(nodes)
        turning = mean > max(TURNING * float(mean.max()), _SLOWEST)
    landmarks = [sensor.landmark for sensor in scenario.sensors]
    near = np.zeros((len(seconds), len(landmarks)), dtype=bool)
    if {"x", "y"} <= set(scenario.state_names):
        place = path.x[:, [scenario.state_names.index(name) for name in ("x", "y")]]
        middle = np.array([place[first : last + 1].mean(axis=0) for first, last in pairwise(nodes)])
        for s, landmark in enumerate(landmarks):
            if landmark is not None:
                distance = np.hypot(*(middle - landmark).T)
                near[:, s] = distance < np.median(distance)
    return Whereabouts(turning, near, tuple(landmark is not None for landmark in landmarks), seconds)


def where_in_words(study: Study) -> str:
    """Say where each sensor is on: gps in turns, magnetometer on straight stretches."""
    found, chosen = whereabouts(study), study.selection.schedule.chosen
    return joined([f"{name} {_where(found, chosen[:, s], s)}" for s, name in enumerate(study.scenario.sensor_names) if chosen[:, s].any()])


def _where(found: Whereabouts, on: np.ndarray, sensor: int) -> str:
    if on.all():
        return "throughout"
    late = np.arange(len(on)) >= len(on) / 2
    places = [("in turns", found.turning), ("on straight stretches", ~found.turning)] if found.is_mixed else []
    places += [("near its beacon", found.near[:, sensor]), ("far from its beacon", ~found.near[:, sensor])] * found.has_beacon[sensor]
    places += [("in the first half", ~late), ("in the second half", late)]
    everything = np.ones(len(on), dtype=bool)
    for words, where in places:
        # a place that most of the path is in says nothing
        if found.share(on, where) >= _MOST > found.share(everything, where):
            return words
    return "here and there"
