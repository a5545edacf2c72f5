"""Information gathered while walking, over segments, windows and batches, and its gradient: against the Gramian and differences."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tracemalloc
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from by_hand import (
    BEACON,
    ONE_STEP,
    SCALE,
    SENSORS,
    SLOW,
    START,
    STEP,
    STEPS,
    Swinging,
    assert_close,
    derivative,
    flown,
    part,
    slopes,
    stepped,
)
from distributed import LocalCluster
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od

few = settings(deadline=None, max_examples=5, database=None, derandomize=True)

SWINGING, SWINGING_SLOW = od.System(Swinging(), SENSORS), od.System(Swinging(), SLOW)
DUBINS, DUBINS_SLOW = (od.System(od.Dubins(15.0, wind="constant"), sensors) for sensors in (SENSORS, SLOW))
PAIRS = pytest.mark.parametrize(
    ("slow", "every"),
    [(SWINGING_SLOW, SWINGING), (DUBINS_SLOW, DUBINS), (SWINGING, SWINGING)],
    ids=["swinging, slow sensors", "dubins, slow sensors", "swinging, every step"],
)


def test_the_law_by_hand_is_that_of_the_vehicle_and_its_steps_do_not_commute():
    random = np.random.default_rng(1)
    w = random.uniform(-1, 1, (STEPS, 2))
    path = od.simulate(SWINGING, START[:4], random.uniform(-0.6, 0.6, STEPS), STEP, w, tolerance=ONE_STEP)
    for k in range(STEPS):
        np.testing.assert_allclose(path.x[k + 1], stepped(path.x[k], path.u[k, 0], w[k], STEP), rtol=1e-12, atol=1e-12)
    F, G = (derivative(lambda x, k=k: stepped(x, path.u[k, 0], w[k], STEP), path.x[k]) for k in (0, 10))
    assert np.abs(F @ G - G @ F).max() > 0.01


# ---------------------------------------------------------------- segments


@PAIRS
@pytest.mark.parametrize("segments", [1, 2, 3, 8, 24])
def test_segments_summed_on_the_way_are_those_of_the_gramian(slow: od.System, every: od.System, segments: int):
    path = flown(slow)
    found, expected = od.segment_information(slow, path, segments), od.variational_gramian(slow, path).by_segment(segments)
    total = od.variational_gramian(every, path).total
    assert_close(found, expected, 1e-12, total)
    assert np.abs(expected).max() > 0


@pytest.mark.parametrize("segments", [0, -2, 5, 48, 1.5])
def test_segments_must_divide_the_steps(segments: int):
    path = flown(DUBINS)
    with pytest.raises(od.InputError, match=rf"segments is {segments}: must"):
        od.segment_information(DUBINS, path, segments)
    with pytest.raises(od.InputError, match=rf"segments is {segments}: must"):
        od.variational_gramian(DUBINS, path).by_segment(segments)


def through_a_landmark(rate_of_range: float | None = None) -> tuple[od.System, od.Trajectory]:
    """At 1 m/s along y = 0 the landmark (3, 0) is met at step 6."""
    system = od.System(od.Dubins(1.0), (od.GPS(1.0), od.Range((3.0, 0.0), 1.0, rate=rate_of_range)))
    return system, od.simulate(system, np.zeros(3), np.zeros(12), 0.5)


ALONG: dict[str, Callable[[od.System, od.Trajectory], object]] = {
    "segments": lambda system, path: od.segment_information(system, path, 4),
    "windows": lambda system, path: od.sliding_information(system, path, 3),
    "batch": lambda system, path: od.batch_information(system, path.x[:1], path.u, path.step),
    "value": lambda system, path: od.information_value(system, path.x[0], path.u, path.step, od.MinEigenvalue()),
    "gradient": lambda system, path: od.information_gradient(system, path.x[0], path.u, path.step, od.MinEigenvalue()),
}
EACH_WAY = pytest.mark.parametrize("way", ALONG.values(), ids=ALONG.keys())


@EACH_WAY
def test_a_path_through_a_landmark_is_refused_with_sensor_and_step(way: Callable[..., object]):
    system, path = through_a_landmark()
    with pytest.raises(od.InputError, match=r"'range' has no derivative at step 6 \(t = 3 s\)"):
        way(system, path)


@EACH_WAY
def test_a_landmark_that_is_met_between_two_samples_is_no_harm(way: Callable[..., object]):
    system, path = through_a_landmark(rate_of_range=0.5)
    found = way(system, path)
    for values in found if isinstance(found, tuple) else (found,):
        assert np.isfinite(values).all()


@EACH_WAY
def test_a_system_without_sensors_is_refused(way: Callable[..., object]):
    with pytest.raises(od.InputError, match="no sensors"):
        way(od.System(od.Dubins(15.0, wind="constant")), flown(DUBINS))


@pytest.mark.parametrize("way", [ALONG["segments"], ALONG["windows"]], ids=["segments", "windows"])
def test_a_path_of_another_system_is_refused(way: Callable[..., object]):
    with pytest.raises(od.InputError, match="path has 4 states and 1 inputs: the system has 5"):
        way(DUBINS, flown(SWINGING))


def test_segments_need_no_memory_that_grows_with_the_path():
    """By NumPy's own account: between 20,000 and 100,000 steps less than a hundredth of what the path itself takes."""
    peaks, sizes = [], []
    for steps in (20_000, 100_000):
        path = od.simulate(DUBINS, START, 0.3 * np.sin(np.arange(steps)), STEP)
        od.segment_information(DUBINS, path, 10)  # what is built once
        sizes.append(path.t.nbytes + path.x.nbytes + path.u.nbytes)
        tracemalloc.start()
        od.segment_information(DUBINS, path, 10)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 0.01 * (sizes[1] - sizes[0])


