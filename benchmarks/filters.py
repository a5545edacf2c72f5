"""Filters and bounds beside those of others, and of a log of 438,000 steps: filterpy's loop, Stone Soup's Cramer-Rao bound.

All run in turn in one process on one core; seconds are of the processor.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from time import process_time

import casadi as ca
import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from stonesoup.metricgenerator.pcrbmetric import PCRBMetric
from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.types.array import StateVector
from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
from stonesoup.types.state import GaussianState

import obsdesign as od
from benchmarks.scene import BEACON, SIGMAS, START, STEP, controls, unicycle
from benchmarks.tables import machine, peak_memory, table, write
from benchmarks.timing import MODES, mode
from obsdesign.dynamics.simulation import substeps_along
from obsdesign.estimation.filter_bank import Belief, FilterBank

RUNS, STEPS, FEW = 1000, 1000, 10  # FEW runs of the loop are timed, and counted RUNS / FEW times
LONG, SENSORS, ONE_RUN, BOUND_STEPS = 438_000, 30, 40_000, 500
_ROUNDS = 7
_STD = np.array([3.0, 3.0, 0.1, 1.0, 1.0])
_PSD = np.array([0.0, 0.0, 1e-4, 1e-3, 1e-3])
_VARIANCES = np.array([SIGMAS["gps"]] * 2 + [SIGMAS["magnetometer"], SIGMAS["range"], SIGMAS["bearing"]]) ** 2


@dataclass(frozen=True)
class Row:
    """What was asked, what was measured, the bar, and whether it is met."""

    what: str
    measured: str
    bar: str
    is_met: bool
    difference: str = ""


def main() -> None:
    """Write filters.md."""
    rows = [_runs_against_loop(), _bound_against_stone_soup(), _one_run(), *_long_posterior()]
    header = ["what", "measured", "bar", "met", "largest relative difference"]
    text = table(header, [[row.what, row.measured, row.bar, "yes" if row.is_met else "NO", row.difference] for row in rows])
    write("filters", "\n".join(["# Filters and bounds", "", __doc__ or "", machine(), "", text]))


def best(call: Callable[[], object]) -> float:
    """Return the seconds of the best of some calls, the first not counted."""
    call()
    seconds = []
    for _ in range(_ROUNDS):
        began = process_time()
        call()
        seconds.append(process_time() - began)
    return min(seconds)


# ---------------------------------------------------------------- many runs of an EKF, and filterpy's loop


def _runs_against_loop() -> Row:
    """5 states, 4 sensors of 5 outputs."""
    path = od.simulate(unicycle(), START, controls(STEPS), STEP)
    random = np.random.default_rng(0)
    y = _read(path.x[:-1])[:, None] + random.standard_normal((STEPS, RUNS, 5)) * np.sqrt(_VARIANCES)
    starts = START + random.standard_normal((RUNS, 5)) * _STD
    substeps = substeps_along(unicycle(), path)
    bank = FilterBank(unicycle(), STEP, np.diag(_PSD) * STEP, substeps)
    active = np.ones((STEPS, 5))
    initial = Belief(starts, np.tile(np.diag(_STD**2), (RUNS, 1, 1)))
    seconds = best(lambda: bank.run(initial, path.u, y, active))
    began = process_time()
    loop = [_filterpy(starts[run], path.u, y[:, run], substeps) for run in range(FEW)]
    of_loop = (process_time() - began) * RUNS / FEW
    means = bank.run(initial, path.u, y, active).mean[STEPS, :FEW]
    difference = float(np.max(np.abs(np.array(loop) - means) / np.abs(means)))
    what = f"{RUNS:,} EKF runs of {STEPS:,} steps, 5 states, 4 sensors; filterpy's loop"
    measured = f"{seconds:.2f} s; {of_loop:.0f} s, {of_loop / seconds:.0f} times"
    return Row(what, measured, "15 times", of_loop >= 15 * seconds, f"{difference:.1e}")


def _read(x: np.ndarray) -> np.ndarray:
    """Return what the sensors read (..., 5) at states (..., 5)."""
    east, north = BEACON[0] - x[..., 0], BEACON[1] - x[..., 1]
    return np.stack([x[..., 0], x[..., 1], x[..., 2], np.hypot(east, north), np.arctan2(north, east) - x[..., 2]], axis=-1)


def _filterpy(start: np.ndarray, u: np.ndarray, y: np.ndarray, substeps: int) -> np.ndarray:
    """Return the mean behind the last step, by filterpy's loop with derivatives by hand."""
    kalman = _HandWritten(substeps)
    kalman.x, kalman.P = start.copy(), np.diag(_STD**2)
    kalman.Q, kalman.R = np.diag(_PSD) * STEP, np.diag(_VARIANCES)
    for inputs, sample in zip(u, y, strict=True):
        kalman.update(sample, _derivative, _read, residual=_residual)
        kalman.predict(inputs)
    return kalman.x


