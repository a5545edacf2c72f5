"""Writing files: all or none."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from obsdesign.errors import InputError


def write_files(folder: Path, contents: Mapping[str, str]) -> None:
    """Write text files into a folder; see write_all."""
    write_all(folder, {name: partial(_write_text, content) for name, content in contents.items()})


def write_all(folder: Path, writers: Mapping[str, Callable[[Path], object]]) -> None:
    """Write files, or folders, into a folder, made where there is none: under temporary names in it, which are changed at the end.

    writers: what writes each name to the path that it is given. A file takes the place of a file, a folder of files that of one with the
    same names of files. Raises InputError for what cannot be written, and for folders that would be lost.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".partial-", dir=folder) as temporary:
            for name, write in writers.items():
                write(Path(temporary) / name)
                _require_replaceable(folder / name, Path(temporary) / name)
            for name in writers:
                if (folder / name).is_dir():
                    (folder / name).rename(Path(temporary) / f"{name}.before")
                (Path(temporary) / name).replace(folder / name)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None


def _write_text(content: str, file: Path) -> None:
    file.write_text(content, encoding="utf-8", newline="")


def _require_replaceable(target: Path, written: Path) -> None:
    """Refuse to put a file, or a folder with other names in it, in the place of a folder."""
    if not target.is_dir():
        return
    kept = {file.name for file in target.iterdir()} - ({file.name for file in written.iterdir()} if written.is_dir() else set())
    if target.is_symlink() or not written.is_dir() or kept:
        holds = f" that holds {min(kept)}" if kept else ""
        raise InputError(f"{target}: is a folder{holds}: it is left as it is; name another target")
