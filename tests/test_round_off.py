"""Round-off of information, against exact arithmetic (rational numbers) and closed forms."""

from __future__ import annotations

import pickle

import casadi as ca
import flint
import numpy as np
import pytest

import obsdesign as od
from obsdesign.criteria._factor import schur_complement
from obsdesign.round_off import hidden_directions, smallest_eigenvalue, standard_deviations


def _rank(rows: np.ndarray) -> int:
    return flint.fmpq_mat(*rows.shape, [int(value) for value in rows.ravel()]).rank()


def _instances(count: int, seed: int):
    """Integer rows (3 n, n) of known rank, some of them a thousand times as exact as others, and units 1e-12..1e12 of the states."""
    rng = np.random.default_rng(seed)
    for trial in range(count):
        n = int(rng.integers(1, 8))
        k = int(rng.integers(0, n + 1))
        rows = rng.integers(-5, 6, size=(3 * n, k)) @ rng.integers(-3, 4, size=(k, n))
        if trial % 3 == 0:
            rows = rows * 10 ** rng.integers(0, 4, size=(3 * n, 1))
        yield rows, 10.0 ** rng.uniform(-12, 12, n)


def test_what_is_hidden_is_what_exact_arithmetic_says_in_any_units():
    # state i is seen when e_i is a combination of the rows: adding it to them does not raise their rank
    for rows, unit in _instances(300, seed=5):
        n, rank = rows.shape[1], _rank(rows)
        seen = [_rank(np.vstack([rows, np.eye(n, dtype=int)[i]])) == rank for i in range(n)]
        W = np.einsum("ki,kj->ij", rows * unit, rows * unit)
        assert hidden_directions(W).shape == (n, n - rank)
        assert np.isfinite(standard_deviations(W)).tolist() == seen
        assert (od.MinEigenvalue().value(W) > 0) == (rank == n)
        assert np.isfinite(od.LogDet().value(W)) == np.isfinite(od.TraceInverse().value(W)) == (rank == n)


def test_the_hidden_directions_are_those_of_the_null_space():
    for rows, unit in _instances(200, seed=6):
        directions = hidden_directions(np.einsum("ki,kj->ij", rows * unit, rows * unit)) * unit[:, None]
        sizes = np.linalg.norm(rows, axis=0)[:, None] * directions  # what each state adds to what is read along a direction
        assert np.all(np.linalg.norm(rows @ directions, axis=0) <= 1e-9 * np.linalg.norm(sizes, axis=0))


def test_the_smallest_eigenvalue_of_states_in_units_decades_apart():
    # diagonal: 1e-3 beside 1e12; [[a, b], [b, d]] with a >> d: d - b^2/a to the relative size d/a of the next term
    assert smallest_eigenvalue(np.diag([1e12, 1e-3])) == pytest.approx(1e-3, rel=1e-12)
    assert smallest_eigenvalue(np.array([[1e24, 3e11], [3e11, 1.0]])) == pytest.approx(1 - 9e22 / 1e24, rel=1e-12)
    assert smallest_eigenvalue(np.zeros((3, 3))) == 0.0
    assert smallest_eigenvalue(np.diag([4.0, 0.0, 1e-30])) == 0.0


def test_what_is_left_beside_the_other_states_is_judged_by_what_it_was_taken_from():
    # one row (1, 1): with the second state free nothing is left of the first, however 1 - 1 is rounded
    row = np.array([[0.1 + 0.2, 0.7]])
    W = row.T @ row / 0.3
    assert schur_complement(W, np.array([0])) == 0.0