MEASURED = """
import resource, sys
import numpy as np
import obsdesign as od
steps = int(sys.argv[1])
beacon = (40.0, 25.0)
sensors = (od.GPS(2.0, rate=1.0), od.Magnetometer(0.21), od.Range(beacon, 1.0), od.Bearing(beacon, 0.087, rate=0.5))
system = od.System(od.Dubins(15.0, wind="constant"), sensors)
path = od.simulate(system, (3.0, -1.0, 0.4, 2.0, -1.0), 0.3 * np.sin(np.arange(steps) / 50), 0.25)
found = od.segment_information(system, path, 10)
assert np.isfinite(found).all()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, path.t.nbytes + path.x.nbytes + path.u.nbytes)
"""


def peak_memory(steps: int, folder: Path) -> tuple[int, int]:
    """Most memory that a process needs, and what the arrays of the path take, in bytes."""
    environment = os.environ | {"XDG_CACHE_HOME": str(folder)}
    command = [sys.executable, "-c", MEASURED, str(steps)]
    said = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=True, timeout=280).stdout
    peak, arrays = map(int, said.split())
    return peak * (1 if sys.platform == "darwin" else 1024), arrays


@pytest.mark.skipif(sys.platform == "win32", reason="there the operating system keeps no such account")
@pytest.mark.parametrize("steps", [200_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_a_long_path_needs_memory_for_itself_and_little_more(steps: int, tmp_path: Path):
    """Simulating holds the states three times, while they are put together and checked, and their times and inputs."""
    (short, few_bytes), (long, bytes_of_path) = peak_memory(1_000, tmp_path), peak_memory(steps, tmp_path)
    assert long < 1e9
    assert long - short < 4 * (bytes_of_path - few_bytes)


# ---------------------------------------------------------------- windows


@PAIRS
@pytest.mark.parametrize("window", [1, 2, 3, 7, 16, STEPS])
def test_a_window_is_the_gramian_of_the_path_cut_there_with_the_samples_of_the_whole_path(slow: od.System, every: od.System, window: int):
    path = flown(slow)
    found = od.sliding_information(slow, path, window)
    assert found.shape == (STEPS - window + 1, 4, len(slow.model.states), len(slow.model.states))
    rates = [sensor.rate for sensor in slow.sensors]
    periods = np.array([1 if hertz is None else round(1 / (hertz * STEP)) for hertz in rates])
    due = np.arange(STEPS)[:, None] % periods == 0
    for k in range(STEPS - window + 1):
        cut = od.variational_gramian(every, part(path, k, k + window))
        expected = (cut.blocks * due[k : k + window, :, None, None]).sum(axis=0)
        assert_close(found[k], expected, 1e-11, cut.total)


@few
@given(window=st.integers(1, 40), seed=st.integers(0, 10**6))
def test_windows_of_any_length_are_gramians_of_cut_paths(window: int, seed: int):
    path = flown(SWINGING, steps=40, seed=seed)
    found = od.sliding_information(SWINGING, path, window).sum(axis=1)
    expected = [od.variational_gramian(SWINGING, part(path, k, k + window)).total for k in range(41 - window)]
    assert_close(found, np.array(expected), 1e-11)


@pytest.mark.parametrize("window", [0, -1, STEPS + 1, 2.5, "3", True])
def test_a_window_is_counted_and_no_longer_than_the_path(window: object):
    with pytest.raises(
        od.InputError, match=rf"window is {window!r}: must be a whole number" + (rf" from 1 to {STEPS}" if type(window) is int else "$")
    ):
        od.sliding_information(DUBINS, flown(DUBINS), window)


# ---------------------------------------------------------------- batches

BLOWN = od.System(od.Dubins(15.0, wind="unknown"), SLOW)


def one_by_one(systems: Sequence[od.System], starts: np.ndarray, u: np.ndarray, w: np.ndarray | None = None) -> np.ndarray:
    """The Gramians (M, S, n, n) of paths simulated alone."""
    found = []
    for m, (system, start) in enumerate(zip(systems, starts, strict=True)):
        own, wind = (values[m] if values is not None and values.ndim == 3 else values for values in (u, w))
        path = od.simulate(system, start, own, STEP, wind)
        found.append(od.variational_gramian(system, path).blocks.sum(axis=0))
    return np.array(found)


def starts_of(system: od.System, count: int, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    return START[: len(system.model.states)] + random.uniform(-1, 1, (count, len(system.model.states)))


@pytest.mark.parametrize("system", [DUBINS_SLOW, SWINGING_SLOW, BLOWN], ids=["dubins", "swinging", "unknown wind"])
@pytest.mark.parametrize("own", [False, True], ids=["shared inputs", "own inputs"])
@pytest.mark.parametrize("wind", [None, "shared", "own"], ids=lambda kind: f"wind {kind}")
def test_a_batch_is_one_path_after_the_other(system: od.System, own: bool, wind: str | None):
    random, p = np.random.default_rng(4), len(system.model.unknown_inputs)
    u = random.uniform(-0.6, 0.6, (5, STEPS, 1) if own else (STEPS, 1))
    w = None if wind is None else random.uniform(-3, 3, (5, STEPS, p) if wind == "own" else (STEPS, p))
    starts = starts_of(system, 5)
    found, expected = od.batch_information(system, starts, u, STEP, w), one_by_one([system] * 5, starts, u, w)
    assert_close(found, expected, 1e-11, expected.sum(axis=1, keepdims=True))


def test_a_batch_may_have_a_system_for_each_start():
    """Other speeds, other noise, and neighbours that are equal."""
    speeds = (15.0, 15.0, 9.0, 15.0, 9.0, 9.0, 20.0)
    systems = [od.System(od.Dubins(speed, wind="constant"), (od.GPS(speed / 5), *SLOW[1:])) for speed in speeds]
    random = np.random.default_rng(2)
    starts = starts_of(DUBINS, 7)
    for u in (random.uniform(-0.6, 0.6, (STEPS, 1)), random.uniform(-0.6, 0.6, (7, STEPS, 1))):
        found, expected = od.batch_information(systems, starts, u, STEP), one_by_one(systems, starts, u)
        assert_close(found, expected, 1e-11, expected.sum(axis=1, keepdims=True))


def many(executor: object = None) -> bytes:
    """More starts than one task takes, of two systems."""
    systems = [SWINGING_SLOW] * 700 + [od.System(Swinging(5.0), SLOW)] * 300
    random = np.random.default_rng(8)
    u, w = random.uniform(-0.6, 0.6, (1000, 8, 1)), random.uniform(-1, 1, (8, 2))
    return od.batch_information(systems, starts_of(SWINGING, 1000), u, STEP, w, executor).tobytes()


def pendulum(friction: float) -> od.ControlAffineSystem:
    x = ca.SX.sym("x", 2)
    return od.ControlAffineSystem(
        x, ("a", "b"), ca.vertcat(x[1], -ca.sin(x[0]) - friction * x[1]), {"push": ca.SX([0, 1])}, {}, {"y": x[0] ** 2}
    )


def of_the_package(executor: object = None) -> bytes:
    """More starts than one task takes, of a ready-made system; and expressions, which travel on their own ways."""
    starts, u = starts_of(DUBINS, 1100), np.random.default_rng(8).uniform(-0.6, 0.6, (8, 1))
    gramians = od.batch_information(DUBINS_SLOW, starts, u, STEP, executor=executor)
    swings = od.batch_information([pendulum(0.1), pendulum(0.1), pendulum(0.3)], starts[:3, :2], u, STEP, executor=executor)
    return gramians.tobytes() + swings.tobytes()


def test_a_batch_spread_over_processes_has_the_same_bytes():
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as processes:
        assert many(processes) == many()
        assert of_the_package(processes) == of_the_package()


def test_a_batch_spread_over_a_dask_cluster_has_the_same_bytes():
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        cluster.get_client() as client,
    ):
        assert of_the_package(client.get_executor()) == of_the_package()


GOOD = np.zeros((STEPS, 1))
WRONG = {
    "one start alone": ((START, GOOD), r"starts has shape \(5,\): must be \(M, n\), M > 0"),
    "no start": ((np.empty((0, 5)), GOOD), r"starts has shape \(0, 5\): must be \(M, n\), M > 0"),
    "other states": ((np.zeros((3, 4)), GOOD), "starts has 4 columns: must have 5 for x, y, heading, wind_x, wind_y"),
    "other inputs": ((np.zeros((3, 5)), np.zeros((STEPS, 2))), rf"u has shape \({STEPS}, 2\): must be \(N, 1\) or \(3, N, 1\)"),
    "inputs of other starts": (
        (np.zeros((3, 5)), np.zeros((2, STEPS, 1))),
        rf"u has shape \(2, {STEPS}, 1\): must be \(N, 1\) or \(3, N, 1\)",
    ),
    "no steps": ((np.zeros((3, 5)), np.zeros((0, 1))), r"u has shape \(0, 1\): must be \(N, 1\) or \(3, N, 1\), N > 0"),
}


@pytest.mark.parametrize(("arguments", "message"), WRONG.values(), ids=WRONG.keys())
def test_a_batch_of_the_wrong_shape_is_refused(arguments: tuple[np.ndarray, np.ndarray], message: str):
    with pytest.raises(od.InputError, match=message):
        od.batch_information(DUBINS, *arguments, STEP)


def test_a_batch_needs_a_system_for_each_start_and_wind_for_each_step():
    starts = np.zeros((3, 5))
    with pytest.raises(od.InputError, match=r"starts has shape \(3, 5\) for 2 systems"):
        od.batch_information([DUBINS, DUBINS], starts, GOOD, STEP)
    for w in (np.zeros((STEPS, 1)), np.zeros((STEPS - 1, 2)), np.zeros((2, STEPS, 2))):
        with pytest.raises(od.InputError, match=r"w has shape .*: must be \(N, 2\) or \(3, N, 2\), N > 0 the same for u and w"):
            od.batch_information(BLOWN, starts[:, :3], GOOD, STEP, w)
    with pytest.raises(od.InputError, match=r"dt is 0\.0: must be a finite number above 0"):
        od.batch_information(DUBINS, starts, GOOD, 0.0)


def test_a_batch_names_the_number_that_is_not_finite():
    starts = np.zeros((600, 5))
    starts[550, 2] = np.nan
    with pytest.raises(od.InputError, match=r"starts\[550\]: heading is nan: must be finite"):
        od.batch_information(DUBINS, starts, GOOD, STEP)
    u = np.zeros((4, STEPS, 1))
    u[2, 5] = np.inf
    with pytest.raises(od.InputError, match=r"u\[2, 5, 0\] is inf: must be finite"):
        od.batch_information(DUBINS, starts[:4], u, STEP)


@pytest.mark.parametrize("processes", [False, True], ids=["here", "elsewhere"])
def test_a_batch_names_the_start_whose_path_meets_a_landmark(processes: bool):
    system, path = through_a_landmark()
    starts = np.tile([0.0, 1.0, 0.0], (600, 1))
    starts[550] = 0.0
    message = r"^starts\[550\]: sensor 'range' has no derivative at step 6 "
    if not processes:
        with pytest.raises(od.InputError, match=message):
            od.batch_information(system, starts, path.u, path.step)
        return
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor, pytest.raises(od.InputError, match=message):
        od.batch_information(system, starts, path.u, path.step, executor=executor)


# ---------------------------------------------------------------- value and gradient

CRITERIA = pytest.mark.parametrize(
    "criterion", [od.LogDet(), od.MinEigenvalue(), od.TraceInverse()], ids=lambda criterion: type(criterion).__name__
)
STEERED = {
    "dubins in constant wind, slow sensors": DUBINS_SLOW,
    "dubins in unknown wind": BLOWN,
    "unicycle": od.System(od.Unicycle(), SENSORS[:3]),
    "unicycle in constant wind": od.System(od.Unicycle(wind="constant"), SLOW),
    "unicycle of unknown turn rate": od.System(od.Unicycle(), SENSORS, unknown_inputs=("turn_rate",)),
    "limited range and view": od.System(
        od.Dubins(15.0), (od.GPS(3.0, rate=1.0), od.Range(BEACON, 1.0, max_range=40.0), od.Bearing(BEACON, 0.1, field_of_view=1.5))
    ),
    "swinging": SWINGING_SLOW,
}


@CRITERIA
@pytest.mark.parametrize("system", STEERED.values(), ids=STEERED.keys())
def test_the_gradient_is_its_central_differences(system: od.System, criterion: object):
    path, n = flown(system, steps=16), len(system.model.states)
    arguments = (STEP, criterion, SCALE[:n])
    value, gradient = od.information_gradient(system, path.x[0], path.u, *arguments, tolerance=ONE_STEP)
    S = np.diag(SCALE[:n])
    assert value == pytest.approx(criterion.value(S @ od.variational_gramian(system, path).total @ S), rel=1e-9)
    assert value == od.information_value(system, path.x[0], path.u, *arguments, tolerance=ONE_STEP)
    expected = slopes(lambda u: od.information_value(system, path.x[0], u, *arguments, tolerance=ONE_STEP), path.u)
    assert np.abs(expected).max() > 0
    np.testing.assert_allclose(gradient, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max() + 1e-11 * abs(value))
    assert not gradient[-1].any(), "after the last sample nothing counts"


def test_without_a_scale_the_units_are_those_of_the_states():
    path = flown(DUBINS)
    W = od.variational_gramian(DUBINS, path).total
    assert od.information_value(DUBINS, path.x[0], path.u, STEP, od.LogDet()) == pytest.approx(np.linalg.slogdet(W)[1], rel=1e-9)
    plain = od.information_gradient(DUBINS, path.x[0], path.u, STEP, od.LogDet())[1]
    scaled = od.information_gradient(DUBINS, path.x[0], path.u, STEP, od.LogDet(), SCALE)[1]
    np.testing.assert_allclose(plain, scaled, rtol=1e-6, atol=1e-9 * np.abs(plain).max())  # log det W + 2 log det S


@pytest.mark.parametrize("criterion", [od.LogDet(), od.TraceInverse()], ids=lambda criterion: type(criterion).__name__)
def test_where_a_criterion_has_no_value_there_is_no_gradient(criterion: object):
    """GPS on a straight line does not see the heading."""
    system = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0),))
    assert od.information_value(system, START, np.zeros((10, 1)), STEP, criterion) == -np.inf
    with pytest.raises(od.InputError, match=rf"{type(criterion).__name__} is -inf along this path: it has no gradient there"):
        od.information_gradient(system, START, np.zeros((10, 1)), STEP, criterion)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x0": START[:3]}, r"x0 has shape \(3,\): must be \(5,\)"),
        ({"x0": (0.0, 0.0, np.nan, 0.0, 0.0)}, "x0: heading is nan: must be finite"),
        ({"u": np.zeros((4, 2))}, r"u has shape \(4, 2\): must be \(N, 1\)"),
        ({"u": np.full((4, 1), np.inf)}, r"u\[0, 0\] is inf: must be finite"),
        ({"u": np.zeros((0, 1))}, "N > 0|at least 1"),
        ({"dt": -1.0}, "dt is -1.0: must be a finite number above 0"),
        ({"scale": (1.0, 1.0)}, r"scale has shape \(2,\): must be \(5,\)"),
        ({"scale": (1.0, 1.0, 0.0, 1.0, 1.0)}, "scale of heading is 0.0: must be a finite number above 0"),
    ],
)
@pytest.mark.parametrize("function", [od.information_value, od.information_gradient], ids=["value", "gradient"])
def test_bad_input_of_a_value_or_a_gradient_is_refused(function: Callable[..., object], changes: dict[str, object], message: str):
    arguments = {"x0": START, "u": np.zeros((4, 1)), "dt": STEP, "criterion": od.MinEigenvalue(), "scale": None, **changes}
    with pytest.raises(od.InputError, match=message):
        function(DUBINS, **arguments)
