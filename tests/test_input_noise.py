"""White noise of known inputs, and noise that grows with the speed: closed forms, and systems that say the same in another way."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

import obsdesign as od
from obsdesign.design.nlp.information_recursion import posterior_recursion
from obsdesign.information import root_recursion
from obsdesign.packing import unpack

SYSTEM = od.System(od.Unicycle(), (od.Range((30.0, 40.0), 0.5, name="a"), od.Range((-20.0, 10.0), 0.5, name="b")))
STRAIGHT = od.simulate(SYSTEM, [0.0, 0.0, 0.0], np.tile([2.0, 0.0], (100, 1)), 0.1)
UNEVEN = od.simulate(SYSTEM, [0.0, 0.0, 0.3], np.tile([2.0, 0.1], (40, 1)), np.random.default_rng(0).uniform(0.02, 0.4, 40))
SURE = od.Prior([0.0, 0.0, 0.0], std=(1e-3, 1e-3, 1e-4))
NOTHING = np.zeros((100, 2), dtype=bool)
BOTH = {"speed": 0.04, "turn_rate": 0.01}


def covariance(path: od.Trajectory, **psds: object) -> np.ndarray:
    """What a start that is nearly known becomes without a sample."""
    J = od.posterior_information(SYSTEM, path, SURE, active=np.zeros((path.steps, 2), dtype=bool), **psds)  # pyright: ignore
    return np.linalg.inv(J)


def test_speed_noise_on_a_straight_line_is_a_random_walk_along_it():
    P = covariance(STRAIGHT, input_psd={"speed": 0.04})
    np.testing.assert_allclose(P[:, 0, 0], 1e-6 + 0.04 * STRAIGHT.t, rtol=1e-9)
    np.testing.assert_allclose(P[:, 1, 1], 1e-6 + 1e-8 * (2.0 * STRAIGHT.t) ** 2, rtol=1e-9)


def test_turn_rate_noise_on_a_straight_line_is_a_random_walk_of_the_heading_and_its_integral_across():
    # held over steps h, each turns half a step early: v^2 psd sum h (t - t_k - h / 2)^2 = v^2 psd (t^3 / 3 - h^2 t / 12)
    t, h, v, psd = STRAIGHT.t, 0.1, 2.0, 0.01
    P = covariance(STRAIGHT, input_psd={"turn_rate": psd})
    np.testing.assert_allclose(P[:, 2, 2], 1e-8 + psd * t, rtol=1e-9)
    np.testing.assert_allclose(P[:, 1, 1], 1e-6 + 1e-8 * (v * t) ** 2 + v**2 * psd * (t**3 / 3 - h**2 * t / 12), rtol=1e-7)
    np.testing.assert_allclose(P[:, 1, 2], 1e-8 * v * t + v * psd * t**2 / 2, rtol=1e-7)


def test_noise_per_speed_grows_with_the_way_whatever_the_steps_are():
    way = np.concatenate([[0.0], np.cumsum(UNEVEN.lengths * 2.0)])
    P = covariance(UNEVEN, disturbance_psd=od.PerSpeed((0.0, 0.0, 0.3), at_rest=(0.0, 0.0, 0.2)))
    np.testing.assert_allclose(P[:, 2, 2], 1e-8 + 0.3 * way + 0.2 * UNEVEN.t, rtol=1e-9)
    turning = covariance(UNEVEN, input_psd={"turn_rate": od.PerSpeed(0.3, at_rest=0.2)})
    np.testing.assert_allclose(turning[:, 2, 2], P[:, 2, 2], rtol=1e-9)


@pytest.mark.parametrize("path", [STRAIGHT, UNEVEN], ids=["equal steps", "steps of any length"])
def test_per_speed_at_a_constant_speed_is_the_same_without(path: od.Trajectory):
    plain = {"disturbance_psd": (0.02, 0.01, 0.03), "input_psd": BOTH}
    growing = {
        "disturbance_psd": od.PerSpeed((0.01, 0.005, 0.015)),
        "input_psd": {name: od.PerSpeed(psd / 2) for name, psd in BOTH.items()},
    }
    first, second = (od.posterior_information(SYSTEM, path, SURE, **psds) for psds in (plain, growing))  # pyright: ignore
    np.testing.assert_allclose(first, second, rtol=1e-8)


@dataclass(frozen=True)
class Cart:
    """x'' = u: a step adds (h^2 / 2, h) of its mean input."""

    step: float = 0.2
    unknown: tuple[str, ...] = ("w",)

    @property
    def system(self) -> od.ControlAffineSystem:
        x = ca.SX.sym("x", 2)
        return od.ControlAffineSystem(
            state=x,
            names=("x", "v"),
            drift=ca.vertcat(x[1], 0),
            known={"u": ca.SX([0.0, 1.0])},
            unknown={name: ca.SX([1.0, 0.0]) for name in self.unknown},
            outputs={"place": x[0]},
            sigmas={"place": 0.5},
        )

    @property
    def path(self) -> od.Trajectory:
        return od.simulate(self.system, [0.0, 1.0], np.ones((30, 1)), self.step)

    @property
    def Q(self) -> np.ndarray:
        b = np.array([self.step / 2, 1.0])
        return 0.3 * np.outer(b, b)  # B psd dt B' / dt


def test_where_the_input_enters_linearly_its_noise_is_a_matrix_of_the_state():
    cart, prior = Cart(), od.Prior([0.0, 1.0], std=(1.0, 1.0))
    arguments = cart.system, cart.path, prior
    for unknown in ((), ("w",)):
        expected = od.posterior_information(*arguments, cart.Q, unknown)
        np.testing.assert_allclose(od.posterior_information(*arguments, None, unknown, input_psd={"u": 0.3}), expected, rtol=1e-8)
    info = od.unknown_input_information(*arguments, cart.Q, ("w",))
    np.testing.assert_allclose(od.unknown_input_information(*arguments, None, ("w",), input_psd={"u": 0.3}), info, rtol=1e-7, atol=1e-9)
    psds = ({"disturbance_psd": cart.Q}, {"input_psd": {"u": 0.3}})
    chosen = [od.select_for_filter(*arguments, segment=1.2, **psd) for psd in psds]  # pyright: ignore
    assert chosen[0].value == pytest.approx(chosen[1].value, rel=1e-9)
    require = (od.Requirement(about=("x",), at_most=0.4, after=2.4),)
    cheap = [od.cheapest_schedule(*arguments, require=require, segment=1.2, **psd) for psd in psds]  # pyright: ignore
    assert cheap[0].value == cheap[1].value and np.array_equal(cheap[0].chosen, cheap[1].chosen)
    ahead = [od.select_next(cart.system, prior, np.ones((12, 1)), 0.2, segment=1.2, **psd) for psd in psds]  # pyright: ignore
    assert ahead[0].value == pytest.approx(ahead[1].value, rel=1e-9)


@pytest.mark.parametrize("psd", [{"turn_rate": 0.02}, {"speed": od.PerSpeed(0.02), "turn_rate": od.PerSpeed(0.01, at_rest=0.01)}])
def test_a_posterior_criterion_knows_of_it(psd: dict[str, float | od.PerSpeed]):
    """The program's own recursion, which adds up along the path, reads the same number as the posterior of the path."""
    prior = od.Prior([0.0, 0.0, 0.0], std=(2.0, 2.0, 0.2))
    problem = od.DesignProblem(
        system=SYSTEM,
        start=(0.0, 0.0, 0.0),
        duration=4.0,
        step=0.5,
        path=od.PiecewiseConstant(pieces=2),
        bounds={"speed": (1.0, 2.0), "turn_rate": (-0.5, 0.5)},
        criterion=od.Posterior(prior, input_psd=psd),
    )
    u = np.array([[1.0, 0.4]] * 4 + [[2.0, -0.2]] * 4)
    path = od.simulate(SYSTEM, [0.0, 0.0, 0.0], u, 0.5)
    J = od.posterior_information(SYSTEM, path, prior, input_psd=psd)[-2]
    assert problem.value(path) == pytest.approx(np.linalg.eigvalsh(J)[0], rel=1e-9)
    recursion = posterior_recursion(SYSTEM.model, 0.5, problem.criterion.knowledge, 1)  # pyright: ignore
    advance = ca.Function("advance", [recursion.z, recursion.u, recursion.due], [recursion.z_next, recursion.gain])
    z, total = np.concatenate([path.x[0], recursion.start]), 0.0
    for k in range(8):
        z, gain = advance(z, u[k], [1.0, 1.0, float(k == 7)])
        total = total + np.array(gain).ravel()
    np.testing.assert_allclose(unpack(total, 3), J, rtol=1e-6)


