"""Writing files: all or none."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

from obsdesign.errors import InputError


def write_files(folder: Path, contents: Mapping[str, str]) -> None:
    """Write text files into a folder, made where there is none: under temporary names in the folder, which are changed at the end.

    Raises InputError for a folder that cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".partial-", dir=folder) as partial:
            for name, content in contents.items():
                (Path(partial) / name).write_text(content, encoding="utf-8", newline="")
            for name in contents:
                (Path(partial) / name).replace(folder / name)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
