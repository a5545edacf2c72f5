"""Gradients of a criterion with respect to all controls, against the value alone."""

from __future__ import annotations

from functools import partial

import numpy as np

import obsdesign as od
from benchmarks.scene import START, STEP, controls, dubins
from benchmarks.tables import table
from benchmarks.timing import MODES, Subject, judged, mode, ratios, timed


def gradients() -> list[str]:
    """Value and gradient with respect to 200 turn rates, against the value alone."""
    u = controls(200)[:, 1:]
    rows = [row for criterion in (od.LogDet(), od.MinEigenvalue()) for row in _gradient_rows(criterion, u)]
    header = ("criterion", "loops", "/ three verbs", "best", "/ information_value", "best", "ms", "best ms", "to central differences")
    return [
        "Dubins vehicle in constant wind, the same four sensors, 200 steps and turn rates. Ratios are gradient / value: of `simulate`,",
        "`variational_gramian` and `criterion.value`, and of `information_value`, which does nothing else. Bar: <= 5, both.",
        "",
        table(header, rows),
    ]


def _value(system: od.System, criterion: od.LogDet | od.MinEigenvalue, u: np.ndarray) -> float:
    path = od.simulate(system, START, u, STEP)
    return criterion.value(od.variational_gramian(system, path).total)


def _gradient_rows(criterion: od.LogDet | od.MinEigenvalue, u: np.ndarray) -> list[tuple]:
    rows = []
    for name in MODES:
        system = dubins(name)
        calls = {
            "gradient": partial(od.information_gradient, system, START, u, STEP, criterion),
            "verbs": partial(_value, system, criterion, u),
            "value": partial(od.information_value, system, START, u, STEP, criterion),
        }
        times = timed({what: Subject(call, partial(mode, name)) for what, call in calls.items()})
        with mode(name):
            difference = _gradient_difference(system, criterion, u)
        quotients = [value for other in ("verbs", "value") for value in ratios(times["gradient"], times[other])]
        rows.append((type(criterion).__name__, name, *quotients, *times["gradient"].milliseconds, judged(difference, 1e-5)))
    return rows


def _gradient_difference(system: od.System, criterion: od.LogDet | od.MinEigenvalue, u: np.ndarray, eps: float = 1e-3) -> float:
    """Largest difference to central differences, relative to the largest entry."""
    _, gradient = od.information_gradient(system, START, u, STEP, criterion)
    slopes = np.empty_like(u)
    for k in range(len(u)):
        kick = np.zeros_like(u)
        kick[k] = eps
        ahead, behind = (od.information_value(system, START, u + side * kick, STEP, criterion) for side in (1, -1))
        slopes[k] = (ahead - behind) / (2 * eps)
    return float(np.abs(gradient - slopes).max() / np.abs(slopes).max())
