"""Errors of samples that are not independent: exact information against least squares with the whole covariance, amounts from below."""

from __future__ import annotations

import pickle
from itertools import product

import flint
import numpy as np
import pytest

import obsdesign as od
from obsdesign.information.accumulation import path_information
from obsdesign.information.correlated_noise import Colour
from obsdesign.information.correlated_samples import CorrelatedSamples

DIGITS = 200  # bits of the reference


# ---------------------------------------------------------------- the right values of the bound


def straight(sensor: od.GPS, steps: int, wind: str | None = None) -> od.Information:
    """1 m/s along x, samples 1 s apart."""
    system = od.System(od.Dubins(speed=1.0, wind=wind), (sensor,))  # pyright: ignore[reportArgumentType]
    start = np.zeros(3 if wind is None else 5)
    return od.variational_gramian(system, od.simulate(system, start, np.zeros((steps, 1)), 1.0))


@pytest.mark.parametrize("wind", [None, "constant"])
def test_one_sample_of_correlated_noise_is_one_sample(wind: str | None):
    """Nothing was before it: R is sigma^2."""
    assert straight(od.GPS(sigma=1.0, correlation=0.95), 1, wind).std[:2] == pytest.approx([1.0, 1.0], rel=1e-12)


def test_twenty_samples_of_correlated_noise():
    """x alone: 1/var = 1 + 19 (1 - c)^2/(1 - c^2) = 1 + 19 * 0.05/1.95. With wind the rows are (1, t), R = c^|i - j|."""
    sensor = od.GPS(sigma=1.0, correlation=0.95)
    assert straight(sensor, 20).std[0] == pytest.approx((1 + 19 * 0.05 / 1.95) ** -0.5, rel=1e-12)
    assert straight(sensor, 20).std[0] == pytest.approx(0.820, abs=5e-4)
    t = np.arange(20.0)
    A, R = np.column_stack([np.ones(20), t]), 0.95 ** np.abs(t[:, None] - t)
    x, wind = np.sqrt(np.diag(np.linalg.inv(A.T @ np.linalg.solve(R, A))))
    found = straight(sensor, 20, "constant").std
    assert (found[0], found[3]) == pytest.approx((x, wind), rel=1e-9)
    assert (found[0], found[3]) == pytest.approx((0.992, 0.0587), abs=5e-4)


def test_sixty_samples_with_a_constant_error_do_not_average_it_away():
    """x is known to the root of b^2 + sigma^2/60, whatever the heading is."""
    found = straight(od.GPS(sigma=0.1, bias_floor=3.0), 60).std[0]
    assert found == pytest.approx((9 + 0.01 / 60) ** 0.5, rel=1e-9)
    assert found == pytest.approx(3.000, abs=5e-4)


def test_inflation_is_a_factor_of_the_spread_and_nothing_else():
    plain, more = (straight(od.GPS(sigma=s, correlation=0.9, bias_floor=0.5, inflation=f), 9).total for s, f in ((3.0, 1.0), (1.0, 3.0)))
    np.testing.assert_allclose(more, plain, rtol=1e-12)


# ---------------------------------------------------------------- random samples against the whole covariance