@pytest.mark.parametrize(
    "estimator",
    [od.ExtendedKalmanFilter(), od.UnscentedKalmanFilter(), od.FixedIntervalSmoother(od.ExtendedKalmanFilter())],
    ids=["EKF", "UKF", "smoother"],
)
def test_filters_know_of_it(estimator: object):
    cart, prior = Cart(), od.Prior([0.0, 1.0], std=(1.0, 1.0))
    y = np.random.default_rng(1).standard_normal((30, 1))
    psds = ({"disturbance_psd": cart.Q}, {"input_psd": {"u": 0.3}})
    first, second = (od.estimate_states(cart.system, prior, cart.path.u, y, 0.2, estimator=estimator, **psd) for psd in psds)  # pyright: ignore
    np.testing.assert_allclose(first.mean, second.mean, rtol=1e-8)
    np.testing.assert_allclose(first.covariance, second.covariance, rtol=1e-8, atol=1e-12)


def test_a_filter_along_the_truth_says_what_the_bound_says():
    # samples without errors: the estimate is the truth, where the bound is taken
    y = np.stack(
        [np.hypot(30.0 - UNEVEN.x[:-1, 0], 40.0 - UNEVEN.x[:-1, 1]), np.hypot(-20.0 - UNEVEN.x[:-1, 0], 10.0 - UNEVEN.x[:-1, 1])], axis=1
    )
    prior = od.Prior(UNEVEN.x[0], std=(1.0, 1.0, 0.2))
    psds = {"disturbance_psd": od.PerSpeed((1e-3, 0.0, 0.0)), "input_psd": {"speed": od.PerSpeed(0.02, at_rest=0.01), "turn_rate": 0.01}}
    estimate = od.estimate_states(SYSTEM, prior, UNEVEN.u, y, UNEVEN.lengths, active=np.ones((40, 2), dtype=bool), **psds)
    J = od.posterior_information(SYSTEM, UNEVEN, prior, active=np.ones((40, 2), dtype=bool), **psds)
    np.testing.assert_allclose(estimate.covariance, np.linalg.inv(J), rtol=1e-7, atol=1e-12)
    log = od.Log(
        od.LogInputs(("speed", "turn_rate"), UNEVEN.t[:-1], UNEVEN.u),
        od.LogSamples(("a", "b"), np.repeat(UNEVEN.t[:-1], 2), np.tile([0, 1], 40), y.ravel()),
    )
    of_log = od.posterior_information(SYSTEM, UNEVEN, prior, samples=log, **psds)
    np.testing.assert_allclose(of_log, J, rtol=1e-8, atol=1e-9)
    by_log = od.estimate_log(SYSTEM, log, prior, **psds)
    np.testing.assert_allclose(by_log.covariance[:40], estimate.covariance[:40], rtol=1e-8, atol=1e-12)