class _HandWritten(ExtendedKalmanFilter):
    """The motion of the unicycle by Simpson's rule, which RK4 is for it."""

    def __init__(self, substeps: int) -> None:
        super().__init__(dim_x=5, dim_z=5)
        self.substeps, self.F = substeps, np.eye(5)

    def predict_x(self, u: np.ndarray) -> None:
        """Move on, and leave F."""
        h, F = STEP / self.substeps, np.eye(5)
        x = self.x.copy()
        for _ in range(self.substeps):
            angles = x[2] + u[1] * np.array([0.0, h / 2, h])
            way = u[0] * h / 6 * np.array([1.0, 4.0, 1.0])
            east, north = way @ np.cos(angles), way @ np.sin(angles)
            one = np.eye(5)
            one[0, 2], one[1, 2], one[0, 3], one[1, 4] = -north, east, h, h
            x = x + np.array([east + h * x[3], north + h * x[4], h * u[1], 0.0, 0.0])
            F = one @ F
        self.x, self.F = x, F


def _derivative(x: np.ndarray) -> np.ndarray:
    east, north = BEACON[0] - x[0], BEACON[1] - x[1]
    square = east * east + north * north
    r, H = np.sqrt(square), np.zeros((5, 5))
    H[0, 0] = H[1, 1] = H[2, 2] = 1.0
    H[3, 0], H[3, 1] = -east / r, -north / r
    H[4, 0], H[4, 1], H[4, 2] = north / square, -east / square, -1.0
    return H


def _residual(sample: np.ndarray, expected: np.ndarray) -> np.ndarray:
    difference = sample - expected
    difference[[2, 4]] = (difference[[2, 4]] + np.pi) % (2 * np.pi) - np.pi
    return difference


# ---------------------------------------------------------------- the Cramer-Rao bound, and Stone Soup's


def _bound_against_stone_soup() -> Row:
    """Constant velocity in the plane, seen by range and bearing from four places."""
    places, psd, sigmas = np.array([[40.0, -30.0, 10.0, -50.0], [30.0, 20.0, -60.0, -20.0]]), 0.05, (0.02, 0.5)
    start, dt = np.array([0.0, 1.0, 0.0, 0.5]), 0.5
    states = start + np.arange(BOUND_STEPS + 1)[:, None] * dt * np.array([start[1], 0.0, start[3], 0.0])
    prior = np.diag([4.0, 1.0, 4.0, 1.0])
    stone_soup = _stone_soup(states, places, psd, sigmas, prior=prior, dt=dt)
    of_others, others = best(stone_soup), np.array(stone_soup()["inverse_j"])[1:BOUND_STEPS]
    sizes, seconds, differences = np.sqrt(np.einsum("kii->ki", others)), {}, []
    for name in MODES:
        with mode(name):
            bound = _library_bound(start, places, psd, sigmas, prior=prior, dt=dt, loops=name)
            seconds[name] = best(bound)
            differences.append(np.abs(np.linalg.inv(bound())[1:BOUND_STEPS] - others) / (sizes[:, :, None] * sizes[:, None]))
    measured = ", ".join(f"{name} {1e3 * value:.2f} ms ({of_others / value:.0f} times)" for name, value in seconds.items())
    what = f"Cramer-Rao bound of {BOUND_STEPS} steps, 4 states, 4 ranges and bearings; Stone Soup's"
    is_met = of_others >= 200 * min(seconds.values())
    return Row(what, f"{measured}; {1e3 * of_others:.0f} ms", "200 times", is_met, f"{np.max(differences):.1e}")


def _stone_soup(
    states: np.ndarray, places: np.ndarray, psd: float, sigmas: tuple[float, float], *, prior: np.ndarray, dt: float
) -> Callable[[], dict[str, object]]:
    begin = datetime(2026, 1, 1)  # as Stone Soup has them
    path = GroundTruthPath([GroundTruthState(x, timestamp=begin + timedelta(seconds=k * dt)) for k, x in enumerate(states)])
    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(psd)] * 2)
    sensor = CartesianToBearingRange(ndim_state=4, mapping=(0, 2), noise_covar=np.diag(np.square(sigmas)))
    start = GaussianState(states[0], prior, timestamp=begin)
    arguments = start, motion, sensor, path, _Places(places), 1.0, (0, 2), None
    return lambda: PCRBMetric._compute_pcrb_single(*arguments)