def test_information_a_hair_above_round_off_is_kept():
    # correlation 1 - 2^-40: the determinant is 2^-39, and 1/(W^-1)_ii = 2^-39 to the relative size 2^-41 of the next term
    W = np.array([[1.0, 1 - 2.0**-40], [1 - 2.0**-40, 1.0]])
    assert standard_deviations(W) == pytest.approx([2**19.5, 2**19.5], rel=1e-3)
    assert standard_deviations(W * np.outer([1e-9, 1e9], [1e-9, 1e9])) == pytest.approx([2**19.5 * 1e9, 2**19.5 * 1e-9], rel=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_one_range_does_not_see_a_turn_about_its_beacon(seed):
    # 2 of 3: turning the whole path about the beacon changes no distance
    rng = np.random.default_rng(seed)
    system = od.System(od.Unicycle(), (od.Range(tuple(rng.normal(size=2) * 300), sigma=0.3),))
    u = np.column_stack([rng.uniform(1, 20, 200), rng.uniform(-1, 1, 200)])
    found = od.variational_gramian(system, od.simulate(system, [*rng.normal(size=2) * 100, 0.7], u, 0.1))
    assert od.MinEigenvalue().value(found.total) == 0.0
    assert od.LogDet().value(found.total) == od.TraceInverse().value(found.total) == -np.inf
    assert np.isinf(found.std).all()


# ---------------------------------------------------------------- along a path
def _radial(heading: float, distance: float, steps: int, at_beacon: bool, vehicle: od.Dubins | od.Unicycle) -> od.Information:
    """Straight towards the beacon, or away from it (distance < 0), half the way at 10 m/s; sigma 1."""
    there = (distance * np.cos(heading), distance * np.sin(heading))
    start, beacon = ((0.0, 0.0), there) if at_beacon else ((-there[0], -there[1]), (0.0, 0.0))
    system = od.System(vehicle, (od.Range(beacon, sigma=1.0),))
    u = np.zeros((steps, 1)) if isinstance(vehicle, od.Dubins) else np.tile([10.0, 0.0], (steps, 1))
    return od.variational_gramian(system, od.simulate(system, [*start, heading], u, abs(distance) / 20 / steps))


@pytest.mark.parametrize(("heading", "beacon"), [(0.0, 2000.0), (np.pi, -2000.0)])
def test_a_leg_towards_a_beacon_and_its_mirror_image(heading, beacon):
    # every range says x, to 1 m, and nothing of y or heading: 20 of them make 1/sqrt(20)
    system = od.System(od.Dubins(speed=10.0), (od.Range((beacon, 0.0), sigma=1.0),))
    found = od.variational_gramian(system, od.simulate(system, [0, 0, heading], np.zeros((20, 1)), 0.5))
    assert found.std[0] == pytest.approx(1 / np.sqrt(20), rel=1e-12)
    assert np.isinf(found.std[1:]).all()


def test_heading_is_hidden_on_every_leg_towards_a_beacon():
    # dr/dx(t_0) = -(cos, sin, 0) at every instant: along the leg 1/sqrt(N), two directions hidden. At multiples of 90 degrees the
    # coordinate along the leg is that direction, elsewhere both coordinates move along what is hidden
    rng = np.random.default_rng(11)
    for trial in range(60):
        turn = int(rng.integers(-24, 25)) if trial % 3 == 0 else None
        heading = rng.uniform(-np.pi, np.pi) if turn is None else np.deg2rad(15.0 * turn)
        distance, steps = 10 ** rng.uniform(1, 5) * rng.choice([-1, 1]), int(rng.choice([1, 2, 7, 40, 300]))
        vehicle = od.Dubins(speed=10.0) if trial % 2 else od.Unicycle()
        found = _radial(heading, distance, steps, bool(trial % 4 < 2), vehicle)
        wanted = np.full(3, np.inf)
        if turn is not None and turn % 6 == 0:
            wanted[0 if turn % 12 == 0 else 1] = 1 / np.sqrt(steps)
        assert found.std == pytest.approx(wanted, rel=1e-9), (heading, distance, steps)
        assert found.visibility.hidden.shape == (3, 2)
        along = np.array([np.cos(heading), np.sin(heading)])
        assert np.linalg.norm(along @ found.visibility.visible[:2]) == pytest.approx(1 / np.sqrt(steps), rel=1e-6)


def _exact_deviations(rows: list[list[flint.arb]]) -> np.ndarray:
    matrix = flint.arb_mat(rows)
    inverse = (matrix.transpose() * matrix).inv()
    return np.array([float(inverse[i, i].sqrt().mid()) for i in range(matrix.ncols())])


@pytest.mark.parametrize("distance", [1e5, 1e7, 1e9])
def test_a_beacon_far_away_says_little_but_that_is_right(distance):
    # bearing and magnetometer along a straight leg of 19 m abreast of a beacon: the direction changes by 1.9e-8 rad at 1e9 m, and W,
    # the squares of the rows, is singular in double precision. Rows in 700 bits, beacon at (D, 0), north-bound from (0, 0):
    # bearing = atan2(-y, D - x) - heading with x = x_0 + v cos(h) t, y = y_0 + v sin(h) t
    steps = 20
    system = od.System(od.Dubins(speed=1.0), (od.Bearing((distance, 0.0), sigma=0.01), od.Magnetometer(sigma=0.02)))
    found = od.variational_gramian(system, od.simulate(system, [0, 0, 1.5], np.zeros((steps, 1)), 1.0)).std
    bits, flint.ctx.prec = flint.ctx.prec, 700
    try:
        rows, heading = [], flint.arb(1.5)
        for t in range(steps):
            east, north = flint.arb(distance) - heading.cos() * t, -heading.sin() * t
            square = east * east + north * north
            a, b = north / square, -east / square
            turned = -heading.sin() * t * a + heading.cos() * t * b - 1
            rows += [[a * 100, b * 100, turned * 100], [flint.arb(0), flint.arb(0), flint.arb(50)]]
        exact = _exact_deviations(rows)
    finally:
        flint.ctx.prec = bits
    assert found == pytest.approx(exact, rel=1e-5)


def test_units_of_the_states_change_nothing_but_the_units():
    # x, y in units of 1e-12 .. 1e12 m: q_i = x_i / s_i; one range on a straight leg (hidden: all of x, y, heading but one direction),
    # and two ranges (nothing hidden)
    rng = np.random.default_rng(3)
    for trial in range(6):
        scale = 10.0 ** rng.uniform(-12, 12, 3)
        found = []
        for s in (np.ones(3), scale):
            q = ca.SX.sym("q", 3)
            x, y, h = q[0] * s[0], q[1] * s[1], q[2] * s[2]
            outputs = {"r": ca.sqrt((x - 300) ** 2 + (y - 400) ** 2)}
            if trial % 2:
                outputs["r2"] = ca.sqrt((x + 100) ** 2 + (y - 50) ** 2)
            drift = ca.vertcat(10 * ca.cos(h) / s[0], 10 * ca.sin(h) / s[1], 0)
            system = od.ControlAffineSystem(state=q, names=("x", "y", "h"), drift=drift, outputs=outputs)
            path = od.simulate(system, np.array([0.0, 0.0, np.arctan2(400, 300)]) / s, np.zeros((25, 0)), 1.0)
            found.append(od.variational_gramian(system, path))
        assert found[1].std * scale == pytest.approx(found[0].std, rel=1e-6)
        assert found[1].visibility.hidden.shape == found[0].visibility.hidden.shape == (3, 0 if trial % 2 else 2)


def test_what_is_hidden_stays_so_through_every_way_of_handling_information():
    system = od.System(od.Dubins(speed=10.0), (od.Range((-2000.0, 0.0), sigma=1.0), od.Magnetometer(sigma=0.1)))
    path = od.simulate(system, [0, 0, np.pi], np.zeros((20, 1)), 0.5)
    whole = od.variational_gramian(system, path)
    assert whole.std == pytest.approx([1 / np.sqrt(20), np.inf, 0.1 / np.sqrt(20)])
    parts = [od.variational_gramian(system, path.part(a, b)) for a, b in ((0, 7), (7, 12), (12, 20))]
    hidden = pytest.approx([1 / np.sqrt(20), np.inf, np.inf])
    assert whole.only("range").std == hidden
    assert parts[0].then(parts[1]).then(parts[2]).only("range").std == hidden
    assert parts[0].then(parts[1].then(parts[2])).only("range").std == hidden
    assert pickle.loads(pickle.dumps(whole.only("range"))).std == hidden
    # the integral over 9.5 s in the place of 20 samples; and central differences
    integral = od.variational_gramian(system, path.part(0, 19), weighted=False).only("range")
    assert integral.std == pytest.approx([1 / np.sqrt(9.5), np.inf, np.inf])
    assert od.empirical_gramian(system, path).only("range").std == pytest.approx([1 / np.sqrt(20), np.inf, np.inf], rel=1e-6)
    # correlated errors: exp(-1/20) from sample to sample; for one constant 1'R^-1 1 = 1 + 19 (1 - c)/(1 + c)
    slow = od.System(od.Dubins(speed=10.0), (od.Range((-2000.0, 0.0), sigma=1.0, correlation=0.95),))
    found = od.variational_gramian(slow, od.simulate(slow, [0, 0, np.pi], np.zeros((20, 1)), 0.5))
    assert found.std == pytest.approx([(1 + 19 * 0.05 / 1.95) ** -0.5, np.inf, np.inf])


def test_one_sensor_twice_in_decimals_is_one_sensor():
    # 0.01 x + y and x + 100 y are proportional: 1 of 2, though 0.1 * 0.1 is not 0.01 in double precision
    q = ca.SX.sym("q", 2)
    for outputs in ({"a": q[0] * 0.1 * 0.1 + q[1], "b": q[0] + 100 * q[1]}, {"a": q[0] * 0.1 * 3 + q[1], "b": 3 * q[0] + 10 * q[1]}):
        system = od.ControlAffineSystem(state=q, names=("x", "y"), outputs=outputs)
        path = od.simulate(system, [1.0, 2.0], np.zeros((5, 0)), 1.0)
        assert np.isinf(od.variational_gramian(system, path).std).all()


def test_contributions_and_principal_directions_leave_round_off_out():
    system = od.System(od.Dubins(speed=10.0), (od.Range((-2000.0, 0.0), sigma=1.0),))
    found = od.variational_gramian(system, od.simulate(system, [0, 0, np.pi], np.zeros((20, 1)), 0.5))
    said = od.contributions(system, found, 4)
    assert said.sentences[0].startswith("x is known to 0.224 m")
    assert said.sentences[1:] == ("y stays hidden", "heading stays hidden")
    assert said.weakest_value == 0.0
    assert said.weakest[0] == 0.0  # exactly: no term of 1e-17
    assert np.isnan(said.weakest_shares).all()
    values, vectors = found.visibility.principal_axes(np.array([50.0, 50.0, 0.3]))
    assert values[:2].tolist() == [0.0, 0.0]
    assert values[2] == pytest.approx(20 * 50**2)
    assert vectors[0, :2].tolist() == [0.0, 0.0]
    assert np.abs(vectors[:, 2]) == pytest.approx([1, 0, 0], abs=1e-12)


def test_a_covariance_of_states_decades_apart_is_served_or_its_entry_named():
    spread = np.array([1e-9, 1.0, 1e9])
    P = np.outer(spread, spread) * np.array([[1, 0.5, 1e-14], [0.5, 1, 0.2], [0, 0.2, 1]])  # an asymmetry of 1e-14 of the sizes
    assert np.array_equal(od.Prior([0.0, 0.0, 0.0], covariance=P).mean, np.zeros(3))
    P[0, 2] = 1e-3
    with pytest.raises(od.InputError, match=r"covariance\[0, 2\] is 0.001.*\[2, 0\] is 0"):
        od.Prior([0.0, 0.0, 0.0], covariance=P)
