"""Where along a path each sensor is on: in turns or on straight stretches, near its beacon or far, early or late."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from obsdesign.report.derived_quantities import segment_nodes
from obsdesign.report.number_format import join
from obsdesign.study.record import Study

TURN_THRESHOLD = 0.2  # share of the fastest segment's turn rate above which a segment counts as a turn
_SLOWEST = 0.002  # rad/s: below it nothing counts as a turn
_MAJORITY = 0.8  # share of a sensor's time that makes a "where"


@dataclass(frozen=True, eq=False)
class SegmentTraits:
    """turning (K,) bool; is_near (K, S) bool: nearer to the sensor's beacon than half of the path is, False without one; seconds (K,)."""

    is_turning: np.ndarray
    is_near: np.ndarray
    has_beacon: tuple[bool, ...]
    seconds: np.ndarray

    @property
    def is_mixed(self) -> bool:
        """Whether there are both turns and straight stretches."""
        return bool(self.is_turning.any() and not self.is_turning.all())

    def share(self, on: np.ndarray, condition: np.ndarray) -> float:
        """Share of the time of segments `on` (K,) that lies in `condition` (K,); NaN if they are never on."""
        total = float(self.seconds @ on)
        return float(self.seconds @ (on & condition)) / total if total else float("nan")


def segment_traits(study: Study) -> SegmentTraits:
    """Return where the segments of the study's path lie."""
    path, nodes, scenario = study.main.path, study.main.nodes, study.scenario
    seconds = np.diff(segment_nodes(study))
    turning = np.zeros(len(seconds), dtype=bool)
    if "heading" in scenario.state_names:
        rates = np.abs(np.diff(path.x[:, scenario.state_names.index("heading")])) / path.step
        mean = np.add.reduceat(rates, nodes[:-1]) / np.diff(nodes)
        turning = mean > max(TURN_THRESHOLD * float(mean.max()), _SLOWEST)
    landmarks = [channel.landmarks for channel in scenario.system.model.channels]
    near = np.zeros((len(seconds), len(landmarks)), dtype=bool)
    if {"x", "y"} <= set(scenario.state_names):
        positions = path.x[:, [scenario.state_names.index(name) for name in ("x", "y")]]
        middle = np.array([positions[first : last + 1].mean(axis=0) for first, last in pairwise(nodes)])
        for s, points in enumerate(landmarks):
            if points:
                distance = np.min([np.hypot(*(middle - point).T) for point in points], axis=0)
                near[:, s] = distance < np.median(distance)
    return SegmentTraits(turning, near, tuple(bool(points) for points in landmarks), seconds)


def usage_in_words(study: Study) -> str:
    """Say where each sensor is on: gps in turns, magnetometer on straight stretches."""
    traits, chosen = segment_traits(study), study.selection.chosen
    return join(
        [f"{name} {_usage_text(traits, chosen[:, s], s)}" for s, name in enumerate(study.scenario.sensor_names) if chosen[:, s].any()]
    )


def _usage_text(traits: SegmentTraits, on: np.ndarray, sensor: int) -> str:
    if on.all():
        return "throughout"
    late = np.arange(len(on)) >= len(on) / 2
    conditions = [("in turns", traits.is_turning), ("on straight stretches", ~traits.is_turning)] if traits.is_mixed else []
    conditions += [("near its beacon", traits.is_near[:, sensor]), ("far from its beacon", ~traits.is_near[:, sensor])] * traits.has_beacon[
        sensor
    ]
    conditions += [("in the first half", ~late), ("in the second half", late)]
    everything = np.ones(len(on), dtype=bool)
    for words, condition in conditions:
        # a place that most of the path is in says nothing
        if traits.share(on, condition) >= _MAJORITY > traits.share(everything, condition):
            return words
    return "here and there"
