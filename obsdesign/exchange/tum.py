"""The trajectory format of the TUM benchmark: t x y z qx qy qz qw, one row per pose, as evo and others read it."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from obsdesign.calculus import yaw
from obsdesign.errors import InputError
from obsdesign.exchange.abstract import AbstractFormat, Precision, number_rows, read_text
from obsdesign.exchange.track import Track, about_text, read_about

_COLUMNS = 8


@dataclass(frozen=True)
class TumTrajectory(AbstractFormat):
    """Rows of t [s], position [m, east north up] and attitude (unit quaternion, x y z w), after comments that begin with #."""

    @property
    def suffix(self) -> str:
        """.tum."""
        return ".tum"

    @property
    def precision(self) -> Precision:
        """Nine decimals."""
        return Precision(1e-9, 1e-9, 1e-8)

    @property
    def is_mission(self) -> bool:
        """Points in time."""
        return False

    def write(self, track: Track, target: Path) -> None:
        """Write one row per point; where the heading is not told the nose points along the course."""
        half, zeros = track.nose / 2, np.zeros(len(track.t))
        if (np.diff(np.round(track.t, 9)) <= 0).any():
            raise InputError("path: times must be at least 1 ns apart for a TUM trajectory")
        rows = np.column_stack([track.t, track.position, zeros, zeros, np.sin(half), np.cos(half)])
        text = io.StringIO()
        text.write(f"# {about_text(track)}\n# timestamp tx ty tz qx qy qz qw\n")
        line = " ".join(["%.9f"] * _COLUMNS) + "\n"
        text.write((line * len(rows)) % tuple(rows.ravel().tolist()))
        target.write_text(text.getvalue(), encoding="ascii", newline="\n")

    def parse(self, file: Path) -> Track:
        """Return the track: its headings are those of the body's x axis, seen from above."""
        lines = read_text(file).splitlines()
        about = next((line[1:].strip() for line in lines if line.startswith('# {"')), None)
        values = number_rows("row", [line for line in lines if line.strip() and not line.lstrip().startswith("#")])
        if values.shape[1] != _COLUMNS:
            raise InputError(f"row 1 has {values.shape[1]} numbers: must have {_COLUMNS}, t x y z qx qy qz qw")
        if np.abs(values[:, 4:]).max() > 2 or not (np.abs(np.linalg.norm(values[:, 4:], axis=1) - 1) < 1e-3).all():
            raise InputError("a quaternion is not of length 1")
        beside = read_about(about)
        return Track(values[:, 0], values[:, 1:4], yaw(*values[:, 4:].T), beside.origin, beside.epoch, beside.sensors, file.stem)
