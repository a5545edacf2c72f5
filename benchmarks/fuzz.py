"""Readers under broken files: seeded changes of valid ones. What is no answer and no InputError, what hangs, what is written."""

from __future__ import annotations

import hashlib
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType

import numpy as np

import obsdesign as od
from benchmarks.tables import FOLDER, machine, table
from obsdesign.errors import ObsdesignError
from obsdesign.exchange.formats import FORMATS, format_of, write_track
from obsdesign.exchange.track import GeodeticOrigin, SensorTimes, Track
from obsdesign.exchange.trajectory_csv import read_trajectory_csv, trajectory_csv

INPUTS = 100_000
LONGEST = 10.0  # [s] that a reader may take
_SYSTEM = od.System(od.Dubins(5.0), (od.GPS(1.0),))
_SCENARIO = Path(__file__).parent.parent / "scenarios" / "aerosonde_wind.toml"
_WORDS = (
    *b"NaN -1 0 1e999 -Infinity null true [] {} 91 181 1e308 9999999999999999999999 1970-01-01T00:00:00Z 0000-00-00".split(b" "),
    *b"&lt; &#0; <!ENTITY , ; < > & ' # ]]> <![CDATA[ 1_0 0x10 inf = [[ -0.0 2147483648 1e-320".split(b" "),
    *(b"\x00", b"\xff\xfe", b"\n", b"\t", b" ", b'"'),
)


@dataclass(frozen=True)
class Tally:
    """What a reader made of broken files: how many it read, refused, met with another exception; hangs, files written, longest [s]."""

    read: int = 0
    refused: int = 0
    faults: tuple[str, ...] = ()
    hangs: int = 0
    written: int = 0
    longest: float = 0.0

    @property
    def inputs(self) -> int:
        """How many files there were."""
        return self.read + self.refused + len(self.faults) + self.hangs


class _TooLong(BaseException):
    """A reader takes longer than it may: not for it to catch."""


