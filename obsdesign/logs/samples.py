"""Samples of sensors as they were recorded: when, by which sensor, what, and how exact where the log says so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array
from obsdesign.errors import InputError
from obsdesign.logs.inputs import distinct_names


@validate_arguments
@dataclass(frozen=True, eq=False)
class LogSamples:
    """Samples, given in any order, several at one time or not; sorted by time here, those of one time as they were given.

    Raises InputError for shapes that do not fit, times and values that are not finite, and standard deviations not above 0.
    """

    names: tuple[str, ...]
    """Names of the sensors that the log knows."""
    t: np.ndarray
    """Times (K,) [s] of the samples."""
    sensor: np.ndarray
    """Of which sensor each sample is (K,), as its place in `names`."""
    y: np.ndarray
    """Values (K, q) in the units of the outputs, q the most outputs that a sensor has, nan beyond those of the sample's own sensor;
    (K,) for one output each."""
    sigma: np.ndarray | None = None
    """Standard deviation (K,) of each sample in the unit of its outputs, where the log tells it, else nan: the sensor's; None = nowhere."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", distinct_names("sensors", self.names))
        t, sensor, y = (as_array(f"log: samples {name}", getattr(self, name)) for name in ("t", "sensor", "y"))
        y = y[:, None] if y.ndim == 1 else y
        sigma = np.full(len(t) if t.ndim else 1, np.nan) if self.sigma is None else as_array("log: samples sigma", self.sigma)
        if t.ndim != 1 or sensor.shape != t.shape or y.ndim != 2 or len(y) != len(t) or sigma.shape != t.shape:
            raise InputError(
                f"log: samples t {t.shape}, sensor {sensor.shape}, y {y.shape} and sigma {sigma.shape} do not fit:"
                " must be (K,), (K,), (K, q) and (K,)"
            )
        _require_places(sensor, self.names)
        for what, wrong, accepted in (
            ("t", ~np.isfinite(t), "finite"),
            ("y", ~np.isfinite(y[:, :1]).all(axis=1) | np.isinf(y).any(axis=1), "finite, nan beyond the outputs of its sensor"),
            ("sigma", ~(np.isnan(sigma) | (sigma > 0)) | np.isinf(sigma), "above 0, or nan for the sensor's own"),
        ):
            if wrong.any():
                row = int(np.argmax(wrong))
                value = {"t": t, "y": y, "sigma": sigma}[what][row]
                raise InputError(f"log: samples {what}[{row}] ({self.names[int(sensor[row])]}) is {value}: must be {accepted}")
        order = np.argsort(t, kind="stable")
        for name, value in (("t", t), ("sensor", sensor.astype(int)), ("y", y), ("sigma", sigma)):
            ordered = value[order]
            ordered.setflags(write=False)
            object.__setattr__(self, name, ordered)

    @property
    def counts(self) -> dict[str, int]:
        """Number of samples of each sensor."""
        return dict(zip(self.names, np.bincount(self.sensor, minlength=len(self.names)).tolist(), strict=True))

    def where(self, chosen: np.ndarray) -> LogSamples:
        """Return the samples that are chosen (K,)."""
        sigma = None if self.sigma is None else self.sigma[chosen]
        return LogSamples(self.names, self.t[chosen], self.sensor[chosen], self.y[chosen], sigma)

    def only(self, names: Sequence[str]) -> LogSamples:
        """Return the samples of the named sensors alone."""
        return self.where(np.isin(self.sensor, [i for i, name in enumerate(self.names) if name in names]))


def _require_places(sensor: np.ndarray, names: tuple[str, ...]) -> None:
    wrong = ~((sensor >= 0) & (sensor < len(names)) & (sensor == np.round(sensor)))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(f"log: samples sensor[{row}] is {sensor[row]:g}: must be a place in {names}, from 0 to {len(names) - 1}")