def stacked(samples: CorrelatedSamples, on: np.ndarray) -> np.ndarray:
    """A'R^-1 A of the samples that are on (N, s), R written down entry by entry, in arithmetic of 60 digits.

    R = spread spread' corr^|j - j'| in samples of the sensor's clock, plus bias^2, plus (spread^2 + bias^2)(1 - g)/g on its diagonal.
    """
    before, flint.ctx.prec = flint.ctx.prec, DIGITS
    try:
        colour, number = samples.colour, np.cumsum(samples.sampling, axis=0)
        joint = {(i, j): C[a][b] for members, C in colour.groups for a, i in enumerate(members) for b, j in enumerate(members)}
        places = np.argwhere(samples.sampling & (samples.gate > 0) & on[:, list(colour.owner)])
        n = samples.rows.shape[2]
        if not len(places):
            return np.zeros((n, n))
        spread = {(int(k), int(j)): 1 / flint.arb(float(samples.level[k, j])) for k, j in places}

        def covariance(k: int, j: int, m: int, i: int) -> flint.arb:
            if i != j:
                return spread[k, j] * spread[m, i] * flint.arb(float(joint.get((j, i), 0.0))) if k == m else flint.arb(0)
            apart, g = abs(int(number[k, j]) - int(number[m, j])), flint.arb(float(samples.gate[k, j]))
            lasting = flint.arb(0) ** apart if (j, j) in joint else flint.arb(float(colour.correlation[j])) ** apart
            bias = flint.arb(float(colour.bias[j])) ** 2
            missing = (spread[k, j] ** 2 + bias) * (1 - g) / g if k == m else flint.arb(0)
            return spread[k, j] * spread[m, i] * lasting + bias + missing

        R = flint.arb_mat([[covariance(*map(int, one), *map(int, other)) for other in places] for one in places])
        A = flint.arb_mat([[flint.arb(float(value)) * spread[int(k), int(j)] for value in samples.rows[k, j]] for k, j in places])
        W = A.transpose() * R.solve(A)
        return np.array([[float(W[i, j].mid()) for j in range(n)] for i in range(n)])
    finally:
        flint.ctx.prec = before


def random_samples(seed: int) -> tuple[CorrelatedSamples, np.random.Generator]:
    """Up to 3 sensors of 1 or 2 outputs: correlation up to 0.999, bias up to 1000 sigma, a group, gates, rates, spreads that change."""
    random = np.random.default_rng(seed)
    S = int(random.integers(1, 4))
    owner = tuple(s for s in range(S) for _ in range(random.integers(1, 3)))
    q, joint, groups = len(owner), set[int](), []
    if S >= 2 and random.random() < 0.5:
        joint = {0, 1}
        members = tuple(j for j in range(q) if owner[j] in joint)[:: random.choice([1, -1])]
        B = random.standard_normal((len(members), len(members) + 1))
        B /= np.linalg.norm(B, axis=1)[:, None]
        C = B @ B.T
        np.fill_diagonal(C, 1.0)
        groups = [(members, tuple(map(tuple, C.tolist())))]
    phi = [0.0 if s in joint or random.random() < 0.3 else float(random.choice([0.3, 0.9, 0.99, 0.999])) for s in range(S)]
    bias = [0.0 if random.random() < 0.4 else 10 ** random.uniform(-2, 3) for _ in range(S)]
    colour = Colour(tuple("abc"[:S]), tuple(range(S)), owner, tuple(phi[s] for s in owner), tuple(bias[s] for s in owner), tuple(groups))
    N, n = int(random.integers(2, 10)), int(random.integers(1, 4))
    level = 10 ** random.uniform(-0.3, 0.3, (N, q)) if random.random() < 0.5 else np.ones((N, q))
    for members, _ in groups:
        level[:, list(members)] = level[0, list(members)]
    gate = random.choice([0.0, 1.0, 0.5, 0.9, 0.01], (N, S))[:, list(owner)] if random.random() < 0.5 else np.ones((N, q))
    periods = random.integers(1, 4, S)
    due = np.stack([np.arange(N) % periods[s] == 0 for s in owner], axis=1)
    return CorrelatedSamples(colour, random.standard_normal((N, q, n)) * level[..., None], level, gate, due, np.arange(N), N), random


def check_random(seed: int) -> None:
    samples, random = random_samples(seed)
    N, S = len(samples.rows), len(samples.colour.sensors)
    size = float((samples.rows**2).sum())
    everything, some = np.ones((N, S), dtype=bool), random.random((N, S)) < 0.6
    np.testing.assert_allclose(samples.information(), stacked(samples, everything), rtol=0, atol=1e-11 * size)
    np.testing.assert_allclose(samples.information(some), stacked(samples, some), rtol=0, atol=1e-11 * size)
    v = random.standard_normal(samples.rows.shape[2])
    assert samples.along(v).min() >= 0
    assert samples.along(v).sum() == pytest.approx(v @ samples.information() @ v, rel=1e-10)


