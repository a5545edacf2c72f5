"""What is known with process noise and unknown inputs: against stacked least squares in exact arithmetic, and as the aim of a design."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from by_hand import (
    BEACON,
    ONE_STEP,
    SCALE,
    SENSORS,
    SLOW,
    START,
    STEP,
    Swinging,
    assert_close,
    correlated_prior,
    derivative,
    flown,
    stepped,
)
from flint import arb, arb_mat, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.design.local_solve import LocalSolve, solve_locally
from obsdesign.design.nlp import rollout as variation
from obsdesign.design.nlp.program import Program, _rollout_functions_of
from obsdesign.design.sqp.evaluation import Multipliers
from obsdesign.vehicles.abstract import AbstractVehicle

few = settings(deadline=None, max_examples=4, database=None, derandomize=True)
SWINGING = od.System(Swinging(), SENSORS)

# ---------------------------------------------------------------- unknown inputs: one big least squares

PSD = np.array([0.2, 0.1, 0.02, 0.05])
Rows = list[np.ndarray]


def sample_rows(path: od.Trajectory, sensors: Sequence[object]) -> Rows:
    """Rows dy/dx / sigma (q, n) of the samples at each step, by hand."""
    found = []
    for k in range(path.steps):
        x = path.x[k]
        east, north = BEACON[0] - x[0], BEACON[1] - x[1]
        r = math.hypot(east, north)
        by_name = {
            "gps": np.eye(3)[:2],
            "magnetometer": np.eye(3)[2:],
            "range": np.array([[-east / r, -north / r, 0.0]]),
            "bearing": np.array([[north / r**2, -east / r**2, -1.0]]),
        }
        due = [sensor for sensor in sensors if sensor.rate is None or k % round(1 / (sensor.rate * path.step)) == 0]
        rows = [by_name[sensor.name] / sensor.sigma for sensor in due]
        block = np.vstack([np.empty((0, 3)), *rows])
        found.append(np.hstack([block, np.zeros((len(block), len(x) - 3))]))
    return found


def exact(values: np.ndarray) -> arb_mat:
    """Numbers as they stand, for arithmetic with 600 bits."""
    return arb_mat([[arb(float(value)) for value in row] for row in values])


def eliminated(A: arb_mat, kept: Sequence[int]) -> arb_mat:
    """A_kk - A_ke A_ee^# A_ek: largest pivots first, those that are nothing for 600 bits left out."""
    rows = [[A[i, j] for j in range(A.ncols())] for i in range(A.nrows())]
    rest = set(range(len(rows))) - set(kept)
    while rest:
        pivot = max(rest, key=lambda i: float(rows[i][i]))
        if float(rows[pivot][pivot]) < 1e-100:
            break
        rest.remove(pivot)
        touched = [j for j in (*rest, *kept) if not rows[pivot][j].is_zero()]
        for i in touched:
            factor = rows[i][pivot] / rows[pivot][pivot]
            for j in touched:
                rows[i][j] -= factor * rows[pivot][j]
    return arb_mat([[rows[i][j].mid() for j in kept] for i in kept])


def schur(A: arb_mat, kept: Sequence[int]) -> np.ndarray:
    """The same in doubles."""
    return doubles(eliminated(A, kept))


def doubles(A: arb_mat) -> np.ndarray:
    return np.array([[float(A[i, j]) for j in range(A.ncols())] for i in range(A.nrows())])


@pytest.fixture(autouse=True)
def long_numbers() -> Iterator[None]:
    before, ctx.prec = ctx.prec, 600
    yield
    ctx.prec = before


