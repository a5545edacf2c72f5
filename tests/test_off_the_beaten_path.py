"""Paths and systems that are not as expected: logs that no model flew, unstable systems, threads, forks, words for numbers."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

import obsdesign as od
from obsdesign.information.gramian import transition_matrices
from obsdesign.sensors._onboard import AbstractOnboard

X0, TURNS = np.array([0.0, 0.0, 0.2, 1.0, -1.0]), np.full((20, 1), 0.1)
ARROW = od.System(od.Dubins(10.0, wind="constant"), (od.GPS(1.0), od.Range((30.0, 40.0), 1.0)))
BLOWN = od.System(od.Dubins(10.0, wind="unknown"), (od.GPS(1.0), od.Range((30.0, 40.0), 1.0)))


def unstable(rate: float) -> od.ControlAffineSystem:
    x = ca.SX.sym("x")
    return od.ControlAffineSystem(x, ("x",), rate * x, outputs={"y": x})


def still(system: od.ControlAffineSystem, start: float, steps: int) -> od.Trajectory:
    return od.simulate(system, [start], np.zeros((steps, 0)), 0.01)


def logged() -> od.Trajectory:
    """A vehicle that stands where its inputs say that it turns and flies."""
    return od.Trajectory(np.arange(21) * 0.1, np.tile([12.0, 3.0, 0.4], (21, 1)), TURNS)


def gusty() -> od.Trajectory:
    return od.simulate(BLOWN, X0[:3], TURNS, 0.1, np.random.default_rng(0).uniform(-9, 9, (20, 2)))


# ---------------------------------------------------------------- paths that the inputs alone do not explain


@pytest.mark.parametrize(
    ("path", "weighted"),
    [(logged(), True), (gusty(), True), (gusty(), False), pytest.param(logged(), False, marks=pytest.mark.slow)],
    ids=["samples of a log", "samples in gusts", "the integral in gusts", "the integral of a log"],
)
def test_both_gramians_are_about_the_path_that_is_given(path: od.Trajectory, weighted: bool):
    """The empirical one tends to the variational one as eps^2 along it, not along what the model would have flown."""
    exact = od.variational_gramian(BLOWN, path, weighted).total
    errors = [np.abs(od.empirical_gramian(BLOWN, path, eps, weighted).total - exact).max() for eps in (0.04, 0.02, 0.01)]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.05)
    other = od.variational_gramian(BLOWN, od.simulate(BLOWN, path.x[0], path.u, path.step), weighted).total
    assert np.abs(other - exact).max() > 0.02 * np.abs(exact).max()


def test_the_integral_along_a_log_is_that_of_a_vehicle_at_rest():
    """Phi stays I where only the position is asked for: t for each coordinate of GPS."""
    W = od.variational_gramian(od.System(BLOWN.vehicle, (od.GPS(1.0),)), logged(), weighted=False).total
    np.testing.assert_allclose(W[:2, :2], 2.0 * np.eye(2), rtol=1e-12)


def test_validation_keeps_to_the_path_that_is_given():
    """Of a log that tells nothing of the gusts as well: truth is the path, and the bound that of the samples along it."""
    gusts, prior = gusty(), od.Prior(X0[:3], std=(1.0, 1.0, 0.1))
    path = od.Trajectory(gusts.t, gusts.x, gusts.u)
    covariances = np.linalg.inv(od.posterior_information(BLOWN, path, prior))
    bound = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    np.testing.assert_allclose(od.validate(BLOWN, path, prior=prior, runs=20).bound, bound, rtol=1e-12)
    flown = od.simulate(BLOWN, path.x[0], path.u, path.step)
    assert np.abs(od.validate(BLOWN, flown, prior=prior, runs=20).bound - bound).max() > 1e-3


# ---------------------------------------------------------------- numbers that run away or vanish


def test_a_system_too_unstable_for_double_precision_is_refused_in_words():
    """dx(t_k)/dx(t_0) = e^k, the largest double e^709.78: the first too large is e^710, the first square e^(2 355)."""
    system = unstable(100.0)
    path = still(system, 0.0, 800)
    refused = {
        "the window at step 0 .* not finite": lambda: od.sliding_information(system, path, 700),
        r"dx\(t_k\)/dx\(t_0\) is not finite from step 710": lambda: transition_matrices(system, path),
        "not finite at step 355 .* sensitivity to the start overflows": lambda: od.variational_gramian(system, path),
        "starts.0.: the information is not finite at step 355": lambda: od.batch_information(system, [[0.0]], path.u, path.step),
    }
    for message, ask in refused.items():
        with pytest.raises(od.InputError, match=message):
            ask()


def test_a_path_that_forgets_its_start_says_nothing_of_its_end_by_inversion():
    system = unstable(-100.0)
    with pytest.raises(od.InputError, match="the path forgets its start"):
        _ = od.variational_gramian(system, still(system, 1.0, 40_000)).final


@pytest.mark.parametrize("hertz", [12_000.0, 48_000.0])
def test_steps_may_be_of_any_size(hertz: float):
    dt = 1 / 48_000
    system = od.System(od.Dubins(10.0), (od.GPS(1.0, rate=hertz),))
    blocks = od.variational_gramian(system, od.simulate(system, X0[:3], np.zeros((12, 1)), dt)).blocks
    assert np.flatnonzero(blocks[:, 0, 0, 0]).tolist() == list(range(0, 12, round(48_000 / hertz)))


def test_a_perturbation_lost_in_rounding_is_told_to_grow():
    """At 10^9 m a perturbation of 10^-9 m does not move the start at all; GPS is linear, there is no curvature."""
    system = od.System(od.Dubins(10.0), (od.GPS(1.0),))
    found = od.perturbation(system, od.simulate(system, [1e9, 0.0, 0.0], np.zeros((5, 1)), 0.1), 1e-9)
    assert not found.suitable
    assert found.sentence.endswith("take a larger eps")


# ---------------------------------------------------------------- many systems, threads, forks


def test_a_system_outlives_the_caches_of_the_functions_made_for_it():
    """More systems than are kept: what was forgotten and what was not must still fit together."""
    od.batch_information(ARROW, [X0], TURNS, 0.1)
    for speed in np.linspace(5.0, 15.0, 70):
        od.simulate(od.System(od.Dubins(float(speed), wind="constant"), ARROW.sensors), X0, TURNS, 0.1)
    path = od.simulate(ARROW, X0, TURNS, 0.1)
    W = od.variational_gramian(ARROW, path)
    np.testing.assert_allclose(od.segment_information(ARROW, path, 4), W.by_segment(4), rtol=1e-12, atol=1e-12)


def test_threads_may_ask_for_a_new_system_at_the_same_time():
    path = od.simulate(ARROW, X0, TURNS, 0.1)
    failed: list[BaseException] = []
    for k in range(8):
        system, barrier = od.System(od.Dubins(7.0 + k / 9, wind="constant"), ARROW.sensors), threading.Barrier(5)

        def ask(system: od.System = system, barrier: threading.Barrier = barrier):
            barrier.wait()
            try:
                od.variational_gramian(system, path)
                od.batch_information(system, [X0], TURNS, 0.1)
            except BaseException as error:  # noqa: BLE001  # a thread would lose it
                failed.append(error)

        threads = [threading.Thread(target=ask) for _ in range(5)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert not failed


def child(path: od.Trajectory, found: multiprocessing.Queue):
    found.put(od.segment_information(ARROW, path, 1).sum())


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_a_fork_does_not_wait_for_a_thread_that_it_does_not_have():
    path, long = (od.simulate(ARROW, X0, np.full((steps, 1), 0.1), 0.1) for steps in (20, 40_000))
    stop = threading.Event()

    def walk():
        while not stop.is_set():
            od.segment_information(ARROW, long, 1)

    thread = threading.Thread(target=walk)
    thread.start()
    try:
        context = multiprocessing.get_context("fork")
        found = context.Queue()
        processes = [context.Process(target=child, args=(path, found)) for _ in range(4)]
        for process in processes:
            process.start()
        values = [found.get(timeout=30) for _ in processes]
    finally:
        stop.set()
        thread.join()
    np.testing.assert_allclose(values, od.segment_information(ARROW, path, 1).sum(), rtol=1e-14)


# ---------------------------------------------------------------- what is refused


@dataclass(frozen=True, kw_only=True)
class ThreeSpreads(AbstractOnboard):
    """A sensor that gives its two outputs three standard deviations."""

    name: str = "two"

    @property
    def outputs(self) -> tuple[od.Signal, ...]:
        return od.Signal("two_x", "m"), od.Signal("two_y", "m")

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return state["x"], state["y"]

    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        return ca.SX([1.0, 10.0, 100.0])


def test_a_sensor_has_one_spread_or_one_for_each_output():
    with pytest.raises(od.InputError, match=r"sensor 'two': spread has shape \(3, 1\): must be one number, or one for each of its outputs"):
        _ = od.System(od.Dubins(10.0), (ThreeSpreads(1.0),)).model


def test_unknown_inputs_come_in_the_order_in_which_they_are_named():
    path, prior = gusty(), od.Prior(X0[:3], std=(1.0, 1.0, 0.1))
    one, other = (
        od.unknown_input_information(BLOWN, path, prior, unknown_inputs=names) for names in (("wind_x", "wind_y"), ("wind_y", "wind_x"))
    )
    np.testing.assert_allclose(other, one[:, ::-1, ::-1], rtol=1e-8, atol=1e-12)
    assert np.abs(one[:, 0, 0] - one[:, 1, 1]).max() > 1e-6


PRIOR = od.Prior(X0, std=np.ones(5))
PATH = od.simulate(ARROW, X0, TURNS, 0.1)
SKEW = 1e-12 * (np.eye(5) + np.eye(5, k=1))
REFUSED = {
    "words": (lambda: od.simulate(ARROW, "abc", TURNS, 0.1), "x0 is 'abc': must be an array of real numbers"),
    "rows of unequal length": (
        lambda: od.simulate(ARROW, X0, [[0.1], [0.1, 0.2]], 0.1),
        r"u is \[\[0.1\], \[0.1, 0.2\]\]: must be an array",
    ),
    "complex numbers": (lambda: od.simulate(ARROW, X0 + 1j, TURNS, 0.1), "x0 is .*: must be an array of real numbers"),
    "a skew psd in small units": (lambda: od.posterior_information(ARROW, PATH, PRIOR, SKEW), "differs from its transpose by 1e-12"),
    "a psd with nan": (lambda: od.posterior_information(ARROW, PATH, PRIOR, [1, 1, np.nan, 1, 1]), r"disturbance_psd\[2\] is nan"),
    "half a sensor": (lambda: od.posterior_information(ARROW, PATH, PRIOR, active=np.full((20, 2), 0.5)), "active has the entry 0.5"),
    "systems of unequal sensors": (
        lambda: od.batch_information([ARROW, od.System(ARROW.vehicle, ARROW.sensors[:1])], [X0, X0], TURNS, 0.1),
        "the systems have 1 and 2 sensors: all must have the same number",
    ),
    "a trajectory of no times": (lambda: od.Trajectory(0.0, [[0.0]], [[0.0]]), r"t \(\), x \(1, 1\), u \(1, 1\) do not fit"),
}


@pytest.mark.parametrize(("ask", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_what_makes_no_sense_is_refused_by_name(ask: object, message: str):
    with pytest.raises(od.InputError, match=message):
        ask()


def test_one_known_input_may_be_a_flat_list_everywhere():
    flat = TURNS[:, 0]
    np.testing.assert_array_equal(od.batch_information(ARROW, [X0], flat, 0.1), od.batch_information(ARROW, [X0], TURNS, 0.1))
    np.testing.assert_array_equal(od.simulate(ARROW, X0, flat, 0.1).x, PATH.x)