def test_runs_of_a_filter_err_as_the_bound_says():
    psds = {"disturbance_psd": od.PerSpeed((1e-3, 1e-3, 0.0)), "input_psd": {"speed": 0.05, "turn_rate": od.PerSpeed(0.002)}}
    prior = od.Prior([0.0, 0.0, 0.0], std=(0.5, 0.5, 0.05))
    check = od.validate(SYSTEM, STRAIGHT, prior=prior, runs=100, seed=1, **psds)
    assert check.consistent and abs(check.rmse[-1] / check.bound[-1] - 1).max() < 0.25
    driven = od.Trajectory(STRAIGHT.t, STRAIGHT.x + 0.01 * np.sin(STRAIGHT.t)[:, None], STRAIGHT.u)  # does what no input tells of
    assert od.validate(SYSTEM, driven, prior=prior, runs=100, seed=1, **psds).consistent


def test_a_flight_errs_by_it_and_its_filter_knows():
    cart, prior = Cart(unknown=()), od.Prior([0.0, 1.0], std=(1.0, 1.0))
    problem = od.DesignProblem(cart.system, (0.0, 1.0), 1.0, 0.2, od.PiecewiseConstant(1), {"u": (-1.0, 1.0)})
    psds = ({"disturbance_psd": cart.Q}, {"input_psd": {"u": 0.3}})
    flights = [od.fly(problem, prior, every=0.6, duration=1.2, seed=1, **psd) for psd in psds]  # pyright: ignore
    np.testing.assert_allclose(flights[0].std, flights[1].std, rtol=1e-9)
    assert abs(flights[1].truth - od.fly(problem, prior, every=0.6, duration=1.2, seed=1).truth).max() > 0.01


def test_long_numbers_and_doubles_agree(monkeypatch: pytest.MonkeyPatch):
    psds = {"disturbance_psd": od.PerSpeed((1e-3, 0.0, 0.0)), "input_psd": BOTH}
    short, active = UNEVEN.part(0, 8), np.ones((8, 2), dtype=bool)
    J = od.posterior_information(SYSTEM, short, SURE, active=active, **psds)  # pyright: ignore
    monkeypatch.setattr(root_recursion, "_is_rounding_claimed", lambda *_: True)
    np.testing.assert_allclose(od.posterior_information(SYSTEM, short, SURE, active=active, **psds), J, rtol=1e-9)  # pyright: ignore


@pytest.mark.parametrize(
    ("psds", "words"),
    [
        ({"input_psd": {"spead": 0.1}}, "spead"),
        ({"input_psd": {"speed": -0.1}}, "input_psd: speed"),
        ({"input_psd": {"speed": od.PerSpeed((0.1, 0.2))}}, "one number"),
        ({"disturbance_psd": od.PerSpeed(0.1)}, "shape"),
        ({"disturbance_psd": od.PerSpeed((0.1, -0.1, 0.0))}, "positive semidefinite"),
    ],
)
def test_what_is_no_noise_is_refused_by_name(psds: dict[str, object], words: str):
    with pytest.raises(od.InputError, match=words):
        od.posterior_information(SYSTEM, STRAIGHT, SURE, **psds)  # pyright: ignore


def test_noise_per_speed_needs_a_place():
    x = ca.SX.sym("x", 1)
    system = od.ControlAffineSystem(state=x, names=("level",), drift=-x, known={}, unknown={}, outputs={"y": x}, sigmas={"y": 1.0})
    path = od.simulate(system, [1.0], np.zeros((5, 0)), 0.1)
    with pytest.raises(od.InputError, match="no 'x'"):
        od.posterior_information(system, path, od.Prior([1.0], std=(1.0,)), od.PerSpeed((0.1,)))
    with pytest.raises(od.InputError, match="finite"):
        od.PerSpeed((float("nan"),))
