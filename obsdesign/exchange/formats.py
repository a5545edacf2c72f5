"""All formats of paths by the word that names them, and reading and writing by that word."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from obsdesign.errors import InputError
from obsdesign.exchange.abstract import AbstractFormat, collection_deferred
from obsdesign.exchange.bag import RosBag
from obsdesign.exchange.csv_table import CsvTable
from obsdesign.exchange.czml import Czml
from obsdesign.exchange.geojson import GeoJson
from obsdesign.exchange.gpx import Gpx
from obsdesign.exchange.kml import Kml
from obsdesign.exchange.mission import AbstractMission, Switches, sensors_table
from obsdesign.exchange.npz import NumpyArchive
from obsdesign.exchange.plan import QgcPlan
from obsdesign.exchange.track import Track
from obsdesign.exchange.tum import TumTrajectory
from obsdesign.exchange.waypoint_text import WaypointText
from obsdesign.files import write_all
from obsdesign.study.thinned_path import Autopilot

FORMATS: dict[str, type[AbstractFormat]] = {
    "plan": QgcPlan,
    "wpl": WaypointText,
    "kml": Kml,
    "gpx": Gpx,
    "geojson": GeoJson,
    "czml": Czml,
    "tum": TumTrajectory,
    "bag": RosBag,
    "csv": CsvTable,
    "npz": NumpyArchive,
}


def format_of(word: str, autopilot: Autopilot = "px4", switches: Switches = ()) -> AbstractFormat:
    """Return the format that a word names; raise InputError for a word that names none."""
    if word not in FORMATS:
        raise InputError(f"format is {word!r}: must be one of {', '.join(FORMATS)}")
    kind = FORMATS[word]
    return kind(autopilot, switches) if issubclass(kind, AbstractMission) else kind()


def write_track(track: Track, word: str, target: Path, autopilot: Autopilot = "px4", switches: Switches = ()) -> tuple[Path, ...]:
    """Write a track in the format that a word names, whole or not at all; return what was written.

    Beside a mission a table tells which sensors are on when, and from which item on. Raises InputError for what cannot be written.
    """
    kind = format_of(word, autopilot, switches)
    table = sensors_table(track, autopilot, switches) if kind.is_mission else ""
    writers: dict[str, Callable[[Path], object]] = {target.name: lambda file: kind.write(track, file)}
    if table:
        writers[f"{target.name}.sensors.csv"] = lambda file: file.write_text(table, encoding="utf-8", newline="")
    with collection_deferred():
        write_all(target.parent, writers)
    return tuple(target.with_name(name) for name in writers)


def read_track(file: Path, word: str | None = None) -> Track:
    """Read a path in the format that a word names, or by the end of its name; raise InputError for what is none."""
    if word is None:
        named = [name for name, kind in FORMATS.items() if file.name.endswith(kind().suffix)]
        if not named:
            endings = ", ".join(kind().suffix for kind in FORMATS.values())
            raise InputError(f"{file}: its name ends with none of {endings}: name the format ({', '.join(FORMATS)})")
        word = named[0]
    return format_of(word).read(file)
