"""From a file to a log, or to a list of what is in it, whatever its format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from obsdesign.arguments import validate_arguments
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.errors import InputError
from obsdesign.logs.csv_tables import read_csv_log, read_csv_recording
from obsdesign.logs.dataflash import read_dataflash
from obsdesign.logs.log import Log
from obsdesign.logs.npz import map_npz, read_npz
from obsdesign.logs.plausibility import require_plausible
from obsdesign.logs.recording import Recording
from obsdesign.logs.rosbag import read_rosbag
from obsdesign.logs.series import FileContents, log_of
from obsdesign.logs.topic_map import load_topic_map, map_topics
from obsdesign.logs.ulog import read_ulog

_RECORDINGS: dict[str, Callable[[Path], Recording]] = {
    ".csv": read_csv_recording,
    ".npz": read_npz,
    ".ulg": read_ulog,
    ".bin": read_dataflash,
    ".log": read_dataflash,
    ".bag": read_rosbag,
    ".db3": read_rosbag,
    ".mcap": read_rosbag,
}


@validate_arguments
def read_log(file: str | Path, system: AbstractSystem, topics: str | Path | None = None) -> Log:
    """Read a recorded run: CSV, NPZ, PX4 ULog, ArduPilot dataflash, or a ROS bag.

    Nothing is resampled; units that the file names are turned into the system's, Unix times into seconds since `epoch`. Geodetic
    positions become metres east (x) and north (y) of an origin that the notes name.

    Arguments:
        file: the file, or the folder of a ROS 2 bag.
        system: vehicle and sensors, whose inputs, sensors and states the log's names are.
        topics: a TOML file that says which topics and fields are inputs, sensors and truth; for all formats but CSV and NPZ, whose
            names may be the system's own.
    Raises InputError, naming file, row and column, for what cannot be read or meant; MissingPackageError where the format's reader is
    not installed.
    """
    file = Path(file)
    contents = _contents(file, system, None if topics is None else Path(topics))
    log = log_of(system.model, contents)
    require_plausible(file, system, log)
    return log


@validate_arguments
def read_recording(file: str | Path) -> Recording:
    """Return what is in a file of any format: its topics, their fields, numbers and times.

    Arguments:
        file: the file, or the folder of a ROS 2 bag.
    Raises InputError for a file that cannot be read or is of no known format; MissingPackageError where the reader is not installed.
    """
    file = Path(file)
    return _reader(file)(file)


def _contents(file: Path, system: AbstractSystem, topics: Path | None) -> FileContents:
    if topics is not None:
        return map_topics(read_recording(file), load_topic_map(topics), system.model)
    if file.suffix.lower() == ".csv":
        return read_csv_log(file, system.model)
    if file.suffix.lower() == ".npz":
        return map_npz(read_npz(file), system.model)
    recording = read_recording(file)
    raise InputError(
        f"{file}: a {recording.format} needs `topics`, a TOML file that says which of its topics are inputs, sensors and truth;"
        f" `obsdesign log {file.name}` lists them"
    )


def _reader(file: Path) -> Callable[[Path], Recording]:
    if not file.exists():
        raise InputError(f"{file}: there is no such file")
    if file.is_dir():
        return read_rosbag
    suffix = file.suffix.lower()
    if suffix not in _RECORDINGS:
        raise InputError(f"{file}: a name that ends in {suffix!r} is of no known format (known: {', '.join(_RECORDINGS)}, a ROS 2 folder)")
    return _RECORDINGS[suffix]