@dataclass(frozen=True)
class Stack:
    """Least squares over z = (x_i, e_0, .., e_(N-1)), x_(k+1) = F_k x_k + kicks_k e_k; the first `known` of each e are N(0, 1).

    In exact arithmetic, for what can be told apart and what cannot lie too near each other for double precision.
    """

    F: Rows
    kicks: Rows
    known: int
    prior: np.ndarray
    rows: Rows

    @property
    def size(self) -> int:
        return len(self.prior) + len(self.F) * self.kicks[0].shape[1]

    def states(self, base: int) -> list[arb_mat]:
        """All x_k (n, n + N r) in z, whose first entries are x_base."""
        F = [exact(values) for values in self.F]
        found = {base: exact(np.eye(len(self.prior), self.size))}
        for k in range(base, len(F)):
            found[k + 1] = F[k] * found[k] + self._kick(k)
        for k in reversed(range(base)):
            found[k] = F[k].inv() * (found[k + 1] - self._kick(k))
        return [found[k] for k in range(len(F) + 1)]

    def matrix(self, base: int, samples: int) -> arb_mat:
        """The normal matrix with the prior of x_0 and the samples at the first so many steps."""
        n, r = self.kicks[0].shape
        states = self.states(base)
        noise = [0.0] * n + [float(i < self.known) for _ in self.F for i in range(r)]
        A = exact(np.diag(noise)) + states[0].transpose() * exact(self.prior) * states[0]
        for rows, state in zip(self.rows[:samples], states, strict=False):
            if len(rows):
                seen = exact(rows) * state
                A += seen.transpose() * seen
        return A

    def of_state(self, k: int, samples: int) -> np.ndarray:
        """Information about x_k, everything else being eliminated."""
        return schur(self.matrix(k, samples), range(len(self.prior)))

    def of_inputs(self, steps: Sequence[int]) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """k, information about the unknown part of e_k, everything else being eliminated, and if everything else were known."""
        n, r = self.kicks[0].shape
        A = self.matrix(0, len(self.F))
        for k in steps:
            kept = range(n + k * r + self.known, n + (k + 1) * r)
            yield k, schur(A, kept), doubles(A)[np.ix_(kept, kept)]

    def _kick(self, k: int) -> arb_mat:
        n, r = self.kicks[k].shape
        values = np.zeros((n, self.size))
        values[:, n + k * r : n + (k + 1) * r] = self.kicks[k]
        return exact(values)


def stack_of(path: od.Trajectory, sensors: Sequence[object], prior: od.Prior, psd: np.ndarray | None, unknown: Sequence[int]) -> Stack:
    """Of the swinging vehicle for paths of four states, of a Dubins vehicle of three in unknown wind."""
    n = path.x.shape[1]
    noise = np.zeros((n, 0)) if psd is None else np.diag(np.sqrt(psd[:n] * path.step))
    F, kicks = [], []
    for k in range(path.steps):
        x, u = path.x[k], path.u[k, 0]
        if n == 4:
            F.append(derivative(lambda x, u=u: stepped(x, u, np.zeros(2), path.step), x))
            B = derivative(lambda w, x=x, u=u: stepped(x + 0j, u, w, path.step), np.zeros(2))
        else:
            east, north = path.x[k + 1, :2] - x[:2]  # turning the heading turns the displacement
            F.append(np.array([[1.0, 0.0, -north], [0.0, 1.0, east], [0.0, 0.0, 1.0]]))
            B = path.step * np.eye(3)[:, :2]
        kicks.append(np.hstack([noise, B[:, list(unknown)]]))
    return Stack(F, kicks, noise.shape[1], prior.information, sample_rows(path, sensors))


SENSOR_SETS = {
    "every step": SENSORS,
    "slow": SLOW,
    "gps at each step": (od.GPS(2.0),),
    "gps once a second": (od.GPS(2.0, rate=1.0),),
    "gps once a second, compass and bearing": (od.GPS(2.0, rate=1.0), od.Magnetometer(0.21), od.Bearing(BEACON, 0.087, rate=2.0)),
}
EACH_SET = pytest.mark.parametrize("sensors", SENSOR_SETS.values(), ids=SENSOR_SETS.keys())
NOISES = pytest.mark.parametrize("psd", [None, PSD], ids=["unknown alone", "unknown and noise"])
SHORT = 10


