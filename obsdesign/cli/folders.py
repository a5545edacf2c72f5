"""Files and folders that a command reads and writes."""

from __future__ import annotations

import os
from pathlib import Path

from obsdesign.errors import InputError


def require_writable(folder: Path) -> None:
    """Refuse an unusable folder before a minute of work, without making it."""
    existing = next(folder_or_parent for folder_or_parent in (folder.absolute(), *folder.absolute().parents) if folder_or_parent.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise InputError(f"--out {folder}: {existing} is no folder that can be written to")


def path_file(given: Path) -> Path:
    """Return the file of a path: the one that is given, or that of the run whose folder is."""
    return given / "trajectory.csv" if given.is_dir() else given


def is_log(file: Path) -> bool:
    """Whether a file is a log: any but a CSV table, and of those all that have no column x, the first state of every path."""
    if file.is_dir() or not file.exists():
        return False
    if file.suffix.lower() != ".csv":
        return True
    with file.open(encoding="utf-8", errors="replace") as lines:
        names = [name.partition("[")[0].strip() for name in lines.readline().split(",")]
    return "x" not in names


def scenario_file(given: Path | None) -> Path:
    """Return the scenario that is given, or the one in this folder. Raises InputError where there is none, or several."""
    if given is not None:
        return given
    files = [file for file in sorted(Path().glob("*.toml")) if _is_scenario(file)]
    if not files:
        raise InputError("there is no scenario in this folder: name one, or let `obsdesign init` write one")
    if len(files) > 1:
        raise InputError(f"there are {len(files)} scenarios in this folder: name one of {', '.join(map(str, files))}")
    return files[0]


def _is_scenario(file: Path) -> bool:
    """Whether a TOML file has what every scenario has; one that is not TOML may be a scenario with a mistake."""
    import tomllib

    try:
        data = tomllib.loads(file.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError:
        return True
    except (OSError, UnicodeDecodeError):
        return False
    return any(key in data for key in ("vehicle", "sensors", "system"))