def check_from_below(seed: int) -> int:
    """All schedules of a few stretches: what is counted is no more than what the samples say."""
    samples, random = random_samples(seed)
    N, S = len(samples.rows), len(samples.colour.sensors)
    firsts = np.array(sorted({0, *random.integers(1, N, 3).tolist()}))
    amounts, K = samples.amounts(firsts), len(firsts)
    if K * S > 8:
        return 0
    for bits in product((False, True), repeat=K * S):
        chosen = np.array(bits).reshape(K, S)
        exact = samples.information(np.repeat(chosen, np.diff(np.append(firsts, N)), axis=0))
        below = amounts[chosen].sum(axis=0)
        assert np.linalg.eigvalsh(exact - below)[0] >= -1e-12 * max(float(np.abs(exact).max()), float((samples.rows**2).sum()) * 1e-3)
    return 2 ** (K * S)


@pytest.mark.parametrize("first", [0, 50])
def test_random_samples_say_what_the_whole_covariance_says(first: int):
    for seed in range(first, first + 50):
        check_random(seed)


def test_amounts_are_from_below_for_every_schedule():
    assert sum(check_from_below(seed) for seed in range(100, 140)) > 800


@pytest.mark.slow
def test_thousands_of_random_samples_and_schedules():
    for seed in range(1000, 3000):
        check_random(seed)
    assert sum(check_from_below(seed) for seed in range(3000, 5000)) > 50_000


@pytest.mark.parametrize("length", [1, 2, 3, 7])
@pytest.mark.parametrize("phi", [0.3, 0.95, 0.999])
def test_what_stretches_of_correlated_noise_are_multiplied_by_is_the_largest_eigenvalue(phi: float, length: int):
    """c_K, the largest of R against the diagonal of its stretches, K of them, grows to (1 + phi)/(1 - phi^L) and not beyond."""
    limit, found = (1 + phi) / (1 - phi**length), []
    for K in (3, 10, 30):
        N = K * length
        R = phi ** np.abs(np.arange(N)[:, None] - np.arange(N))
        own = np.kron(np.eye(K), np.linalg.cholesky(R[:length, :length]))
        unit = np.linalg.solve(own, np.linalg.solve(own, R).T)
        found.append(np.linalg.eigvalsh((unit + unit.T) / 2)[-1])
    assert found == sorted(found)
    assert found[-1] <= limit * (1 + 1e-9)
    if phi < 0.9:
        assert found[-1] >= 0.98 * limit


# ---------------------------------------------------------------- along a path

BEACON = (40.0, 25.0)
SENSORS = (
    od.GPS(2.0, rate=1.0, inflation=1.4, correlation=0.5, bias_floor=1.0),
    od.Magnetometer(0.2, name="compass"),
    od.Range(BEACON, 1.0, sigma_per_metre=0.05, max_range=45.0, correlation=0.7, rate=2.0),
    od.Range((-30.0, 10.0), 1.0, name="left", bias_floor=0.3),
    od.Range((-30.0, 14.0), 1.0, name="right", rate=2.0, inflation=1.5),
)
JOINT = {("right", "left"): ((1.5, 0.9), (0.9, 1.0))}
SYSTEM = od.System(od.Unicycle(wind="constant"), SENSORS, joint_noise=JOINT)
START, STEP, STEPS = np.array([3.0, -1.0, 0.4, 2.0, -1.0]), 0.25, 24
INPUTS = np.column_stack([np.full(STEPS, 9.0), 0.5 * np.sin(0.7 * np.arange(STEPS))])
PATH = od.simulate(SYSTEM, START, INPUTS, STEP)
WHOLE = od.variational_gramian(SYSTEM, PATH)
ALLOWED = 1e-9 * np.sqrt(np.outer(np.diag(WHOLE.total), np.diag(WHOLE.total)))


