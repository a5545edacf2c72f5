"""Errors that last or hang together in samples of a log: Gramians and windows against the posterior without process noise."""

import numpy as np
import pytest

import obsdesign as od
from obsdesign.dynamics.measurement_noise import measurement_noise
from obsdesign.dynamics.per_step import PerStepSystem

SENSORS = (
    od.Range((20.0, 0.0), 0.3, name="a", bias_floor=0.4, correlation=0.6, rate=2.0, max_range=30.0),
    od.Range((0.0, 20.0), 0.5, name="b"),
    od.GPS(1.0, name="gps", bias_floor=1.5),
    od.Magnetometer(0.05, name="compass"),
)
SYSTEM = od.System(od.Unicycle(), SENSORS, joint_noise={("b", "compass"): [[0.25, 0.01], [0.01, 0.0025]]})
RANDOM = np.random.default_rng(5)
PATH = od.simulate(SYSTEM, [0.0, 0.0, 0.2], np.tile([1.5, 0.15], (20, 1)), RANDOM.uniform(0.2, 0.6, 20))
TIMES = np.concatenate([RANDOM.uniform(PATH.t[0], PATH.t[-1] - 0.01, 30), np.repeat(PATH.t[[2, 5, 9]], 4)])
NAMES = ("a", "b", "gps", "compass")
SENSOR = np.concatenate([RANDOM.integers(0, 4, 30), np.tile(np.arange(4), 3)])  # some at one time, joint ones together
Y = np.where((SENSOR == 2)[:, None], 1.0, [1.0, np.nan])
LOG = od.Log(od.LogInputs(("speed", "turn_rate"), PATH.t[:-1], PATH.u), od.LogSamples(NAMES, TIMES, SENSOR, Y))
PRIOR = od.Prior(PATH.x[0], std=(3.0, 3.0, 0.5))


def start_information(path: od.Trajectory, log: od.Log, active: np.ndarray | None = None) -> np.ndarray:
    """W about x(t_0) by the posterior: Phi' J Phi - P_0^-1, without process noise."""
    Phi = od.variational_gramian(od.System(od.Unicycle(), (od.GPS(1.0),)), path).transition
    assert Phi is not None
    J = od.posterior_information(SYSTEM, path, PRIOR, active=active, samples=log)[-1]
    return Phi.T @ J @ Phi - PRIOR.information


def close(found: np.ndarray, expected: np.ndarray) -> None:
    """Entry by entry, against the sizes of the rows. Sub-steps of both are right to a millionth."""
    size = np.sqrt(np.diag(expected))
    assert np.abs((found - expected) / np.outer(size, size)).max() < 1e-5


def test_the_gramian_is_what_the_posterior_says_without_noise():
    W = od.variational_gramian(SYSTEM, PATH, samples=LOG)
    close(W.total, start_information(PATH, LOG))


@pytest.mark.parametrize("segments", [1, 2, 5, 20])
def test_what_is_counted_by_segment_is_no_more_than_all_say_together(segments: int):
    W = od.variational_gramian(SYSTEM, PATH, samples=LOG)
    blocks = W.by_segment(segments)
    for chosen in np.random.default_rng(segments).random((10, segments, 4)) < 0.7:
        under = W.under(np.repeat(chosen, 20 // segments, axis=0).astype(float))
        size = np.sqrt(np.diag(W.total))
        rest = (under - blocks[chosen].sum(axis=0)) / np.outer(size, size)
        assert np.linalg.eigvalsh(rest)[0] > -1e-9


@pytest.mark.parametrize("names", [("a",), ("b", "compass"), ("gps", "b")])
def test_of_some_sensors_what_these_say_together(names: tuple[str, ...]):
    active = np.tile([name in names for name in NAMES], (20, 1))
    W = od.variational_gramian(SYSTEM, PATH, samples=LOG)
    expected = start_information(PATH, LOG, active)
    close(W.only(*names).total, expected)
    close(W.under(active.astype(float)), expected)


def test_shares_add_up():
    W = od.variational_gramian(SYSTEM, PATH, samples=LOG)
    v = np.array([0.3, -0.2, 0.5])
    assert W.along(v).sum() == pytest.approx(v @ W.total @ v, rel=1e-9)
    np.testing.assert_allclose(od.contributions(SYSTEM, W).shares.sum(axis=(1, 2)), 1.0, rtol=1e-9)


def test_windows_know_nothing_of_the_errors_before_them():
    windows = od.sliding_information(SYSTEM, PATH, 6, samples=LOG).sum(axis=1)
    assert windows.shape == (15, 3, 3)
    for k in (0, 3, 9, 14):
        part = PATH.part(k, k + 6)
        inside = (LOG.samples.t >= part.t[0]) & (LOG.samples.t < part.t[-1])
        close(windows[k], start_information(part, od.Log(LOG.inputs, LOG.samples.where(inside))))
    close(od.sliding_information(SYSTEM, PATH, 20, samples=LOG)[0].sum(axis=0), start_information(PATH, LOG))


def test_simulated_errors_go_on_in_time():
    """Made of independent numbers by L, they have covariance L L' = c^(|t_i - t_j| rate)."""
    times = np.array([0.0, 0.1, 0.1, 1.7, 1.75, 4.0])
    model = PerStepSystem(od.System(od.Unicycle(), SENSORS[:1])).model
    columns = [measurement_noise(model, unit[:, None], np.zeros(1), np.ones((6, 1), bool), times=times).varying[:, 0] for unit in np.eye(6)]
    L = np.column_stack(columns)
    np.testing.assert_allclose(L @ L.T, 0.6 ** (2.0 * np.abs(times[:, None] - times)), atol=1e-12)


def test_filters_are_consistent_with_errors_that_last_along_steps_of_any_length():
    sensors = (od.Range((20.0, 0.0), 0.3, name="a", correlation=0.9, rate=0.5), od.Range((0.0, 20.0), 0.5, name="b"))
    system, lengths = od.System(od.Unicycle(), sensors), np.tile([0.05, 1.5], 8)
    path = od.simulate(system, PATH.x[0], np.tile([1.5, 0.15], (16, 1)), lengths)
    times = np.random.default_rng(1).uniform(path.t[0], path.t[-1] - 0.01, 40)
    read = od.LogSamples(("a", "b"), times, np.arange(40) % 2, np.ones(40))
    log = od.Log(od.LogInputs(("speed", "turn_rate"), path.t[:-1], path.u), read)
    prior = od.Prior(path.x[0], std=(0.1, 0.1, 0.01))  # narrow: what is tested is not how far ranges are from linear
    for samples, schedule in ((log, None), (None, np.ones((16, 2), dtype=bool))):
        assert od.validate(system, path, schedule, prior=prior, runs=150, samples=samples).verdict == "consistent"
