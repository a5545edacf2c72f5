"""What known inputs say of way and turn beside what the truth says: units of inputs, of the truth, and of times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from obsdesign.calculus import wrap
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.errors import InputError
from obsdesign.logs.log import Log
from obsdesign.logs.truth import LogTruth

FEWEST = 8  # values that a comparison needs
_NEAR = 1.6  # how far a ratio may be from a factor to be taken for it
_ALIKE = 0.5  # cosine of the angle between two histories that have something to do with each other
_THE_SAME, _OTHERS = 0.9, 0.75  # of two that are one, and at most of two that are not
_UNITS_OF_TIME = {"ms": 1e3, "us": 1e6, "ns": 1e9}
_THOUSAND = 1000.0
_MAX_ANGLE = 7.0  # no angle that wraps is larger [rad]
_RIGHT, _WRONG = 0.1, 0.2  # how far ways are apart that are the same, and that are not
_PLACES, _MOST = ("x", "y"), 200


def is_near(ratio: float, factor: float) -> bool:
    """Whether a ratio is a factor, to within what noise and scales may do to it."""
    return factor / _NEAR < ratio < factor * _NEAR


def motion_ratios(system: AbstractSystem, log: Log) -> Iterator[tuple[str, float]]:
    """Yield speed and turn rate with their integrals over what the truth says of way and heading."""
    for name, moved, size in _motion(log):
        if name in system.model.input_names and _cosine(moved, size) > _ALIKE:
            yield name, _ratio(moved, size)


def require_seconds(file: Path, ratios: Mapping[str, float]) -> None:
    """Raise InputError where way and turn are both too large by what a unit of time makes of a second, or the way by a million."""
    for unit, factor in _UNITS_OF_TIME.items():
        is_off = [is_near(ratio, factor) for ratio in ratios.values()]
        if all(is_off) and (len(is_off) > 1 or (is_off and factor > _THOUSAND)):
            raise InputError(
                f"{file}: {' and '.join(ratios)} over the log's time come to {max(ratios.values()):.3g} times what the truth says: are its"
                f" times in {unit}? Say so in the header, such as t [{unit}]"
            )


def require_true_metres(file: Path, log: Log) -> None:
    """Raise InputError where the way is that of the truth only with one of its positions a thousand times as large, or as small."""
    if log.truth is None or not set(_PLACES) <= set(log.truth.names):
        return
    off = {
        (names, factor): _way_off(log, log.truth, names, factor)
        for names in ((), _PLACES, *((name,) for name in _PLACES))
        for factor in (_THOUSAND, 1 / _THOUSAND)
    }
    names, factor = min(off, key=off.__getitem__)
    if len(names) == 1 and off[names, factor] < _RIGHT < _WRONG < off[(), factor]:
        raise InputError(
            f"{file}, column 'truth.{names[0]}': the way that the truth tells is that of the speed only with {factor:g} times its"
            " numbers: are they in thousandths or thousands? Say so in the header, such as [mm]"
        )


def _way_off(log: Log, truth: LogTruth, names: tuple[str, ...], factor: float) -> float:
    """Return how far the ways of speed and truth are apart, 0 is not at all, were some of its columns that many times as large."""
    way = _way(log, LogTruth(truth.names, truth.t, truth.x * np.where(np.isin(truth.names, names), factor, 1.0)))
    if way is None or not (ratio := _ratio(*way)) > 0:
        return float("inf")
    return abs(float(np.log(ratio))) + 1 - _cosine(*way)


def require_true_degrees(file: Path, system: AbstractSystem, log: Log) -> None:
    """Raise InputError where a true heading goes with the turn rate, or with the motion, only if it is in degrees."""
    truth = log.truth
    if truth is None or "heading" not in truth.names or "heading" not in system.model.state_names:
        return
    values = truth.x[:, truth.names.index("heading")]
    is_known = np.isfinite(values)
    if is_known.sum() < FEWEST or np.max(np.abs(values[is_known])) < _MAX_ANGLE:
        return
    t, heading = truth.t[is_known], values[is_known]
    as_radians, as_degrees = _fits(log, truth, t, heading), _fits(log, truth, t, np.radians(heading))
    if as_degrees > _THE_SAME and as_radians < _OTHERS:
        raise InputError(
            f"{file}, column 'truth.heading': its numbers go with the motion only if they are degrees: say so in the header,"
            " truth.heading [deg]"
        )


def _fits(log: Log, truth: LogTruth, t: np.ndarray, heading: np.ndarray) -> float:
    """Return how well headings (K,) at times (K,) go with the turn rate, or with the direction of the motion: 1 is as well as can be."""
    chosen = np.linspace(0, len(t) - 1, min(_MOST, len(t))).astype(int)
    t, heading = t[chosen], heading[chosen]
    fits = [float("-inf")]
    if log.inputs is not None and "turn_rate" in log.inputs.names:
        fits.append(_cosine(log.inputs.integrals(t)[:, log.inputs.names.index("turn_rate")], wrap(np.diff(heading))))
    if set(_PLACES) <= set(truth.names):
        dx, dy = np.diff(truth.at(t)[:, [truth.names.index(name) for name in _PLACES]], axis=0).T
        moves = np.hypot(dx, dy) > 0
        off = np.arctan2(dy[moves], dx[moves]) - heading[:-1][moves]
        fits.append(float(np.abs(np.mean(np.exp(1j * off)))) if moves.sum() >= FEWEST else float("-inf"))
    return max(fits)


def _motion(log: Log) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield speed and turn rate with their integrals (K,) between some times, and the way or turn of the truth (K,)."""
    way = None if log.truth is None else _way(log, log.truth)
    if way is not None:
        yield "speed", *way
    if log.truth is not None and "heading" in log.truth.names:
        both = _changes(log, log.truth, "turn_rate", ("heading",))
        if both is not None:
            yield "turn_rate", both[0], both[1][:, 0]


def _way(log: Log, truth: LogTruth) -> tuple[np.ndarray, np.ndarray] | None:
    """Return lengths of the way by the speed and by the truth, None where one does not tell it."""
    both = _changes(log, truth, "speed", _PLACES) if set(_PLACES) <= set(truth.names) else None
    return None if both is None else (np.abs(both[0]), np.linalg.norm(both[1], axis=1))  # of a way the length alone


def _changes(log: Log, truth: LogTruth, name: str, states: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray] | None:
    """Return integrals (K,) of an input and changes (K, r) of true states between some times, None where there are few."""
    if log.inputs is None or name not in log.inputs.names or len(truth.t) < FEWEST:
        return None
    times = np.linspace(truth.t[0], truth.t[-1], min(_MOST, len(truth.t)))
    changes = np.diff(truth.at(times, ("heading",))[:, [truth.names.index(state) for state in states]], axis=0)
    is_known = np.isfinite(changes).all(axis=1)
    moved = log.inputs.integrals(times)[:, log.inputs.names.index(name)]
    return (moved[is_known], changes[is_known]) if is_known.sum() >= FEWEST else None


def _cosine(first: np.ndarray, second: np.ndarray) -> float:
    """Cosine of the angle between two histories: near 1 where they go up and down together, or against each other; noise does not."""
    sizes = float(np.linalg.norm(first) * np.linalg.norm(second))
    return abs(float(first @ second)) / sizes if sizes > 0 else 0.0


def _ratio(values: np.ndarray, expected: np.ndarray) -> float:
    """Return how many times larger values are; nan where nothing is expected."""
    first, second = (float(np.sum(np.abs(v))) for v in (values, expected))
    return first / second if second > 0 else float("nan")
