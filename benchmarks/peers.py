"""pybounds with the model of `scene`: finite differences of simulations, and exact derivatives by JAX."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np

import obsdesign as od
from benchmarks.scene import BEACON, SIGMAS, START, STEP, controls, unicycle
from benchmarks.timing import Subject

os.environ.setdefault("JAX_PLATFORMS", "cpu")
with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # optional parts that are not installed
    import jax
    import jax.numpy as jnp
    import pybounds
    from jax.experimental.compilation_cache import compilation_cache

STATES = list(unicycle().model.state_names)
OUTPUTS = {"gps_x": "gps", "gps_y": "gps", "magnetometer": "magnetometer", "range": "range", "bearing": "bearing"}
NAMES = {"state_names": STATES, "input_names": ["speed", "turn_rate"], "measurement_names": list(OUTPUTS)}
VARIANCES = {name: SIGMAS[sensor] ** 2 for name, sensor in OUTPUTS.items()}


# ---------------------------------------------------------------- the model, once for CasADi and once for JAX


def rate(x: Sequence[ca.SX], u: Sequence[ca.SX]) -> list[ca.SX | float]:
    """xdot, as a list."""
    return [u[0] * ca.cos(x[2]) + x[3], u[0] * ca.sin(x[2]) + x[4], u[1], 0.0, 0.0]


def stepped(x: Sequence[ca.SX], u: Sequence[ca.SX]) -> list[ca.SX]:
    """x after one RK4 step, as a list."""
    start, f = ca.vertcat(*x), lambda z: ca.vertcat(*rate(ca.vertsplit(z), u))
    k1 = f(start)
    k2 = f(start + STEP / 2 * k1)
    k3 = f(start + STEP / 2 * k2)
    return ca.vertsplit(start + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + f(start + STEP * k3)))


def measured(x: Sequence[float], u: Sequence[float]) -> list[float]:
    """y, as a list of numbers."""
    east, north = BEACON[0] - x[0], BEACON[1] - x[1]
    return [x[0], x[1], x[2], math.hypot(east, north), math.atan2(north, east) - x[2]]


def jax_rate(x: jax.Array, u: jax.Array) -> jax.Array:
    """xdot (5,)."""
    return jnp.array([u[0] * jnp.cos(x[2]) + x[3], u[0] * jnp.sin(x[2]) + x[4], u[1], 0.0, 0.0])


def jax_measured(x: jax.Array, u: jax.Array) -> jax.Array:
    """y (5,)."""
    east, north = BEACON[0] - x[0], BEACON[1] - x[1]
    return jnp.array([x[0], x[1], x[2], jnp.sqrt(east * east + north * north), jnp.arctan2(north, east) - x[2]])


# ---------------------------------------------------------------- what is asked of pybounds


@contextmanager
def compilations(folder: Path | None) -> Iterator[None]:
    """Let JAX keep what it compiles in a folder, or nowhere: pybounds makes new functions for JAX to compile at every call."""
    jax.config.update("jax_compilation_cache_dir", None if folder is None else str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    compilation_cache.reset_cache()
    try:
        yield
    finally:
        jax.config.update("jax_compilation_cache_dir", None)
        compilation_cache.reset_cache()


def gramians(folder: Path) -> dict[str, Subject]:
    """Return the ways from START and controls(100) to W; those without JAX simulate with IDAS (as pybounds does) or RK4 steps."""
    idas = pybounds.Simulator(rate, measured, dt=STEP, **NAMES)
    rk4 = pybounds.Simulator(stepped, measured, dt=STEP, discrete=True, **NAMES)
    by_jax = partial(_fisher, pybounds.JaxEmpiricalObservabilityMatrix, _jax_simulator())
    return {
        "differences, IDAS": Subject(partial(_fisher, pybounds.EmpiricalObservabilityMatrix, idas)),
        "differences, RK4": Subject(partial(_fisher, pybounds.EmpiricalObservabilityMatrix, rk4)),
        "JAX": Subject(by_jax, partial(compilations, None)),
        "JAX that keeps what it compiles": Subject(by_jax, partial(compilations, folder)),
    }


def windows(path: od.Trajectory, width: int, folder: Path) -> dict[str, Subject]:
    """Return the ways to the observability matrices of all windows of a path, by JAX."""
    given = (_jax_simulator(), path.t[:-1], path.x[:-1], path.u)
    sliding = partial(pybounds.JaxSlidingEmpiricalObservabilityMatrix, *given, w=width)
    analysis = partial(_analysed, *given, width=width)
    return {
        "JAX": Subject(sliding, partial(compilations, None)),
        "JAX, its analysis class": Subject(analysis, partial(compilations, None)),
        "JAX that keeps what it compiles": Subject(sliding, partial(compilations, folder)),
        "the same, its analysis class": Subject(analysis, partial(compilations, folder)),
    }


def plain_windows(path: od.Trajectory, width: int) -> object:
    """Return pybounds' windows by finite differences of IDAS simulations."""
    simulator = pybounds.Simulator(rate, measured, dt=STEP, **NAMES)
    return pybounds.SlidingEmpiricalObservabilityMatrix(simulator, path.t[:-1], path.x[:-1], path.u, w=width)


def fisher_of(sliding: object) -> np.ndarray:
    """Return the information (K, n, n) of the windows of `windows()["JAX"]` or `plain_windows`."""
    frames = sliding.get_observability_matrix()  # pyright: ignore[reportAttributeAccessIssue]
    return np.array([pybounds.FisherObservability(frame, R=VARIANCES).F.to_numpy() for frame in frames])


def _jax_simulator() -> pybounds.JaxSimulator:
    return pybounds.JaxSimulator(jax_rate, jax_measured, STEP, **NAMES)


def _fisher(kind: type, simulator: object) -> np.ndarray:
    return pybounds.FisherObservability(kind(simulator, START, controls(100)).O_df, R=VARIANCES).F.to_numpy()


def _analysed(simulator: object, t: np.ndarray, x: np.ndarray, u: np.ndarray, width: int) -> object:
    return pybounds.ObservabilityAnalysis(simulator, t, x, u, w=width, R=VARIANCES, method="bounds-jax").run()