def by_hand(active: np.ndarray | None = None) -> np.ndarray:
    """Least squares with the whole covariance, of the rows of a system of plain sensors that looks at the same things."""
    on = np.ones((STEPS, len(SENSORS)), dtype=bool) if active is None else active
    places, A, spread = [], [], []
    for s, sensor in enumerate(SENSORS):
        rows = derivatives(s)
        period = 1 if sensor.rate is None else round(1 / (sensor.rate * STEP))
        for k in range(0, STEPS, period):
            for i, row in enumerate(rows[k]):
                if on[k, s]:
                    places.append((k, s, i, k // period))
                    A.append(row)
                    spread.append(sigma_at(s, k))
    R = np.array(
        [[entry(one, other, a, b) for other, b in zip(places, spread, strict=True)] for one, a in zip(places, spread, strict=True)]
    )
    stack = np.array(A)
    return stack.T @ np.linalg.solve(R, stack)


def derivatives(s: int) -> np.ndarray:
    """dy/dx(t_0) (N, q, n) by central differences of the path."""
    eps, found = 1e-5, []
    sensor = SENSORS[s]
    for i in range(5):
        ends = [od.simulate(SYSTEM, START + sign * eps * np.eye(5)[i], INPUTS, STEP).x[:-1] for sign in (1, -1)]
        found.append((measured(sensor, ends[0]) - measured(sensor, ends[1])) / (2 * eps))
    return np.moveaxis(np.array(found), 0, 2)


def measured(sensor: object, x: np.ndarray) -> np.ndarray:
    if isinstance(sensor, od.Range):
        return np.hypot(*(np.array(sensor.beacon) - x[:, :2]).T)[:, None]
    return x[:, :2] if isinstance(sensor, od.GPS) else x[:, 2:3]


def sigma_at(s: int, k: int) -> float:
    sensor = SENSORS[s]
    if sensor.name in ("left", "right"):
        return sensor.inflation * (1.0 if sensor.name == "left" else 1.5**0.5)
    growth = sensor.sigma_per_metre if isinstance(sensor, od.Range) else 0.0
    r = float(np.hypot(*(np.array(BEACON) - PATH.x[k, :2])))
    return sensor.inflation * float(np.hypot(sensor.sigma, growth * r))


def entry(one: tuple[int, int, int, int], other: tuple[int, int, int, int], a: float, b: float) -> float:
    (k, s, i, number), (m, t, j, later) = one, other
    if s != t:
        correlated = {SENSORS[s].name, SENSORS[t].name} == {"left", "right"} and k == m
        return 0.9 / 1.5**0.5 * a * b if correlated else 0.0
    if i != j:
        return 0.0
    sensor = SENSORS[s]
    g = gate(s, k)
    lasting = sensor.correlation ** abs(number - later) if sensor.correlation else float(k == m)
    return a * b * lasting + sensor.bias_floor**2 + (k == m) * (a * a + sensor.bias_floor**2) * (1 - g) / g


def gate(s: int, k: int) -> float:
    sensor = SENSORS[s]
    if not isinstance(sensor, od.Range) or sensor.max_range is None:
        return 1.0
    r = np.hypot(*(np.array(BEACON) - PATH.x[k, :2]))
    return 1 / (1 + np.exp((r / sensor.max_range - 1) / 0.05))


def close(values: np.ndarray, expected: np.ndarray, factor: float = 1.0) -> None:
    np.testing.assert_array_less(np.abs(values - expected), np.broadcast_to(factor * ALLOWED + 1e-300, values.shape))


def test_a_gramian_is_least_squares_with_the_whole_covariance():
    close(WHOLE.total, by_hand(), 1e3)  # differences of the path
    close(od.empirical_gramian(SYSTEM, PATH, 1e-4).total, by_hand(), 1e4)


@pytest.mark.parametrize("seed", range(4))
def test_a_schedule_is_least_squares_with_the_samples_that_are_on(seed: int):
    active = np.random.default_rng(seed).random((STEPS, len(SENSORS))) < 0.5
    close(WHOLE.under(active), by_hand(active), 1e3)
    chosen = active[::6]
    held = np.repeat(chosen, 6, axis=0)
    close(path_information(SYSTEM, PATH, chosen.astype(float)), WHOLE.under(held))
    for K in (4, STEPS):
        below = np.einsum("ks,ksij->ij", held[:: STEPS // K], WHOLE.by_segment(K))
        scaled = (WHOLE.under(held) - below) / ALLOWED.diagonal()[:, None] ** 0.5 / ALLOWED.diagonal() ** 0.5 * 1e-9
        assert np.linalg.eigvalsh(scaled)[0] > -1e-12


def test_every_sum_of_the_information_is_the_same():
    alone = np.array([WHOLE.only(name).total for name in ("gps", "compass", "range")])
    close(alone.sum(axis=0) + WHOLE.only("left", "right").total, WHOLE.total)
    close(od.batch_information(SYSTEM, START[None], INPUTS, STEP)[0].sum(axis=0), WHOLE.total)
    close(od.batch_information(SYSTEM, START[None], INPUTS, STEP)[0, :3], alone)
    close(od.sliding_information(SYSTEM, PATH, STEPS)[0].sum(axis=0), WHOLE.total)
    close(path_information(SYSTEM, PATH), WHOLE.total)
    close(od.segment_information(SYSTEM, PATH, 6), WHOLE.by_segment(6))
    close(WHOLE.by_segment(1)[0, :3], alone)
    v = np.array([1.0, -2.0, 0.3, 0.5, 1.0])
    assert WHOLE.along(v).sum() == pytest.approx(v @ WHOLE.total @ v, rel=1e-10)


def test_a_window_knows_nothing_of_the_errors_before_it():
    found = od.sliding_information(SYSTEM, PATH, 8).sum(axis=1)
    for k in (0, 4, 8, 16):  # where the clocks of all sensors begin anew
        expected = od.variational_gramian(SYSTEM, PATH.part(k, k + 8)).total
        np.testing.assert_allclose(found[k], expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())


def test_errors_go_on_from_one_path_to_the_next():
    first, second = (od.variational_gramian(SYSTEM, PATH.part(k, k + 12)) for k in (0, 12))
    together = first.then(second)
    close(together.total, WHOLE.total)
    close(together.blocks.sum(axis=(0, 1)), WHOLE.blocks.sum(axis=(0, 1)))
    other = od.variational_gramian(od.System(SYSTEM.vehicle, SENSORS), PATH.part(12, 24))
    with pytest.raises(od.InputError, match="other noise"):
        first.then(other)


def test_a_sensor_that_is_on_alone_counts_with_its_own_part_of_the_joint_noise():
    """Right alone is a range of the variance 1.5 (1.5)^2, as if it had never been joined; together they say more or less."""
    plain = od.System(SYSTEM.vehicle, (od.Range((-30.0, 14.0), 1.5**0.5, rate=2.0, inflation=1.5),))
    close(WHOLE.only("right").total, od.variational_gramian(plain, PATH).total)
    active = np.zeros((STEPS, len(SENSORS)))
    active[:, 4] = 1
    close(WHOLE.under(active), WHOLE.only("right").total)


def test_contributions_are_shares_of_the_exact_information():
    found = od.contributions(SYSTEM, WHOLE, 4)
    np.testing.assert_allclose(found.std, WHOLE.std, rtol=1e-12)
    np.testing.assert_allclose(found.shares.sum(axis=(1, 2)), 1.0, rtol=1e-9)
    assert found.shares.min() >= 0


@pytest.mark.parametrize("criterion", [od.LogDet(), od.MinEigenvalue()], ids=lambda value: type(value).__name__)
def test_a_gradient_with_lasting_errors_is_its_central_differences(criterion: object):
    scale = (5.0, 4.0, 0.3, 1.0, 1.5)
    value, gradient = od.information_gradient(SYSTEM, START, INPUTS, STEP, criterion, scale)  # pyright: ignore[reportArgumentType]
    assert value == pytest.approx(criterion.value(WHOLE.total * np.outer(scale, scale)), rel=1e-9)  # pyright: ignore[reportAttributeAccessIssue]
    for k, j in ((0, 1), (5, 0), (11, 1), (20, 1)):
        ends = []
        for sign in (1, -1):
            u = INPUTS.copy()
            u[k, j] += sign * 1e-5
            ends.append(od.information_value(SYSTEM, START, u, STEP, criterion, scale))  # pyright: ignore[reportArgumentType]
        assert gradient[k, j] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-4, abs=1e-6 * np.abs(gradient).max())


def test_an_information_refuses_what_is_no_schedule():
    with pytest.raises(od.InputError, match=r"must be \(24, 5\)"):
        WHOLE.under(np.ones((3, 5)))
    with pytest.raises(od.InputError, match="from 0 to 1"):
        WHOLE.under(np.full((24, 5), 2.0))


def test_the_posterior_is_the_prior_and_the_information():
    """Without process noise J about the end is Phi^-T (P_0^-1 + W) Phi^-1, by another recursion: the same noise is meant."""
    prior = od.Prior(START, std=(5.0, 4.0, 0.3, 1.0, 1.5))
    active = np.random.default_rng(9).random((STEPS, len(SENSORS))) < 0.6
    Phi = WHOLE.transition
    assert Phi is not None
    J = od.posterior_information(SYSTEM, PATH, prior)[-1]
    close(Phi.T @ J @ Phi - prior.information, WHOLE.total, 10.0)
    J = od.posterior_information(SYSTEM, PATH, prior, active=active)[-1]
    close(Phi.T @ J @ Phi - prior.information, WHOLE.under(active), 10.0)


def test_information_travels_with_its_samples():
    again = pickle.loads(pickle.dumps(WHOLE))
    np.testing.assert_array_equal(again.total, WHOLE.total)
    np.testing.assert_array_equal(again.by_segment(4), WHOLE.by_segment(4))


@pytest.mark.parametrize("heading", [0.0, 0.7, 2.5])
@pytest.mark.parametrize("bias", [1e5, 1e7, 1e9])
def test_a_constant_error_far_above_the_noise_takes_nothing_from_what_differences_say(bias: float, heading: float) -> None:
    # on a straight leg each coordinate is a line in time: the slope across it is known to sigma / (v S^1/2), S = sum (t - mean t)^2,
    # whatever constants there are, and each start to the mean of its line, the slope times the mean time, and the constant
    sigma, speed, step, steps = 1.0, 10.0, 0.5, 20
    system = od.System(od.Dubins(speed=speed), (od.GPS(sigma=sigma, bias_floor=bias),))
    path = od.simulate(system, [5.0, -3.0, heading], np.zeros((steps, 1)), step)
    t = step * np.arange(steps)
    S = ((t - t.mean()) ** 2).sum()
    turned = sigma / (speed * np.sqrt(S))
    leading = speed * t.mean() * np.array([-np.sin(heading), np.cos(heading)]) * turned
    start = np.sqrt(bias**2 + sigma**2 / steps + leading**2)
    information = od.variational_gramian(system, path)
    np.testing.assert_allclose(information.std, [*start, turned], rtol=1e-9)
    first, second = (od.variational_gramian(system, path.part(*ends)) for ends in ((0, 8), (8, steps)))
    np.testing.assert_allclose(first.then(second).std, [*start, turned], rtol=1e-9)
