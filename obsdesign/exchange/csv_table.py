"""A path as a table that every program reads: time, metres, headings, degrees, sensors."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from obsdesign.errors import InputError
from obsdesign.exchange.abstract import AbstractFormat, Precision, read_text
from obsdesign.exchange.geodesy import geodetic
from obsdesign.exchange.track import Track, about_text, read_about

_LOCAL = ("t [s]", "east [m]", "north [m]", "up [m]")
_HEADING, _ABOUT = "heading [rad]", "about"
_GEODETIC = ("latitude [deg]", "longitude [deg]", "altitude [m]")


@dataclass(frozen=True)
class CsvTable(AbstractFormat):
    """A header and a row per point; a column of 0 and 1 for each sensor; `about` stands in the first row only."""

    @property
    def suffix(self) -> str:
        """.csv."""
        return ".csv"

    @property
    def precision(self) -> Precision:
        """Exact: every number with all its digits."""
        return Precision(0.0, 0.0, 0.0)

    @property
    def is_mission(self) -> bool:
        """Points in time."""
        return False

    def write(self, track: Track, target: Path) -> None:
        """Write the table."""
        columns: dict[str, np.ndarray] = dict(zip(_LOCAL, (track.t, *track.position.T), strict=True))
        if track.heading is not None:
            columns[_HEADING] = track.heading
        if track.origin is not None:
            columns |= dict(zip(_GEODETIC, geodetic(track, "csv").T, strict=True))
        rows = [list(map(repr, column.tolist())) for column in columns.values()]
        heads = [*columns]
        if track.sensors is not None:
            segments = np.clip(np.searchsorted(track.sensors.t, track.t, side="right") - 1, 0, len(track.sensors.chosen) - 1)
            rows += [list(map(str, on.tolist())) for on in track.sensors.chosen[segments].astype(int).T]
            heads += [f"{name} on" for name in track.sensors.names]
        text, (first, *others) = io.StringIO(), map(",".join, zip(*rows, strict=True))
        csv.writer(text, lineterminator="\n").writerow([*heads, _ABOUT])
        text.write(f"{first},")
        csv.writer(text, lineterminator="\n").writerow([about_text(track)])
        text.write("".join(f"{row},\n" for row in others))
        target.write_text(text.getvalue(), encoding="utf-8", newline="")

    def parse(self, file: Path) -> Track:
        """Return the track of such a table: t, east, north, up, and heading where it is there."""
        try:
            header, *rows = csv.reader(io.StringIO(read_text(file)))
        except csv.Error as error:
            raise InputError(f"{file}: is no table: {error}") from None
        missing = [name for name in _LOCAL if name not in header]
        if missing:
            raise InputError(f"{file}, line 1: no column {missing[0]!r} (accepted: {', '.join((*_LOCAL, _HEADING))})")
        names = (*_LOCAL, *((_HEADING,) if _HEADING in header else ()))
        places = [header.index(name) for name in names]
        values = np.array([[float(row[place]) for row in rows if row] for place in places]).T
        about = read_about(rows[0][header.index(_ABOUT)] if _ABOUT in header else None)
        heading = values[:, 4] if len(names) == 5 else None
        return Track(values[:, 0], values[:, 1:4], heading, about.origin, about.epoch, about.sensors, file.stem)
