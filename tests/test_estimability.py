"""Which states a path teaches: closed forms of Gaussian least squares, and brute force for what a measurement takes away."""

import casadi as ca
import numpy as np
import pytest

import obsdesign as od


def constant_system(*outputs, sigma=1.0):
    """Constant states of which some forms are measured."""
    n = len(outputs[0])
    x = ca.SX.sym("x", n)
    forms = {f"y{k}": ca.DM(list(row)).T @ x for k, row in enumerate(outputs)}
    return od.ControlAffineSystem(x, tuple("abcd"[:n]), outputs=forms, sigmas=dict.fromkeys(forms, sigma))


def at_rest(n, steps=4):
    return od.Trajectory(np.arange(steps + 1.0), np.zeros((steps + 1, n)), np.zeros((steps, 0)))


def test_a_sum_of_two_constants_teaches_neither_and_measuring_one_gives_the_other():
    # N samples of a + b: P = I - N/(1 + 2 N) 11', prior I; P_ab^2 / (P_aa P_bb) = (N / (N + 1))^2
    steps = 4
    found = od.estimability(constant_system((1, 1)), at_rest(2, steps), od.Prior(mean=(0, 0), std=(1, 1)))
    assert np.allclose(found.ratio, np.sqrt(1 - steps / (1 + 2 * steps)))
    assert np.allclose(found.gain, (steps / (steps + 1)) ** 2)


def test_what_no_output_contains_is_to_be_dropped():
    found = od.estimability(constant_system((1, 0, 0), (1, 1, 0)), at_rest(3), od.Prior(mean=(0, 0, 0), std=(1, 2, 3)))
    assert found.ratio[2] == pytest.approx(1.0)
    assert (found.to_drop, found.ranking[-1]) == ("c", "c")
    assert found.gain[2] == pytest.approx(0.0, abs=1e-12)
    assert "drop first" in str(found)


@pytest.mark.parametrize("seed", range(5))
def test_the_gain_is_that_of_a_measurement_without_noise(seed):
    # least squares: a state that is known leaves the unknowns, and its row and column the information
    generator = np.random.default_rng(seed)
    outputs, std = generator.normal(size=(2, 4)), generator.uniform(0.5, 3, 4)
    system, path, prior = constant_system(*outputs), at_rest(4), od.Prior(mean=np.zeros(4), std=std)
    found = od.estimability(system, path, prior)
    J = np.diag(std**-2.0) + 4 * outputs.T @ outputs
    assert np.allclose(found.std[-1], np.sqrt(np.diag(np.linalg.inv(J))))
    for i in range(4):
        others = [j for j in range(4) if j != i]
        before = (np.diag(np.linalg.inv(J)) / std**2)[others].sum()
        sharp = np.linalg.inv(J[np.ix_(others, others)])
        assert found.gain[i] == pytest.approx(1 - (np.diag(sharp) / std[others] ** 2).sum() / before)
    assert found.to_measure == system.names[int(found.gain.argmax())]


def test_units_do_not_change_the_ranking():
    generator = np.random.default_rng(3)
    outputs, std, units = generator.normal(size=(2, 3)), generator.uniform(0.5, 3, 3), np.array([1e6, 1.0, 1e-5])
    first = od.estimability(constant_system(*outputs), at_rest(3), od.Prior(mean=np.zeros(3), std=std))
    second = od.estimability(constant_system(*(outputs / units)), at_rest(3), od.Prior(mean=np.zeros(3), std=std * units))
    assert first.ranking == second.ranking
    assert np.allclose(first.ratio, second.ratio)
    assert np.allclose(first.gain, second.gain)


def test_a_straight_flight_with_gps_learns_the_heading_least():
    # TRUTHS E: heading behind the wind: of the combination that is hidden nothing is learned, however long the flight
    system = od.System(od.Dubins(speed=15.0, wind="constant"), (od.GPS(sigma=2.0),))
    prior = od.Prior(mean=(0, 0, 0, 0, 0), std=(50, 50, 0.1, 5, 5))
    ratios = []
    for turn_rate in (0.0, 0.2):
        path = od.simulate(system, (0, 0, 0, 3, -2), np.full((200, 1), turn_rate), 0.5)
        ratios.append(od.estimability(system, path, prior).ratio[2])
    # straight along x: heading error theta against v theta of wind_y, prior 0.1 and 5: what the velocity tells is shared
    assert ratios[0] == pytest.approx(np.sqrt(1 - (15 * 0.1) ** 2 / ((15 * 0.1) ** 2 + 5**2)), rel=1e-3)
    assert ratios[1] < 0.1 * ratios[0]
