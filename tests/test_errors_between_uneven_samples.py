"""Errors that decay over time, at samples any time apart: exact covariances, and equal steps seen as steps of any length."""

import numpy as np
import pytest

import obsdesign as od
from obsdesign.information import root_recursion
from obsdesign.trajectory import uneven_path_of

RANDOM = np.random.default_rng(0)
LENGTHS = RANDOM.uniform(0.05, 3.0, 12)


def level(**noise: float) -> od.System:
    """A parked vehicle whose x is read."""
    return od.System(od.Unicycle(), (od.GPS(0.5, **noise),))  # pyright: ignore


PARKED = od.simulate(level(rate=2.0), [1.0, 2.0, 0.0], np.zeros((12, 2)), LENGTHS)
PRIOR = od.Prior([1.0, 2.0, 0.0], std=(2.0, 3.0, 0.1))
ACTIVE = (np.arange(12) % 3 != 1)[:, None]


@pytest.mark.parametrize("bias", [0.0, 0.3])
@pytest.mark.parametrize("is_long", [False, True], ids=["doubles", "long numbers"])
def test_what_stands_still_is_known_as_all_samples_at_once_say(bias: float, is_long: bool, monkeypatch: pytest.MonkeyPatch):
    """R_ij = s^2 phi^(|t_i - t_j| / period) + b^2, J = 1 / P_0 + 1' R^-1 1."""
    if is_long:
        monkeypatch.setattr(root_recursion, "_is_rounding_claimed", lambda *_: True)
    psd = (1e-30, 1e-30, 0.0) if is_long else None  # so that rounding is looked at
    J = od.posterior_information(level(rate=2.0, correlation=0.7, bias_floor=bias), PARKED, PRIOR, psd, active=ACTIVE)
    for k in range(12):
        t = PARKED.t[: k + 1][ACTIVE[: k + 1, 0]]
        R = 0.25 * 0.7 ** (np.abs(t[:, None] - t) / 0.5) + bias**2
        assert J[k, 0, 0] == pytest.approx(1 / 4 + np.linalg.inv(R).sum(), rel=1e-9)
        assert J[k, 1, 1] == pytest.approx(1 / 9 + np.linalg.inv(R).sum(), rel=1e-9)


def test_a_filter_knows_as_much_as_the_bound_says():
    system = level(rate=2.0, correlation=0.7, bias_floor=0.3)
    psd = (0.01, 0.02, 0.0)
    J = od.posterior_information(system, PARKED, PRIOR, psd, active=ACTIVE)
    y = np.tile([1.0, 2.0], (12, 1))
    estimate = od.estimate_states(system, PRIOR, PARKED.u, y, LENGTHS, active=ACTIVE, disturbance_psd=psd)
    np.testing.assert_allclose(estimate.covariance, np.linalg.inv(J), rtol=1e-8, atol=1e-12)


def test_samples_of_a_log_are_as_correlated_as_the_time_between_them_says():
    system = level(rate=2.0, correlation=0.7)
    times = PARKED.t[:-1] + np.array([0.0, 0.3] * 6) * LENGTHS  # some at nodes, some between
    samples = od.LogSamples(("gps",), times, np.zeros(12), np.tile([1.0, 2.0], (12, 1)))
    log = od.Log(od.LogInputs(("speed", "turn_rate"), PARKED.t[:-1], PARKED.u), samples)
    J = od.posterior_information(system, PARKED, PRIOR, samples=log)
    R = 0.25 * 0.7 ** (np.abs(times[:, None] - times) / 0.5)
    assert J[-1, 0, 0] == pytest.approx(1 / 4 + np.linalg.inv(R).sum(), rel=1e-9)
    estimate = od.estimate_log(system, log, PRIOR)
    np.testing.assert_allclose(np.linalg.inv(estimate.covariance[-1]), J[-1], rtol=1e-6, atol=1e-9)


def test_equal_steps_seen_as_steps_of_any_length_are_the_same():
    sensors = (
        od.GPS(2.0, rate=1.0, correlation=0.8),
        od.Range((50.0, 20.0), 1.0, rate=2.0, correlation=0.5, bias_floor=0.4),
        od.Magnetometer(0.1),
    )
    system = od.System(od.Dubins(5.0, wind="constant"), sensors, joint_noise={})
    path = od.simulate(system, [0.0, 0.0, 0.1, 1.0, -1.0], np.full((30, 1), 0.2), 0.5)
    prior, psd = od.Prior(path.x[0], std=(3.0, 3.0, 0.2, 1.0, 1.0)), (0.01, 0.01, 1e-4, 1e-3, 1e-3)
    active = np.stack([np.arange(30) % 2 == 0, np.ones(30, dtype=bool), np.ones(30, dtype=bool)], axis=1)
    seen = uneven_path_of(path, path.t, path.x, path.u, None)
    J = od.posterior_information(system, path, prior, psd)
    np.testing.assert_allclose(od.posterior_information(system, seen, prior, psd, active=active), J, rtol=1e-6)


def test_over_how_long_errors_are_correlated_has_to_be_said():
    with pytest.raises(od.InputError, match="no rate"):
        od.posterior_information(level(correlation=0.7), PARKED, PRIOR, active=ACTIVE)
    with pytest.raises(od.InputError, match="posterior_information, filters, validate and Gramians of a log accept that"):
        od.variational_gramian(level(rate=2.0, correlation=0.7), PARKED)