def mutants(content: bytes, count: int, seed: int) -> Iterator[bytes]:
    """Yield changed copies: bytes changed, taken out, repeated, put elsewhere, words put in, numbers exchanged, ends cut off."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        data = bytearray(content)
        for _ in range(int(random.integers(1, 6))):
            _change(data, random)
        yield bytes(data)


def _change(data: bytearray, random: np.random.Generator) -> None:
    size = max(len(data), 1)
    at, length = int(random.integers(size)), int(random.geometric(0.1))
    kind = int(random.integers(7))
    if kind == 0:
        data[at : at + 1] = bytes([int(random.integers(256))])
    elif kind == 1:
        del data[at : at + length]
    elif kind == 2:
        data[at:at] = data[at : at + length] * int(random.integers(1, 20))
    elif kind == 3:
        other = int(random.integers(size))
        data[at:at] = data[other : other + length]
    elif kind == 4:
        data[at : at + int(random.integers(0, 4))] = _WORDS[int(random.integers(len(_WORDS)))]
    elif kind == 5:
        data[at : at + 8] = int(random.integers(0, 2**63)).to_bytes(8, "little")
    else:
        del data[max(at, size // 2 if random.random() < 0.8 else 0) :]


def tally(read: Callable[[Path], object], place: Callable[[Path, bytes], Path], inputs: Iterator[bytes]) -> Tally:
    """Return what a reader made of the inputs; place: puts one into a folder and returns what is to be read."""
    listen()
    counts = Tally()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for data in inputs:
            counts = observe(counts, read, place(folder, data), folder)
    return counts


def listen() -> None:
    """Let a reader be interrupted that takes too long."""
    signal.signal(signal.SIGALRM, _interrupt)


def observe(counts: Tally, read: Callable[[Path], object], target: Path, folder: Path) -> Tally:
    """Return the counts with one more input; folder: all that may be there, which is emptied when something was written."""
    before, start = _state(folder), time.perf_counter()
    counts = _attempt(counts, read, target)
    counts = replace(counts, longest=max(counts.longest, time.perf_counter() - start))
    if _state(folder) != before:
        counts = replace(counts, written=counts.written + 1)
        shutil.rmtree(folder)
        folder.mkdir()
    return counts


def _attempt(counts: Tally, read: Callable[[Path], object], target: Path) -> Tally:
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    try:
        read(target)
    except ObsdesignError:
        return replace(counts, refused=counts.refused + 1)
    except _TooLong:
        return replace(counts, hangs=counts.hangs + 1)
    except Exception as error:  # noqa: BLE001  # what this looks for
        return replace(counts, faults=(*counts.faults, f"{type(error).__name__}: {error}"[:200]))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    return replace(counts, read=counts.read + 1)


def _interrupt(_signal: int, _frame: FrameType | None) -> None:
    raise _TooLong


def _state(folder: Path) -> dict[str, bytes]:
    return {str(file): hashlib.sha256(file.read_bytes()).digest() for file in folder.rglob("*") if file.is_file()}


def _as_file(name: str) -> Callable[[Path, bytes], Path]:
    def place(folder: Path, data: bytes) -> Path:
        (folder / name).write_bytes(data)
        return folder / name

    return place


def _as_bag(folder: Path, data: bytes) -> Path:
    bag = folder / "x_bag"
    bag.mkdir(exist_ok=True)
    (bag / "x_bag.db3").write_bytes(data)
    return bag


def sample_track(points: int = 12) -> Track:
    """Return a short valid path with everything that a file may hold."""
    t = np.arange(points) * 0.5
    position = np.column_stack([10 * np.minimum(t, 6000.0), np.sin(t), np.full(points, 50.0)])
    sensors = SensorTimes(("gps", "range"), np.array([0.0, 2.0, 5.5]), np.array([[1, 0], [0, 1]]))
    return Track(t, position, 0.1 * t, GeodeticOrigin(47.4, 8.5, 488.0), datetime(2026, 12, 1, tzinfo=UTC), sensors, "path", 20.0)


def cases() -> dict[str, tuple[Callable[[Path], object], Callable[[Path, bytes], Path], bytes]]:
    """Return for each reader: how it reads, how its input is placed, a valid input."""
    found: dict[str, tuple[Callable[[Path], object], Callable[[Path, bytes], Path], bytes]] = {}
    with tempfile.TemporaryDirectory() as temporary:
        for word in FORMATS:
            kind = format_of(word)
            written = write_track(sample_track(), word, Path(temporary) / f"x{kind.suffix}", "ardupilot")[0]
            content = (written / "x_bag.db3" if word == "bag" else written).read_bytes()
            found[word] = (kind.read, _as_bag if word == "bag" else _as_file(f"x{kind.suffix}"), content)
    path = od.simulate(_SYSTEM, [0.0, 0.0, 0.1], np.full((8, 1), 0.1), 0.5)
    found["trajectory.csv"] = (lambda file: read_trajectory_csv(_SYSTEM, file), _as_file("x.csv"), trajectory_csv(_SYSTEM, path).encode())
    found["scenario"] = (od.load_scenario, _as_file("x.toml"), _SCENARIO.read_bytes())
    return found


def tallies(inputs: int, seed: int = 0) -> dict[str, Tally]:
    """Return what each reader made of its share of so many inputs."""
    every = cases()
    share = -(-inputs // len(every))
    return {name: tally(read, place, mutants(content, share, seed)) for name, (read, place, content) in every.items()}


def main() -> None:
    """Write fuzz.md."""
    counts = tallies(INPUTS)
    header = ("reader", "inputs", "read", "refused by name", "other exceptions", "hangs", "files written", "longest [ms]")
    rows = [(name, c.inputs, c.read, c.refused, len(c.faults), c.hangs, c.written, round(c.longest * 1000)) for name, c in counts.items()]
    total = ("all", *(sum(int(row[k]) for row in rows) for k in range(1, 7)), max(int(row[7]) for row in rows))
    faults = [f"- {name}: {fault}" for name, c in counts.items() for fault in dict.fromkeys(c.faults)]
    text = f"""# Readers under broken files

Each input is a valid file after 1 to 5 seeded changes (`benchmarks/fuzz.py`, seed 0): bytes changed, taken out, repeated, moved, words
put in, ends cut off. A reader may read it, or refuse it by one InputError or ScenarioError; anything else is counted: other exceptions,
more than {LONGEST:g} s, a file written or changed. Time includes that of a machine shared with others.

{table(header, [*rows, total])}

{machine()}
"""
    (FOLDER / "fuzz.md").write_text(text + ("\n" + "\n".join(faults) + "\n" if faults else ""), encoding="utf-8")


if __name__ == "__main__":
    main()
