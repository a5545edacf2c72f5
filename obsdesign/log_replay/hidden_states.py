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
    """Return what sets of sensors (K, S) hide, whatever the motion; sets that hide nothing are left out.

    More sensors see no less: a set is asked about where it holds none that sees all, and a few of its sensors before all of them.
    """
    results: dict[tuple[bool, ...], str] = {}
    complete: list[frozenset[str]] = []
    names, asked = np.array(system.model.sensor_names), 0
    for on in sorted({tuple(map(bool, row)) for row in arrived if row.any()}, key=sum):
        sensors = tuple(names[list(on)])
        for part in dict.fromkeys((sensors[:2], sensors[:4], sensors)):
            if any(seen <= set(sensors) for seen in complete) or asked >= _MAX_VERDICTS:
                break
            asked += 1
            hidden = _hidden_from(system, part)
            if hidden == "":
                complete.append(frozenset(part))
            elif part == sensors and hidden is not None:
                results[on] = hidden
    return results


def _hidden_from(system: AbstractSystem, sensors: tuple[str, ...]) -> str | None:
    """Return what some sensors hide, "" for nothing, None where that is not decided."""
    try:
        verdict = observability(ArrivedSensors(system, sensors))
    except ObsdesignError:
        return None
    return "" if verdict.observable else verdict.hidden if verdict.decided else None