def unknown_case(
    vehicle: AbstractVehicle, sensors: Sequence[object], psd: np.ndarray | None, unknown: Sequence[int]
) -> tuple[od.System, od.Trajectory, od.Prior, dict[str, object], Stack]:
    system = od.System(vehicle, tuple(sensors))
    path = flown(system, steps=SHORT)
    prior = correlated_prior(path.x.shape[1])
    names = tuple(system.model.unknown_inputs[i].name for i in unknown)
    named = {"disturbance_psd": None if psd is None else psd[: path.x.shape[1]], "unknown_inputs": names}
    return system, path, prior, named, stack_of(path, sensors, prior, psd, unknown)


@EACH_SET
@NOISES
@pytest.mark.parametrize(
    ("vehicle", "unknown"),
    [(od.Dubins(15.0, wind="unknown"), (0, 1)), (Swinging(), (0, 1)), pytest.param(Swinging(), (1,), marks=pytest.mark.slow)],
    ids=["wind", "gust and push", "push"],
)
def test_what_is_known_of_an_input_is_the_schur_complement_of_stacked_least_squares(
    vehicle: AbstractVehicle, unknown: tuple[int, ...], sensors: tuple[object, ...], psd: np.ndarray | None
):
    system, path, prior, named, stack = unknown_case(vehicle, sensors, psd, unknown)
    found = od.unknown_input_information(system, path, prior, **named)
    assert found.shape == (SHORT, len(unknown), len(unknown))
    for k, expected, alone in stack.of_inputs((0, 3, 5, 8, 9)):
        assert_close(found[k], expected, 1e-8, alone + np.diag(np.diag(alone) == 0))
    assert not found[-1].any(), "the last input leaves no trace in any sample"


def test_of_wind_between_two_fixes_nothing_is_known_by_itself_and_of_a_wind_at_each_fix_all_but_the_last():
    """GPS alone: at 1 Hz four winds make one displacement; at each step one does, of variance 2 s^2 / dt^2, half of it at first."""
    prior, names = od.Prior(START[:3], std=(1e-6, 1e-6, 1e-9)), ("wind_x", "wind_y")
    for hertz in (1.0, None):
        system = od.System(od.Dubins(15.0, wind="unknown"), (od.GPS(2.0, rate=hertz),))
        path = flown(system, steps=8)
        found = od.unknown_input_information(system, path, prior, unknown_inputs=names)
        if hertz is None:
            first, later = STEP**2 / 2.0**2, STEP**2 / (2 * 2.0**2)
            expected = np.array([first, *[later] * 6, 0.0])[:, None, None] * np.eye(2)
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * later)
        else:
            np.testing.assert_array_equal(found, np.zeros((8, 2, 2)))


@NOISES
def test_noise_never_tells_more_about_an_unknown_input(psd: np.ndarray | None):
    system = od.System(Swinging(), SENSORS)
    path, prior, names = flown(system, steps=SHORT), correlated_prior(4), ("gust", "push")
    base = np.zeros(4) if psd is None else psd
    less, more = (
        od.unknown_input_information(system, path, prior, base + extra, names) for extra in (np.zeros(4), np.array([0.3, 0.0, 0.1, 0.05]))
    )
    size = np.sqrt(np.diagonal(less, axis1=1, axis2=2)).max(axis=0)
    difference = (less - more) / np.outer(size, size)
    assert np.linalg.eigvalsh(difference).min() > -1e-10
    assert np.linalg.eigvalsh(difference[0]).max() > 1e-3


