"""What a calibration found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from obsdesign.checks import require_known
from obsdesign.display import AbstractDisplay, Summary, number
from obsdesign.dynamics.model import AbstractSystem


@dataclass(frozen=True)
class CalibratedNumber:
    """One number with its 95 % interval, and what it was found from."""

    name: str
    """Such as sigma of beacon_1, scale of the input speed, input_psd of turn_rate."""
    value: float
    """What the system, or its noise, has now."""
    low: float
    """Lower end of the interval [unit]; of a variance that may be 0: 0."""
    high: float
    """Upper end [unit]; inf where the data set none."""
    unit: str
    """Of the three; empty for a factor."""
    source: str
    """truth, innovations, or stated: the data do not tell."""

    @property
    def is_told(self) -> bool:
        """Whether the data tell of it."""
        return self.source != "stated"


@dataclass(frozen=True, eq=False)
class Calibration(AbstractDisplay):
    """A system with the noises, biases and scales that explain a log, each with its interval."""

    system: AbstractSystem
    """The system with what was found of sensors and inputs: readings are scale h(x) + bias, noises those of the log."""
    disturbance_psd: tuple[float, ...]
    """Power spectral density (n,) of the process noise [unit^2/s]."""
    input_psd: Mapping[str, float]
    """Power spectral density of the white noise of known inputs [unit^2 s]."""
    numbers: tuple[CalibratedNumber, ...]
    """All that was asked, in the order of sensors, inputs and states."""
    notes: tuple[str, ...]
    """What the data do not tell, and other remarks, in words."""

    def number(self, name: str) -> CalibratedNumber:
        """Return a number by its name.

        Arguments:
            name: as in `numbers`.
        Raises InputError for other names.
        """
        by_name = {entry.name: entry for entry in self.numbers}
        require_known("calibration", (name,), tuple(by_name))
        return by_name[name]

    def _summary(self) -> Summary:
        rows = [
            (entry.name, f"{number(entry.value, entry.unit)}, {number(entry.low)} to {number(entry.high)} by {entry.source}")
            for entry in self.numbers
            if entry.is_told
        ]
        return Summary(f"calibration: {sum(entry.is_told for entry in self.numbers)} of {len(self.numbers)} numbers told", tuple(rows))
