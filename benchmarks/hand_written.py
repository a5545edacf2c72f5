"""All information blocks of a path against a loop in C that is written by hand for this one system: unicycle_wind.c."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import obsdesign as od
from benchmarks.scene import BEACON, SIGMAS, STEP, flown, unicycle
from benchmarks.tables import table
from benchmarks.timing import Subject, apart, in_modes, judged, ratios, timed
from obsdesign.dynamics.step import sensitivity_of
from obsdesign.information.gramian import sensitivity_scan

SOURCE = Path(__file__).parent / "unicycle_wind.c"
FLAGS = ("-O3", "-march=native", "-shared", "-fPIC")
NAMES = {"C": "unicycle_wind", "C, one sine": "unicycle_wind_short"}


def loops(folder: Path) -> ctypes.CDLL:
    """Compile into a folder and load."""
    compiler = shutil.which("cc")
    if compiler is None:
        raise SystemExit("the benchmark 'information' needs a C compiler: there is no cc on the path")
    made = folder / "unicycle_wind.so"
    subprocess.run([compiler, *FLAGS, str(SOURCE), "-o", str(made), "-lm"], check=True)
    return ctypes.CDLL(str(made))


def bound(library: ctypes.CDLL, name: str, path: od.Trajectory) -> tuple[Callable[[], object], np.ndarray]:
    """Return a call of NAMES[name] for a path, and the blocks (N, 4, 5, 5) that it fills."""
    x, u = np.ascontiguousarray(path.x[:-1]), np.ascontiguousarray(path.u)
    blocks = np.empty((len(u), 4, 5, 5))
    setting = (ctypes.c_double * 7)(STEP, *BEACON, *(SIGMAS[sensor] for sensor in ("gps", "magnetometer", "range", "bearing")))
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (x, u, blocks)]
    loop = getattr(library, NAMES[name])
    call = partial(loop, ctypes.c_long(len(u)), *pointers[:2], setting, pointers[2])
    return partial(_alive, call, x, u), blocks


def _alive(call: Callable[[], object], *_arrays: np.ndarray) -> object:
    """The call, with the arrays that its addresses lead into."""
    return call()


def _bare(system: od.System, path: od.Trajectory) -> np.ndarray:
    """Blocks (N, S, n, n) from a path that is taken to be right."""
    start = sensitivity_of(system.model, path.step).start
    run = sensitivity_scan(system.model, path.step, True).run(start[None], [path.x[:-1], path.u], path.steps, carries=False)
    return run.results[0].reshape(path.steps, -1, 5, 5)


def _public(system: od.System, path: od.Trajectory) -> np.ndarray:
    return od.variational_gramian(system, path).blocks


def against_c() -> list[str]:
    """The blocks along a given path."""
    with TemporaryDirectory() as folder:
        library = loops(Path(folder))
    rows = [row for steps in (100, 1_000, 10_000) for row in _rows(library, steps)]
    return [
        f"All blocks (N, 4, 5, 5) along a given path of N steps. C: `unicycle_wind.c`, cc {' '.join(FLAGS[:2])}, buffers made",
        "beforehand; `C, one sine` uses an identity of sines besides. `bare loop`: from arrays to blocks; `variational_gramian`: with all",
        "checks. Ratios are obsdesign / C; bars at 1,000 steps: <= 2.5 as machine code, <= 20 in the virtual machine. Differences, at most",
        "1e-12, in units of sqrt(W_ii W_jj) with W the sum over the sensors at that step.",
        "",
        table(("steps", "what", "/ C", "best", "/ C, one sine", "best", "ns per step", "best", "difference"), rows),
    ]


def _rows(library: ctypes.CDLL, steps: int) -> list[tuple]:
    path = flown(steps)
    calls = {name: bound(library, name, path) for name in NAMES}
    subjects = {name: Subject(call) for name, (call, _) in calls.items()}
    for what, call in {"bare loop": _bare, "variational_gramian": _public}.items():
        for name, subject in in_modes(lambda loops, call=call: partial(call, unicycle(loops), path)).items():
            subjects[f"{what}, {name}"] = subject
    times = timed(subjects)
    reference = calls["C"][1]
    found = {name: blocks for name, (_, blocks) in calls.items()}
    whole = reference.sum(axis=1, keepdims=True)
    rows = []
    for name, spent in times.items():
        with subjects[name].around():
            blocks = np.asarray(found[name] if name in found else subjects[name].call())
        quotients = [value for other in calls for value in ratios(spent, times[other])]
        per_step = [1e9 * value / steps for value in (spent.median, spent.best)]
        rows.append((steps, name, *quotients, *per_step, judged(apart(blocks, reference, whole), 1e-12)))
    return rows