def test_a_sensor_that_is_off_tells_nothing_about_an_input():
    system = od.System(Swinging(), SENSORS)
    path, prior, names = flown(system, steps=SHORT), correlated_prior(4), ("gust", "push")
    active = np.tile([True, False, True, False], (SHORT, 1))
    fewer = od.System(Swinging(), (SENSORS[0], SENSORS[2]))
    found = od.unknown_input_information(system, path, prior, PSD, names, active)
    np.testing.assert_allclose(found, od.unknown_input_information(fewer, path, prior, PSD, names), rtol=1e-9, atol=1e-15)


def test_without_unknown_inputs_there_is_nothing_to_know_of_them():
    with pytest.raises(od.InputError, match="unknown_inputs is empty"):
        od.unknown_input_information(SWINGING, flown(SWINGING), correlated_prior(4))
    with pytest.raises(od.InputError, match="unknown_inputs has no 'wind_x'"):
        od.unknown_input_information(SWINGING, flown(SWINGING), correlated_prior(4), unknown_inputs=("wind_x",))


@EACH_SET
@NOISES
@pytest.mark.parametrize(
    ("vehicle", "unknown"), [(od.Dubins(15.0, wind="unknown"), (0, 1)), (Swinging(), (0, 1))], ids=["wind", "gust and push"]
)
def test_the_posterior_with_inputs_unseen_between_samples_is_the_schur_complement_of_stacked_least_squares(
    vehicle: AbstractVehicle, unknown: tuple[int, ...], sensors: tuple[object, ...], psd: np.ndarray | None
):
    """GPS once a second, four steps of wind in between: of the position nothing is known until the next fix."""
    system, path, prior, named, stack = unknown_case(vehicle, sensors, psd, unknown)
    J = od.posterior_information(system, path, prior, **named)
    size = od.posterior_information(system, path, prior)  # what would be known without anything unknown
    for k in (0, 1, 2, 3, 4, 7, 9, 10):
        assert_close(J[k], stack.of_state(k, min(k + 1, SHORT)), 1e-8, size[k])


def walked(stack: Stack) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """J_k, and what is known of each unknown input: eliminated step by step, forwards and backwards, still in exact arithmetic."""
    n, r = stack.kicks[0].shape
    N, state = len(stack.F), range(len(stack.prior))
    known = exact(np.diag([0.0] * n + [float(i < stack.known) for i in range(r)]))
    moves = [exact(np.hstack([F, K])) for F, K in zip(stack.F, stack.kicks, strict=True)]  # x_(k+1) of (x_k, e_k)
    backs = [exact(np.vstack([np.hstack([F, K]), np.eye(r, n + r, n)])).inv() for F, K in zip(stack.F, stack.kicks, strict=True)]
    samples = [exact(rows.T @ rows) if len(rows) else exact(np.zeros((n, n))) for rows in stack.rows]
    J = [exact(stack.prior) + samples[0]]
    for k in range(N):
        at_start = known + exact(np.eye(n + r, n)) * J[k] * exact(np.eye(n, n + r))
        J.append(eliminated(backs[k].transpose() * at_start * backs[k], state))
        if k + 1 < N:
            J[-1] += samples[k + 1]
    later, inputs = exact(np.zeros((n, n))), []
    for k in reversed(range(N)):
        joint = known + moves[k].transpose() * later * moves[k]
        inputs.append(schur(joint + exact(np.eye(n + r, n)) * J[k] * exact(np.eye(n, n + r)), range(n + stack.known, n + r)))
        later = eliminated(joint, state) + samples[k]
    return [doubles(value) for value in J], inputs[::-1]


@NOISES
@pytest.mark.parametrize("name", ["every step", "gps once a second, compass and bearing"])
def test_rounding_does_not_grow_along_a_long_path(name: str, psd: np.ndarray | None):
    """Its steps shrink some directions: their inverses, one after the other, enlarge whatever is carried along unchecked."""
    sensors, steps = SENSOR_SETS[name], 300
    system, prior, unknown = od.System(Swinging(), sensors), correlated_prior(4), ("gust", "push")
    path = flown(system, steps=steps)
    J, inputs = walked(stack_of(path, sensors, prior, psd, (0, 1)))
    found = od.posterior_information(system, path, prior, psd, unknown)
    assert_close(found, np.array(J), 1e-8, od.posterior_information(system, path, prior))
    about = od.unknown_input_information(system, path, prior, psd, unknown)
    alone = od.unknown_input_information(system, path, od.Prior(prior.mean, std=[1e-9] * 4), None, unknown)
    assert_close(about, np.array(inputs), 1e-7, np.broadcast_to(alone.max(axis=0), about.shape))


