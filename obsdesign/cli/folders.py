"""Folders that a command writes to."""

from __future__ import annotations

import os
from pathlib import Path

from obsdesign.errors import InputError


def require_writable(folder: Path) -> None:
    """Refuse an unusable folder before a minute of work, without making it."""
    existing = next(folder_or_parent for folder_or_parent in (folder.absolute(), *folder.absolute().parents) if folder_or_parent.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise InputError(f"--out {folder}: {existing} is no folder that can be written to")
