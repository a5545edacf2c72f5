"""Steps of any length: what equal steps give they give too, and cutting a step changes nothing but where one looks."""

import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign as od
from obsdesign.trajectory import Trajectory

WIND = od.System(
    od.Dubins(15.0, wind="constant"),
    (od.GPS(2.0), od.Range((500.0, 200.0), 1.0, bias_floor=0.3), od.Bearing((300.0, -100.0), 0.05)),
)
GUSTS = od.System(od.Dubins(15.0, wind="unknown"), (od.GPS(2.0), od.Range((500.0, 200.0), 1.0)))
START, TURN = np.array([0.0, 0.0, 0.3, 3.0, -2.0]), 0.2 * np.sin(np.arange(40) / 5)[:, None]
PRIOR, PSD = od.Prior(START, std=(50.0, 50.0, 0.1, 5.0, 5.0)), (0.1, 0.1, 0.001, 0.01, 0.01)


def counted_in_steps(path):
    """The same even path, taken as one of steps of different lengths."""
    same = Trajectory(path.t, path.x, path.u, path.w, path.tolerance)
    vars(same)["is_even"] = False
    return same


QUESTIONS = {
    "gramian": lambda system, path: od.variational_gramian(system, path).blocks,
    "gramian of white errors": lambda system, path: od.variational_gramian(GUSTS, path3(path)).blocks,
    "transition": lambda system, path: od.variational_gramian(system, path).transition,
    "integral": lambda system, path: od.variational_gramian(system, path, weighted=False).blocks,
    "standard deviations": lambda system, path: od.variational_gramian(system, path).std,
    "posterior": lambda system, path: od.posterior_information(system, path, PRIOR, PSD),
    "windows": lambda system, path: od.sliding_information(system, path, 8),
    "segments": lambda system, path: od.segment_information(system, path, 5),
    "shares": lambda system, path: od.contributions(system, od.variational_gramian(system, path), 5).shares,
    "unknown inputs": lambda system, path: od.posterior_information(GUSTS, path3(path), PRIOR3, PSD[:3], ("wind_x", "wind_y")),
    "about unknown inputs": lambda system, path: od.unknown_input_information(GUSTS, path3(path), PRIOR3, PSD[:3], ("wind_x", "wind_y")),
}
PRIOR3 = od.Prior(START[:3], std=(50.0, 50.0, 0.1))


def path3(path):
    lengths = path.lengths if not path.is_even else path.step
    even = od.simulate(GUSTS, START[:3], TURN, float(np.mean(lengths)))
    return even if path.is_even else counted_in_steps(even)


@pytest.mark.parametrize("question", QUESTIONS)
def test_equal_steps_taken_for_uneven_ones_give_the_same(question):
    path = od.simulate(WIND, START, TURN, 0.5)
    even, uneven = QUESTIONS[question](WIND, path), QUESTIONS[question](WIND, counted_in_steps(path))
    scale = np.abs(even).max()
    assert uneven == pytest.approx(even, rel=1e-9, abs=1e-12 * scale, nan_ok=True)


def test_steps_of_different_lengths_follow_a_linear_motion_exactly():
    """x'' = u, y = x: Phi(t) = exp(A t), so W is a sum over the instants, and J that of a Kalman filter with Q = psd dt."""
    import casadi as ca

    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(
        state=x, names=("x", "v"), drift=ca.vertcat(x[1], 0), known={"u": ca.vertcat(0, 1)}, outputs={"y": x[0]}, sigmas={"y": 0.5}
    )
    dt = np.array([0.1, 1.3, 0.02, 0.7, 2.0])
    path = od.simulate(system, [1.0, -1.0], np.array([[0.3], [-1.0], [0.5], [0.0], [2.0]]), dt)
    A, C = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0]])
    W = sum((C @ expm(A * t)).T @ (C @ expm(A * t)) / 0.25 for t in path.t[:-1])
    assert od.variational_gramian(system, path).total == pytest.approx(W, rel=1e-12)
    prior, psd, J = od.Prior([1.0, -1.0], std=(2.0, 3.0)), np.array([0.1, 0.4]), []
    P = prior.covariance
    for length in dt:
        P = np.linalg.inv(np.linalg.inv(P) + C.T @ C / 0.25)
        J.append(np.linalg.inv(P))
        P = expm(A * length) @ P @ expm(A * length).T + np.diag(psd) * length
    assert od.posterior_information(system, path, prior, psd) == pytest.approx(np.array([*J, np.linalg.inv(P)]), rel=1e-10)
    position, v = np.array([1.0, -1.0]), path.u[:, 0]
    for k, length in enumerate(dt):
        position = np.array([position[0] + length * position[1] + v[k] * length**2 / 2, position[1] + length * v[k]])
        assert path.x[k + 1] == pytest.approx(position, rel=1e-12)


def test_unix_times_and_their_rounding_are_equal_steps():
    path = od.simulate(WIND, START, TURN, 0.1)
    later = Trajectory(path.t + 1.7e9, path.x, path.u)
    assert later.is_even
    assert later.step == pytest.approx(0.1, rel=1e-6)


def test_what_needs_equal_steps_says_so():
    path = od.simulate(WIND, START, TURN, np.where(np.arange(40) % 2, 0.5, 0.7))
    with pytest.raises(od.InputError, match=r"its steps are 0\.5 to 0\.7 s long: for this they must be equal"):
        path.step  # noqa: B018
    slow = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0, rate=1.0),))
    with pytest.raises(od.InputError, match="'gps' has a rate of 1 Hz: along steps of different lengths say which samples"):
        od.variational_gramian(slow, path)
    lasting = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0, correlation=0.5),))
    with pytest.raises(od.InputError, match=r"'gps' has errors of correlation 0\.5"):
        od.posterior_information(lasting, path, PRIOR)
    with pytest.raises(od.InputError, match=r"dt has shape \(3,\): must be one number or \(40,\)"):
        od.simulate(WIND, START, TURN, [1.0, 2.0, 3.0])
    with pytest.raises(od.InputError, match=r"dt\[1\] is -1.0: must be a finite number above 0"):
        od.simulate(WIND, START, TURN[:2], [1.0, -1.0])
