"""Where few schedules are possible the best of them is proven, however much rounding takes off the bounds of a search."""

from __future__ import annotations

import warnings
from typing import Any, Literal

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign as od


def _integrators(rates: tuple[float, ...], pushed: bool = False) -> od.ControlAffineSystem:
    """dx_i = rate_i x_i (+ w for the first), each state measured by a sensor of its own, sigma 1e-6."""
    n = len(rates)
    x = ca.SX.sym("x", n)
    return od.ControlAffineSystem(
        x,
        tuple(f"x{i}" for i in range(n)),
        ca.DM(np.diag(rates)) @ x,
        unknown={"w": ca.SX(np.eye(n)[:, :1])} if pushed else {},
        outputs={f"y{i}": x[i] for i in range(n)},
        sigmas={f"y{i}": 1e-6 for i in range(n)},
    )


def _ask(system: od.ControlAffineSystem, steps: int, std: float, **options: Any) -> od.FilterSchedule:
    n = len(system.model.state_names)
    path = od.simulate(system, np.zeros(n), np.zeros((steps, 0)), 1.0)
    prior = od.Prior(np.zeros(n), std=np.full(n, std))
    return od.select_for_filter(system, path, prior, disturbance_psd=np.ones(n), throw=False, **options)


def test_one_segment_is_proven_exactly_where_a_sample_leaves_no_digit_of_a_covariance() -> None:
    """Prior 1e9, samples 1e-6: 30 digits apart. On one instant the best is to measure one of two: 1e18 + 1e-12, whichever."""
    schedule = _ask(_integrators((0.0, 0.0)), 1, 1e9, segment=1.0, gap=0.0)
    assert (schedule.status, schedule.gap) == (od.Status.OPTIMAL, 0.0)
    assert schedule.bound == schedule.value == pytest.approx(1e18)


def test_a_single_sensor_is_proven_exactly() -> None:
    """With one sensor that is free there is one schedule: it is on. After each sample P = 1e-12 m / (m + 1e-12), m = P + 1 before it."""
    schedule = _ask(_integrators((0.0,)), 6, 1e9, segment=2.0, gap=0.0)
    assert schedule.chosen.all()
    assert (schedule.status, schedule.gap) == (od.Status.OPTIMAL, 0.0)
    assert schedule.value == pytest.approx(1e-12, rel=1e-9)


def test_unknown_inputs_are_no_obstacle() -> None:
    """Pushed by an unknown input, x0 is known by its last sample alone: 1e-12 on, nothing known off; all 16 schedules are tried."""
    schedule = _ask(_integrators((0.0, 0.0), pushed=True), 4, 1.0, segment=1.0, gap=0.0, unknown_inputs=("w",), about=("x0",))
    assert schedule.chosen[:, 0].all()
    assert (schedule.status, schedule.gap) == (od.Status.OPTIMAL, 0.0)
    assert schedule.value == pytest.approx(1e-12, rel=1e-6)


def test_the_cheapest_of_few_is_proven_with_unknown_inputs() -> None:
    """x0 is required at every instant and forgotten at once: its sensor is on in all four segments, and that is all that is needed."""
    system = _integrators((0.0, 0.0), pushed=True)
    path, prior = od.simulate(system, np.zeros(2), np.zeros((4, 0)), 1.0), od.Prior(np.zeros(2), std=(1.0, 1.0))
    require = od.Requirement(("x0",), 1e-6)
    cheap = od.cheapest_schedule(system, path, prior, require, segment=1.0, disturbance_psd=(1.0, 1.0), unknown_inputs=("w",), gap=0.0)
    assert (cheap.status, cheap.value, cheap.bound) == (od.Status.OPTIMAL, 3.0, 3.0)  # t_0 is not later than 0 s


