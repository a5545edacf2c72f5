"""Errors of several sensors that belong together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from obsdesign.checks import as_array, require_known
from obsdesign.errors import InputError
from obsdesign.sensors._group import SensorGroup

_Rows = tuple[tuple[float, ...], ...]
_SKEW = 1e-9  # relative difference between R and its transpose that is typing


def as_joint_noise(given: Any, sensors: Mapping[str, SensorGroup]) -> dict[tuple[str, ...], _Rows]:  # noqa: ANN401  # whatever a caller took for it
    """Return names -> R (q, q) as rows, or raise InputError for what does not fit the sensors.

    R must be a covariance, symmetric and positive definite, of the named sensors' stacked outputs; no sensor in two groups, none
    whose noise is correlated in time.
    """
    if not isinstance(given, Mapping):
        raise InputError(f"joint_noise is {given!r}: must be a mapping of sensors' names to the covariance of their stacked outputs")
    covariances: dict[tuple[str, ...], _Rows] = {}
    for names, R in given.items():
        group = _as_group(names, sensors)
        shared = [name for name in group for earlier in covariances if name in earlier]
        if shared:
            raise InputError(f"joint_noise: {shared[0]!r} is in two groups: put all that belongs together into one")
        covariances[group] = _as_covariance(group, R, sum(len(sensors[name].outputs) for name in group))
    return covariances


def _as_group(names: Any, sensors: Mapping[str, SensorGroup]) -> tuple[str, ...]:  # noqa: ANN401
    if not isinstance(names, tuple) or len(names) < 2 or not all(isinstance(name, str) for name in names):
        raise InputError(f"joint_noise has the key {names!r}: must be a tuple of two or more sensors' names")
    require_known("joint_noise: the system", names, tuple(sensors))
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"joint_noise names {name!r} twice in {names!r}")
        if sensors[name].correlation:
            raise InputError(
                f"joint_noise: the noise of {name!r} is correlated in time ({sensors[name].correlation:g}): use one of the two"
            )
    return names


def _as_covariance(names: tuple[str, ...], R: Any, q: int) -> _Rows:  # noqa: ANN401
    what = f"joint_noise of {', '.join(names)}"
    values = as_array(what, R)
    if values.shape != (q, q):
        raise InputError(f"{what} has shape {values.shape}: must be ({q}, {q}) for their stacked outputs")
    if not np.isfinite(values).all():
        position = np.argwhere(~np.isfinite(values))[0]
        raise InputError(f"{what}[{position[0]}, {position[1]}] is {values[tuple(position)]}: must be finite")
    size = np.sqrt(np.abs(np.outer(np.diag(values), np.diag(values))))
    if np.any(np.abs(values - values.T) > _SKEW * size):
        raise InputError(f"{what} differs from its transpose: must be symmetric")
    values = (values + values.T) / 2
    if not (np.diag(values) > 0).all() or not np.linalg.eigvalsh(values / size)[0] > q * np.finfo(float).eps:
        raise InputError(f"{what} is no covariance: must be positive definite")
    return tuple(map(tuple, values.tolist()))