class _Places:
    """Places (2, s) of which a column is a StateVector (2, 1), as models take it: of StateVectors it is (2,)."""

    def __init__(self, places: np.ndarray) -> None:
        self.places, self.shape = places, places.shape

    def __getitem__(self, key: tuple[slice, int]) -> StateVector:
        return StateVector(self.places[key])


def _library_bound(
    start: np.ndarray, places: np.ndarray, psd: float, sigmas: tuple[float, float], *, prior: np.ndarray, dt: float, loops: str
) -> Callable[[], np.ndarray]:
    x = ca.SX.sym("x", 4)
    offsets = [(place[0] - x[0], place[1] - x[2]) for place in places.T]
    outputs = {f"bearing {i} {loops}": ca.atan2(-north, -east) for i, (east, north) in enumerate(offsets)}
    outputs |= {f"range {i} {loops}": ca.sqrt(east**2 + north**2) for i, (east, north) in enumerate(offsets)}
    system = od.ControlAffineSystem(
        state=x,
        names=("x", "v_x", "y", "v_y"),
        drift=ca.vertcat(x[1], 0, x[3], 0),
        known={},
        unknown={},
        outputs=outputs,
        sigmas={name: sigmas[name.startswith("range")] for name in outputs},
        angles=tuple(name for name in outputs if name.startswith("bearing")),
    )
    path = od.simulate(system, start, np.zeros((BOUND_STEPS, 0)), dt)
    block = psd * np.array([[dt**2 / 3, dt / 2], [dt / 2, 1.0]])
    active = np.ones((BOUND_STEPS, len(outputs)), dtype=bool)
    active[0] = False  # Stone Soup begins behind the first instant
    return lambda: od.posterior_information(system, path, od.Prior(start, covariance=prior), np.kron(np.eye(2), block), active=active)


# ---------------------------------------------------------------- one long run, and a long bound


def _one_run() -> Row:
    path = od.simulate(unicycle(), START, controls(ONE_RUN), STEP)
    y = _read(path.x[:-1]) + np.random.default_rng(0).standard_normal((ONE_RUN, 5)) * np.sqrt(_VARIANCES)
    prior = od.Prior(START, std=tuple(_STD.tolist()))
    estimators = (od.ExtendedKalmanFilter(), od.ExtendedKalmanFilter(gate=od.Gate(0.999, alarm=20)))
    seconds = [
        best(lambda kalman=kalman: od.estimate_states(unicycle(), prior, path.u, y, STEP, disturbance_psd=_PSD, estimator=kalman))
        for kalman in estimators
    ]
    what = f"`estimate_states` of {ONE_RUN:,} steps, 5 states, 4 sensors, without a gate and with one"
    return Row(what, f"{seconds[0]:.3f} s, {seconds[1]:.3f} s", "0.2 s", max(seconds) <= 0.2)


def _long_posterior() -> list[Row]:
    """In a process of its own, whose memory is told."""
    command = [sys.executable, "-c", "from benchmarks.filters import long_run; long_run()"]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    tenth, full, memory = map(float, output)
    what = f"posterior of {LONG:,} steps, {SENSORS} ranges"
    return [
        Row(f"{what}, each there at a tenth of the steps; at all", f"{tenth:.2f} s; {full:.2f} s", "3 s", max(tenth, full) <= 3.0),
        Row(f"{what}: peak memory of the process", f"{memory:.0f} MB", "1 GB", memory < 1000),
    ]


def long_run() -> None:
    """Print seconds with a tenth of the samples and with all, and the peak memory [MB]."""
    random = np.random.default_rng(0)
    beacons = random.uniform(-200.0, 200.0, (SENSORS, 2))
    system = od.System(od.Unicycle(), tuple(od.Range((float(x), float(y)), 0.5, name=f"beacon_{i}") for i, (x, y) in enumerate(beacons)))
    u = np.column_stack([np.full(LONG, 2.0), 0.2 * np.sin(0.05 * STEP * np.arange(LONG))])
    path = od.simulate(system, (0.0, 0.0, 0.0), u, STEP)
    prior, seconds = od.Prior(path.x[0], std=(1.0, 1.0, 0.1)), []
    for active in (random.random((LONG, SENSORS)) < 0.1, None):
        began = process_time()
        od.posterior_information(system, path, prior, (0.01, 0.01, 1e-4), active=active)
        seconds.append(process_time() - began)
    sys.stdout.write(f"{seconds[0]} {seconds[1]} {peak_memory()}\n")


if __name__ == "__main__":
    main()