@pytest.mark.parametrize("over", ["mean", "worst"])
def test_covariances_beyond_all_numbers_leave_a_bound(over: Literal["mean", "worst"]) -> None:
    """e^(8 t) unseen for 200 s is no double any more: no warning, and what is said is true; a state seen in time keeps its proof."""
    system = _integrators((8.0, 8.0))
    active = np.repeat([[1, 0]], 100, axis=0)
    path, prior = od.simulate(system, np.zeros(2), np.zeros((100, 0)), 0.5), od.Prior(np.zeros(2), std=(1.0, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lost = od.select_for_filter(system, path, prior, segment=5.0, disturbance_psd=(1.0, 1.0), over=over, active=active)
        kept = od.select_for_filter(system, path, prior, segment=25.0, disturbance_psd=(1.0, 1.0), over=over, about=("x0",))
    assert lost.bound <= lost.value == np.inf
    assert kept.status is od.Status.OPTIMAL
    assert np.isfinite(kept.value)


@pytest.mark.parametrize("scale", [1e200, 1e-200])
def test_scales_that_leave_no_numbers_are_refused_by_name(scale: float) -> None:
    """(50 / 1e200)^2 is 0 in doubles: every schedule would be perfect."""
    with pytest.raises(od.InputError, match="scale of x1"):
        _ask(_integrators((0.0, 0.0)), 4, 50.0, segment=1.0, scale=(1.0, scale))


def test_nothing_that_the_prior_knows_is_hidden_without_noise():
    """P = F^k P_0 F^k' by NumPy: directions shrink so differently that a root of the information has no digit left of the slow one."""
    V = np.array([[1.0, 1.0, 0.5], [0.3, -1.0, 1.0], [1.0, 0.2, -1.0]])
    A, x = V @ np.diag([-0.2, -2.5, -1.0]) @ np.linalg.inv(V), ca.SX.sym("x", 3)
    system = od.ControlAffineSystem(x, ("a", "b", "c"), drift=ca.DM(A) @ x, outputs={"y": x[0]}, sigmas={"y": 1.0})
    path = od.simulate(system, np.zeros(3), np.zeros((40, 0)), 1.0)
    schedule = od.select_for_filter(
        system, path, od.Prior(np.zeros(3), std=(1.0, 2.0, 3.0)), segment=20.0, rules=(od.Unavailable("y", (0, 1)),)
    )
    P, traces, step = np.diag([1.0, 4.0, 9.0]), [], expm(A)
    for _ in range(40):
        traces.append(np.trace(P))
        P = step @ P @ step.T
    assert schedule.value == pytest.approx(np.mean(traces), rel=1e-6)
    assert schedule.bound <= schedule.value
    assert np.isfinite(schedule.predicted).all()


def test_a_determinant_that_is_rounding_is_none():
    """An unstable state that nobody sees grows by e^58 and moves a stable one, log det P = 2 t tr A (Liouville): a double's rounding."""
    x = ca.SX.sym("x", 2)
    A = np.array([[2.0, 0.0], [1.0, -1.0]])
    system = od.ControlAffineSystem(x, ("a", "b"), drift=ca.DM(A) @ x, outputs={"y": x[0]}, sigmas={"y": 1.0})
    path, closed = od.simulate(system, np.zeros(2), np.zeros((30, 0)), 1.0), (od.MaxUses("y", 0),)
    schedule = od.select_for_filter(
        system, path, od.Prior(np.zeros(2), std=(1.0, 1.0)), segment=10.0, rules=closed, criterion=od.LogDet(), over="end"
    )
    assert schedule.value == np.inf or schedule.value == pytest.approx(2 * 29 * np.trace(A), rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_determinant_far_below_rounding_of_the_covariance_is_that_of_liouville(seed: int):
    """Without noise and samples log det P_k = log det P_0 + 2 t_k tr A: here deviations are e^50 apart."""
    random = np.random.default_rng(seed)
    V = random.normal(size=(3, 3)) + 2 * np.eye(3)
    A, x = V @ np.diag([0.0, -1.25, -2.5]) @ np.linalg.inv(V), ca.SX.sym("x", 3)
    system = od.ControlAffineSystem(x, ("a", "b", "c"), drift=ca.DM(A) @ x, outputs={"y": x[0]}, sigmas={"y": 1.0})
    path, closed = od.simulate(system, np.zeros(3), np.zeros((21, 0)), 1.0), (od.MaxUses("y", 0),)
    schedule = od.select_for_filter(
        system, path, od.Prior(np.zeros(3), std=(1.0, 2.0, 3.0)), segment=7.0, rules=closed, criterion=od.LogDet(), over="end"
    )
    assert schedule.value == pytest.approx(2 * np.log(6.0) + 2 * 20 * np.trace(A), rel=1e-9)
    assert schedule.bound <= schedule.value + 1e-6
