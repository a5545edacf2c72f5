"""Readers under files that atheris makes: from a valid file on, changes that reach new lines are changed further.

`python -m benchmarks.guided_fuzz READER INPUTS FILE` feeds one reader and writes its tally: libFuzzer ends the process that it runs in.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from benchmarks.tables import FOLDER, machine, table

INPUTS = 30_000
READERS = ("plan", "wpl", "kml", "gpx", "geojson", "czml", "tum", "bag", "csv", "npz", "trajectory.csv", "scenario")


def feed_reader(name: str, inputs: int, told: Path) -> None:
    """Feed one reader, write its tally to a file, and end the process."""
    import atheris

    with atheris.instrument_imports(include=["obsdesign"]):
        from benchmarks import fuzz

        read, place, content = fuzz.cases()[name]
    folder, corpus = Path(tempfile.mkdtemp(dir=told.parent)), Path(tempfile.mkdtemp(dir=told.parent))
    (corpus / "valid").write_bytes(content)
    counts = fuzz.Tally()

    def feed(data: bytes) -> None:
        nonlocal counts
        if counts.inputs == 0:
            fuzz.listen()
        counts = fuzz.observe(counts, read, place(folder, data), folder)
        if counts.inputs == inputs:
            told.write_text(json.dumps(asdict(counts)), encoding="utf-8")

    options = (f"-runs={inputs + 10}", "-seed=1", f"-max_len={max(20_000, 4 * len(content))}", "-timeout=0", "-verbosity=0")
    atheris.Setup([name, *options, str(corpus)], feed)
    atheris.Fuzz()


def measure(name: str, inputs: int) -> tuple[object, ...]:
    """Return the row of a reader, from a process of its own, and the exceptions that it met."""
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "tally.json"
        subprocess.run([sys.executable, "-m", "benchmarks.guided_fuzz", name, str(inputs), str(told)], capture_output=True, check=False)
        counts = json.loads(told.read_text(encoding="utf-8"))
    faults = counts["faults"]
    for fault in dict.fromkeys(faults):
        sys.stderr.write(f"{name}: {fault}\n")
    done = counts["read"] + counts["refused"] + len(faults) + counts["hangs"]
    return name, done, counts["read"], counts["refused"], len(faults), counts["hangs"], counts["written"], round(counts["longest"] * 1000)


def main() -> None:
    """Write guided_fuzz.md."""
    share = -(-INPUTS // len(READERS))
    rows = [measure(name, share) for name in READERS]
    header = ("reader", "inputs", "read", "refused by name", "other exceptions", "hangs", "files written", "longest [ms]")
    total = ("all", *(sum(int(str(row[k])) for row in rows) for k in range(1, 7)), max(int(str(row[7])) for row in rows))
    text = f"""# Readers under files that atheris makes

Inputs are made by libFuzzer (atheris {version("atheris")}, seed 1) from a valid file: what reaches lines of obsdesign that no input
reached before is changed further. What a reader may do, and what is counted, is as in `fuzz.md`.

{table(header, [*rows, total])}

{machine()}
"""
    (FOLDER / "guided_fuzz.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:]:
        feed_reader(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
    else:
        main()
