"""A path of 100,000 points in every format: seconds to write and to read, size."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.fuzz import sample_track
from benchmarks.tables import FOLDER, machine, table
from obsdesign.exchange.formats import FORMATS, format_of, read_track, write_track

POINTS = 100_000


def measure(word: str, folder: Path) -> tuple[str, float, float, float]:
    """Return the format, CPU seconds to write and to read, megabytes."""
    track, target = sample_track(POINTS), folder / f"x{format_of(word).suffix}"
    write = cpu_seconds(lambda: write_track(track, word, target))
    read = cpu_seconds(lambda: read_track(target))
    files = target.rglob("*") if target.is_dir() else (target,)
    return word, write, read, sum(file.stat().st_size for file in files) / 1e6


def cpu_seconds(work: Callable[[], object]) -> float:
    """Return the CPU time [s] of some work."""
    start = time.process_time()
    work()
    return time.process_time() - start


def main() -> None:
    """Write files.md."""
    with tempfile.TemporaryDirectory() as temporary:
        write_track(sample_track(), "bag", Path(temporary) / "warm_bag")  # loads what is loaded once
        rows = [measure(word, Path(temporary)) for word in FORMATS]
    total = ("all", *(sum(float(row[k]) for row in rows) for k in range(1, 4)))
    text = f"""# A path of {POINTS:,} points in every format

CPU seconds to write and to read it again, and the size of the file.

{table(("format", "write [s]", "read [s]", "size [MB]"), [*rows, total])}

{machine()}
"""
    (FOLDER / "files.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
