"""What a window does not see: by the sensors that answered in it, and by the way the vehicle moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.analysis.null_space_text import hidden_in_words
from obsdesign.analysis.query import observability
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.errors import ObsdesignError

_NOTHING_LEARNED = 1e-4  # information, over that of the prior, below which a direction counts as hidden: a hundred standard deviations
_NEGLIGIBLE_SHARE = 1e-3  # of a direction, in standard deviations of the prior: no part of the sentence
_MAX_VERDICTS = 64  # sets of sensors that are asked about


@dataclass(frozen=True)
class ArrivedSensors(AbstractSystem):
    """A system with some of its sensors alone."""

    system: AbstractSystem
    """The system with all of them."""
    sensors: tuple[str, ...]
    """Names of those that answered."""

    def _build(self) -> Model:
        return self.system.model.only(self.sensors)


def hidden_in_windows(system: AbstractSystem, gramians: np.ndarray, counts: np.ndarray, starts: np.ndarray, std: np.ndarray) -> list[str]:
    """Return for each of K windows what it does not see, in words; "" where all is seen.

    gramians (K, n, n) about the states starts (K, n); counts (K, S) of the samples that arrived; std (n,) of the prior.
    """
    verdicts = _verdicts(system, counts > 0)
    return [_words(system, *row, std, verdicts) for row in zip(gramians, counts, starts, strict=True)]


def _words(
    system: AbstractSystem, W: np.ndarray, counts: np.ndarray, start: np.ndarray, std: np.ndarray, verdicts: dict[tuple[bool, ...], str]
) -> str:
    if not counts.any():
        return "nothing is seen: no sample arrived"
    generic = verdicts.get(tuple(counts > 0), "")
    if generic:
        return generic
    values, vectors = np.linalg.eigh(W * std * std[:, None])
    hidden = vectors[:, values < _NOTHING_LEARNED]
    if not hidden.shape[1]:
        return ""
    hidden = np.where(np.abs(hidden) > _NEGLIGIBLE_SHARE * np.abs(hidden).max(axis=0), hidden, 0.0)
    number = int(counts.sum())
    cause = f"of {number} sample{'' if number == 1 else 's'}" if number < len(start) else "on this motion"
    try:
        return f"{cause}: {hidden_in_words(system.model, hidden * std[:, None], start)}"
    except ObsdesignError:
        return f"{cause}: {hidden.shape[1]} directions of the state"


def _verdicts(system: AbstractSystem, arrived: np.ndarray) -> dict[tuple[bool, ...], str]:
    """Return what sets of sensors (K, S) hide, whatever the motion, largest sets first: more sensors see no less."""
    sets = sorted({tuple(map(bool, row)) for row in arrived if row.any()}, key=lambda on: -sum(on))
    results: dict[tuple[bool, ...], str] = {}
    complete: list[np.ndarray] = []
    asked = 0
    for on in reversed(sets):  # the smallest ones tell most
        if any((~seen | np.array(on)).all() for seen in complete) or asked >= _MAX_VERDICTS:
            continue
        asked += 1
        try:
            verdict = observability(ArrivedSensors(system, tuple(np.array(system.model.sensor_names)[list(on)])))
        except ObsdesignError:
            continue
        if verdict.observable:
            complete.append(np.array(on))
        elif verdict.decided:
            results[on] = verdict.hidden
    return results