# ---------------------------------------------------------------- the posterior as what a design is judged by

POSTERIOR_PRIOR = od.Prior((0.0, 0.0, 0.3, 0.5, -0.3), covariance=correlated_prior(5).covariance * np.outer(SCALE, SCALE) / 25)
POSTERIOR_PSD = (0.02, 0.02, 0.002, 0.01, 0.01)


def judged_by(criterion: od.Posterior, system: od.System, **changes: object) -> od.DesignProblem:
    n = len(system.model.states)
    return od.DesignProblem(
        **{
            "system": system,
            "start": np.array([0.0, 0.0, 0.3, 0.5, -0.3])[:n],
            "duration": 8.0,
            "step": 0.5,
            "path": od.PiecewiseConstant(4),
            "bounds": {"turn_rate": (-0.5, 0.5)},
            "scale": SCALE[:n],
            "criterion": criterion,
            "tolerance": ONE_STEP,
            **changes,
        }
    )


SMALL_SENSORS = (od.GPS(2.0, rate=1.0), od.Range((16.0, 12.0), 1.0))  # out of reach: at a beacon nothing is smooth
SMALL = od.System(od.Dubins(1.0, wind="constant"), SMALL_SENSORS)
SMALL_BLOWN = od.System(od.Dubins(1.0, wind="unknown"), (od.GPS(2.0), SMALL_SENSORS[1], od.Magnetometer(0.2)))
SMALL_LASTING = od.System(SMALL.vehicle, (od.GPS(2.0, rate=1.0, correlation=0.9), od.Range((16.0, 12.0), 1.0, bias_floor=2.0)))
SMALL_PRIOR = od.Prior(POSTERIOR_PRIOR.mean[:3], covariance=POSTERIOR_PRIOR.covariance[:3, :3])
JUDGED = {
    "prior alone": judged_by(od.Posterior(POSTERIOR_PRIOR), SMALL),
    "noise": judged_by(od.Posterior(POSTERIOR_PRIOR, POSTERIOR_PSD, (), od.LogDet()), SMALL),
    "correlated noise": judged_by(od.Posterior(POSTERIOR_PRIOR, 0.01 * (np.eye(5) + 0.5), (), od.TraceInverse()), SMALL),
    "errors that last": judged_by(od.Posterior(POSTERIOR_PRIOR, POSTERIOR_PSD), SMALL_LASTING),
    "unknown wind": judged_by(od.Posterior(SMALL_PRIOR, POSTERIOR_PSD[:3], ("wind_x", "wind_y")), SMALL_BLOWN),
}
EACH_PROBLEM = pytest.mark.parametrize("problem", JUDGED.values(), ids=JUDGED.keys())


def judged_again(problem: od.DesignProblem, p: np.ndarray) -> np.ndarray:
    """S J S after the last samples of the path that the parameters steer."""
    u = np.array(problem.path.inputs(p, problem.grid))
    path = od.simulate(problem.system, problem.x0, u, problem.step, tolerance=problem.tolerance)
    criterion = problem.criterion
    J = od.posterior_information(problem.system, path, criterion.prior, criterion.disturbance_psd, criterion.unknown_inputs)
    return np.diag(SCALE[: len(problem.x0)]) @ J[-2] @ np.diag(SCALE[: len(problem.x0)])


