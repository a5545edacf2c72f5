"""Tables in Markdown, and what a measurement was made on."""

from __future__ import annotations

import os
import platform
import resource
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a Markdown table; numbers are aligned to the right."""
    cells = [[_shown(cell) for cell in row] for row in rows]
    align = [":--" if all(isinstance(row[j], str) for row in rows) else "--:" for j in range(len(header))]
    lines = [header, align, *cells]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _shown(cell: object) -> str:
    if isinstance(cell, float):
        return f"{cell:.3g}" if abs(cell) < 100 else f"{cell:.0f}"
    return str(cell)


def machine() -> str:
    """Return what was used, in one line."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("casadi", "python-flint", "numpy"))
    return (
        f"Python {platform.python_version()}, {packages}; {os.cpu_count()} cores, one used. Seconds vary with the machine by a factor of 2."
    )


def peak_memory() -> float:
    """Return the peak resident memory of this process [MB]."""
    status = Path("/proc/self/status")
    if status.exists():  # on Linux a new process starts with its parent's ru_maxrss
        return next(float(line.split()[1]) for line in status.read_text().splitlines() if line.startswith("VmHWM:")) / 2**10
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """Return p of seconds = c sizes^p, fitted by least squares."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def write(name: str, text: str) -> None:
    """Write benchmarks/<name>.md and print it."""
    (FOLDER / f"{name}.md").write_text(text.rstrip() + "\n", encoding="utf-8")
    sys.stdout.write(text + "\n")
