"""A path of 100,000 points in every format: seconds to write and to read, size."""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.fuzz import sample_track
from benchmarks.tables import FOLDER, machine, table
from obsdesign.exchange.formats import FORMATS, format_of, read_track, write_track

POINTS = 100_000


_NUMBER = re.compile(rb"[-+]?\d*\.\d+(?:[eE][-+]?\d+)?|\d+")


def measure(word: str, folder: Path) -> tuple[str, float, float, float, float]:
    """Return the format, CPU seconds to write and to read, megabytes, and millions of numbers that stand in it as text."""
    track, target = sample_track(POINTS), folder / f"x{format_of(word).suffix}"
    write = cpu_seconds(lambda: write_track(track, word, target))
    read = cpu_seconds(lambda: read_track(target))
    files = target.rglob("*") if target.is_dir() else (target,)
    is_binary = word in ("bag", "npz")
    numbers = 0 if is_binary else len(_NUMBER.findall(target.read_bytes())) / 1e6
    return word, write, read, sum(file.stat().st_size for file in files) / 1e6, numbers


def text_seconds(millions: float) -> tuple[float, float]:
    """Return the CPU time [s] that Python takes to turn so many numbers into text, and back, in one call each."""
    values = np.random.default_rng(0).normal(size=round(millions * 1e6)).tolist()
    texts: list[str] = []
    return cpu_seconds(lambda: texts.extend(map("%.9f".__mod__, values))), cpu_seconds(lambda: list(map(float, texts)))


def cpu_seconds(work: Callable[[], object]) -> float:
    """Return the CPU time [s] of some work."""
    start = time.process_time()
    work()
    return time.process_time() - start


def main() -> None:
    """Write files.md."""
    with tempfile.TemporaryDirectory() as temporary:
        for word in FORMATS:  # loads what is loaded once
            read_track(write_track(sample_track(), word, Path(temporary) / f"warm{format_of(word).suffix}")[0])
        rows = [measure(word, Path(temporary)) for word in FORMATS]
    floor = text_seconds(sum(row[4] for row in rows))
    total = ("all", *(sum(float(row[k]) for row in rows) for k in range(1, 5)))
    text = f"""# A path of {POINTS:,} points in every format

CPU seconds to write and to read it again, the size of the file, and how many numbers stand in it as text.

{table(("format", "write [s]", "read [s]", "size [MB]", "numbers [10^6]"), [*rows, total])}

Python's own conversion of that many numbers, and nothing else, takes {floor[0]:.2f} s to text and {floor[1]:.2f} s back. What is above
that is an object of JSON for each point (plan), an element of XML for each point and each of its parts (KML, GPX: of GPX the parser in C
takes half), a row of SQLite for each pose (bag), and the text itself.

{machine()}
"""
    (FOLDER / "files.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