@EACH_PROBLEM
@few
@given(seed=st.integers(0, 10**6))
def test_the_program_of_a_design_has_the_posterior_of_the_path_and_its_exact_derivative(problem: od.DesignProblem, seed: int):
    p = np.random.default_rng(seed).uniform(-0.5, 0.5, 4)
    program = Program(problem)
    values, expected = program.evaluate(p), judged_again(problem, p)
    assert values.matrices.shape == (1, *expected.shape)
    np.testing.assert_allclose(values.matrices[0], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    slopes = program.derivatives(values).matrices[0]
    eps = 1e-5
    for i, unit in enumerate(np.eye(4)):
        plus, minus = (judged_again(problem, p + side * eps * unit) for side in (1, -1))
        np.testing.assert_allclose(slopes[i], (plus - minus) / (2 * eps), rtol=1e-5, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("problem", [JUDGED[name] for name in JUDGED if name != "unknown wind"], ids=list(JUDGED)[:-1])
def test_a_design_by_the_posterior_has_the_value_of_the_posterior_of_its_path_and_no_path_nearby_is_better(problem: od.DesignProblem):
    design = od.design_trajectory(problem, starts=2)
    assert design.status is od.Status.LOCALLY_OPTIMAL
    criterion, path = problem.criterion, design.trajectory
    J = od.posterior_information(problem.system, path, criterion.prior, criterion.disturbance_psd, criterion.unknown_inputs)
    S = np.diag(SCALE)
    assert design.value == pytest.approx(criterion.criterion.value(S @ J[-2] @ S), rel=1e-9)
    random, best = np.random.default_rng(0), problem.path.fit(path.u, problem.grid)
    for size in (1e-3, 0.05):
        for _ in range(15):
            near = np.clip(best + size * random.standard_normal(best.shape), -0.5, 0.5)
            assert criterion.value(judged_again(problem, near)) <= design.value + 1e-6 * abs(design.value)


@pytest.mark.parametrize("problem", [JUDGED[name] for name in JUDGED if name != "unknown wind"], ids=list(JUDGED)[:-1])
def test_the_objective_of_the_solver_is_the_criterion_of_the_posterior_where_it_stops(problem: od.DesignProblem):
    u = np.array(problem.path.inputs(np.array([0.4, -0.3, 0.2, 0.1]), problem.grid))
    found = solve_locally(LocalSolve(problem, "a start", u, (problem.path,), True))
    assert found.status is od.Status.LOCALLY_OPTIMAL
    value = problem.criterion.value(judged_again(problem, found.p))
    assert found.objective == pytest.approx(value, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("name", ["noise", pytest.param("errors that last", marks=pytest.mark.slow)])
def test_second_derivatives_are_the_same_as_products_of_matrices_and_as_a_graph(name: str, monkeypatch: pytest.MonkeyPatch):
    problem, found = JUDGED[name], []
    for large in (0, 1000):
        monkeypatch.setattr(variation, "_LARGE", large)
        _rollout_functions_of.cache_clear()
        program = Program(problem)
        values = program.evaluate(np.array([0.4, -0.3, 0.2, 0.1]))
        Z = np.diag([1.0, 2.0, 0.5, 1.0, 1.0]) + 0.3
        multipliers = Multipliers(Z[None], np.zeros((0, 5, 5)), np.zeros(0), 1.0)
        found.append(program.lagrangian_hessian(values, program.derivatives(values), multipliers))
    _rollout_functions_of.cache_clear()
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9, atol=1e-9 * np.abs(found[1]).max())


def test_a_design_by_the_posterior_under_unknown_inputs_has_something_to_improve():
    """What is known in the end must not be nothing for every path: of two paths one is better."""
    problem = JUDGED["unknown wind"]
    random = np.random.default_rng(0)
    values = [problem.criterion.value(judged_again(problem, random.uniform(-0.5, 0.5, 4))) for _ in range(3)]
    assert min(values) > 1e-6
    assert max(values) > 1.01 * min(values)
