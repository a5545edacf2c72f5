"""Unknown inputs where a step shrinks what they move by e^3 to e^30: no inverse of such a step may make knowledge of rounding."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from flint import arb, arb_mat, ctx

import obsdesign as od
from obsdesign.design.nlp.program import Program
from obsdesign.dynamics.simulation import substeps_along

BITS = 3000  # e^-30 sixty times over, squared, has 5,200 bits of exponent and none of them in a mantissa


@pytest.fixture(autouse=True)
def long_numbers() -> Iterator[None]:
    before, ctx.prec = ctx.prec, BITS
    yield
    ctx.prec = before


@dataclass(frozen=True)
class Linear:
    """x' = A x + G w, y = C x with a standard deviation for each output; samples (N, q) says which of them are taken."""

    A: np.ndarray
    G: np.ndarray
    C: np.ndarray
    sigmas: np.ndarray
    samples: np.ndarray
    step: float
    std: np.ndarray
    psd: np.ndarray | None = None

    @property
    def system(self) -> od.ControlAffineSystem:
        n, p = self.G.shape
        x = ca.SX.sym("x", n)
        unknown = {f"w{j}": ca.sparsify(ca.SX(ca.DM(self.G[:, j]))) for j in range(p)}
        outputs = {f"y{i}": ca.sparsify(ca.SX(ca.DM(row))).T @ x for i, row in enumerate(self.C)}
        sigmas = {f"y{i}": float(sigma) for i, sigma in enumerate(self.sigmas)}
        return od.ControlAffineSystem(
            x, tuple(f"x{i}" for i in range(n)), ca.sparsify(ca.SX(ca.DM(self.A))) @ x, {}, unknown, outputs, sigmas
        )

    @property
    def path(self) -> od.Trajectory:
        N, n = len(self.samples), len(self.A)
        return od.Trajectory(np.arange(N + 1) * self.step, np.zeros((N + 1, n)), np.zeros((N, 0)))

    @property
    def prior(self) -> od.Prior:
        return od.Prior(np.zeros(len(self.A)), std=self.std)

    def found(self) -> np.ndarray:
        names = [f"w{j}" for j in range(self.G.shape[1])]
        return od.posterior_information(self.system, self.path, self.prior, self.psd, names, active=self.samples)


def exact(values: np.ndarray) -> arb_mat:
    return arb_mat([[arb(float(value)) for value in row] for row in values])


def middles(A: arb_mat) -> arb_mat:
    return arb_mat([[A[i, j].mid() for j in range(A.ncols())] for i in range(A.nrows())])


def doubles(A: arb_mat) -> np.ndarray:
    return np.array([[float(A[i, j]) for j in range(A.ncols())] for i in range(A.nrows())])


def moved(M: arb_mat, b: arb_mat, information: int, sizes: list[arb]) -> arb_mat:
    """M - M b b'M / (b'M b + q): what is known of x + b e where M is known of x and q of e; M where it is blind along b.

    Blind: b'M b is what long numbers leave of the sizes that there were.
    """
    g = M * b
    size = (b.transpose() * g)[0, 0] + information
    scale = sum((size_i * b[i, 0] * b[i, 0] for i, size_i in enumerate(sizes)), arb(0))
    if not abs(size) > scale * arb(2) ** (-2 * BITS // 3):
        return M
    return middles(M - g * g.transpose() * (1 / size))


def truth(case: Linear) -> list[arb_mat]:
    """J_0 .. J_N by the recursion itself, each step with its inverse, in numbers that are long enough for it."""
    n, p = case.G.shape
    E = (exact(np.block([[case.A, case.G], [np.zeros((p, n + p))]])) * arb(case.step)).exp()
    inverse = middles(arb_mat([[E[i, j] for j in range(n)] for i in range(n)]).inv())
    columns = [(arb_mat([[E[i, n + j].mid()] for i in range(n)]), 0) for j in range(p)]
    psd = np.zeros(n) if case.psd is None else case.psd
    columns += [(arb_mat([[(arb(psd[j]) * arb(case.step)).sqrt().mid() * (i == j)] for i in range(n)]), 1) for j in range(n) if psd[j] > 0]
    J, known, sizes = exact(np.diag(1 / case.std**2)), [], [arb(0)] * n
    for taken in case.samples:
        for row, sigma in zip(case.C[taken], case.sigmas[taken], strict=True):
            seen = exact(row[None] / sigma)
            J += seen.transpose() * seen
        known.append(middles(J))
        J = middles(inverse.transpose() * known[-1] * inverse)
        for b, information in columns:
            sizes = [max(size, abs(J[i, i].mid())) for i, size in enumerate(sizes)]
            J = moved(J, b, information, sizes)
    return [*known, J]


def difference(found: np.ndarray, expected: arb_mat) -> np.ndarray:
    """Eigenvalues of found - expected in units of what is known of each state; below 0 = less is claimed than is known."""
    known = doubles(expected)
    is_known = np.diag(known) > 0
    assert not found[~is_known].any(), "nothing may be claimed of a state of which nothing is known"
    d = np.sqrt(np.diag(known)[is_known])
    gap = doubles(exact(found) - expected)[np.ix_(is_known, is_known)] / np.outer(d, d)
    return np.linalg.eigvalsh(gap) if len(gap) else np.zeros(1)


def fast_pair(rate: float, step: float, steps: int, coupling: float = 2.0) -> Linear:
    """a' = -rate a + b + w, b' = coupling a - b, both measured to 1 at each step."""
    A, ones = np.array([[-rate, 1.0], [coupling, -1.0]]), np.ones(2)
    return Linear(A, np.array([[1.0], [0.0]]), np.eye(2), ones, np.ones((steps, 2), dtype=bool), step, ones)


def random_case(seed: int) -> Linear:
    """Up to six states; as many decay by e^-3 to e^-30 a step as there are unknown inputs, 1 or 2, others by e^-0.1 to e^-1."""
    r = np.random.default_rng(seed)
    n, step = int(r.integers(1, 7)), float(r.choice([0.1, 0.4, 1.0]))
    p = int(r.integers(1, min(n, 2) + 1))
    rates = np.concatenate([np.exp(r.uniform(np.log(3), np.log(30), p)), r.uniform(0.1, 1, n - p)])
    V = np.linalg.qr(r.standard_normal((n, n))).Q * r.uniform(1, 2, n)
    A = V @ np.diag(-rates) @ np.linalg.inv(V) if r.random() < 0.5 else np.diag(-rates) + np.triu(r.standard_normal((n, n)), 1)
    G = np.eye(n)[:, :p] if r.random() < 0.5 else r.standard_normal((n, p))
    C = np.vstack([np.eye(n), r.standard_normal((1, n))])
    scale = 10.0 ** r.uniform(-6, 6, n) if r.random() < 0.5 else np.ones(n)
    steps = int(r.choice([3, 8, 20]))
    samples = r.random((steps, n + 1)) < r.choice([0.5, 1.0])
    psd = np.where(G.any(axis=1), 0.0, 10.0 ** r.uniform(-3, 0, n)) * scale**2 if r.random() < 0.3 else None
    sigmas, std = 10.0 ** r.uniform(-1, 1, n + 1), scale * 10.0 ** r.uniform(-1, 1)
    return Linear(scale[:, None] * (A / step) / scale, scale[:, None] * G, C / scale, sigmas, samples, step, std, psd)


@pytest.mark.parametrize("rate", [3.0, 30.0, 300.0, 2000.0])
def test_of_one_state_that_an_unknown_input_drives_each_sample_is_all_there_is(rate: float):
    """x+ = F x + b w with w anything says nothing of x+: J = 1/sigma^2 after each sample but the first, 0 before it."""
    case = Linear(np.array([[-rate]]), np.ones((1, 1)), np.ones((1, 1)), np.array([0.5]), np.ones((5, 1), dtype=bool), 0.4, np.array([2.0]))
    np.testing.assert_allclose(case.found().ravel(), [4.25, 4, 4, 4, 4, 0], rtol=1e-12)


@pytest.mark.parametrize("rate", [1.0, 10.0, 30.0, 60.0, 1000.0])
def test_a_state_beside_one_that_is_driven_keeps_what_its_own_samples_say(rate: float):
    """b' = -b, a' = -rate a + b + w: of a only its sample is known, of b j+ = e^(2 dt) j + 1, whatever the rate."""
    steps, dt = 30, 0.4
    J = fast_pair(rate, dt, steps, coupling=0.0).found()
    b = [2.0]
    for _ in range(steps - 1):
        b.append(np.exp(2 * dt) * b[-1] + 1)
    np.testing.assert_allclose(J[:-1, 1, 1], b, rtol=1e-10)
    np.testing.assert_allclose(J[:, 0, 0], [2, *[1] * (steps - 1), 0], rtol=1e-10, atol=1e-20)
    np.testing.assert_allclose(J[-1, 1, 1], np.exp(2 * dt) * b[-1], rtol=1e-10)


@pytest.mark.parametrize(("rate", "step", "steps"), [(30.0, 0.4, 5), (30.0, 0.4, 60), (10.0, 0.4, 30), (12.0, 1.0, 8), (70.0, 0.4, 20)])
def test_knowledge_does_not_grow_from_step_to_step_where_the_driven_state_decays(rate: float, step: float, steps: int):
    """Its information had 1e10 at step 4 and 1e17 at step 5, where the truth stays below 10."""
    case = fast_pair(rate, step, steps)
    for found, expected in zip(case.found(), truth(case), strict=True):
        assert np.abs(difference(found, expected)).max() < 1e-11


@pytest.mark.parametrize(("rate", "spread"), [(15.0, 1e6), (25.0, 1e6), (25.0, 1e8), (15.0, 1e8)])
def test_a_loose_prior_of_a_fast_state_claims_nothing(rate: float, spread: float):
    """Rows of sizes 1e8 apart: an input into the slowest state, nothing known of the fastest; 9 % too much was claimed at 1e8."""
    A = np.array([[-rate, 0.3, 0], [0, -0.1, 0.3], [0, 0, -0.01]])
    std, samples = np.array([spread, 4.0, 0.07]), np.ones((2, 1), dtype=bool)
    case = Linear(A, np.array([[0], [0], [0.01]]), np.array([[1, 0.1, 0]]), np.array([0.4]), samples, 1.0, std)
    found, expected = case.found()[1], doubles(truth(case)[1])
    np.testing.assert_allclose(np.diag(found)[[0, 2]], np.diag(expected)[[0, 2]], rtol=1e-9)


def assert_never_more_than_is_known(seeds: Sequence[int]) -> None:
    compared = 0
    for seed in seeds:
        case = random_case(seed)
        try:
            J = case.found()
        except od.InputError:  # an input without a trace, or information that no double holds
            continue
        assert substeps_along(case.system, case.path) > 1, "the step is the exponential"
        for found, expected in zip(J, truth(case), strict=True):
            assert difference(found, expected).max() < 1e-8, seed
        compared += 1
    assert compared > 0.8 * len(seeds)


def test_no_more_is_claimed_than_is_known_whatever_decays():
    assert_never_more_than_is_known(range(40))


@pytest.mark.slow
def test_no_more_is_claimed_than_is_known_for_hundreds_of_systems():
    assert_never_more_than_is_known(range(40, 540))


def test_units_do_not_matter():
    """x = D q: J of q is D J D, for units from 1e-6 to 1e6."""
    case, D = fast_pair(30.0, 0.4, 10), np.diag([2.0**-20, 2.0**20])
    inverse = np.linalg.inv(D)
    changed = Linear(inverse @ case.A @ D, inverse @ case.G, case.C @ D, case.sigmas, case.samples, case.step, inverse @ case.std)
    np.testing.assert_allclose(changed.found(), D @ case.found() @ D, rtol=1e-12)


@pytest.mark.parametrize(("rate", "psd"), [(2.0, None), (20.0, (0.0, 0.1))], ids=["unknown alone", "unknown and noise"])
def test_the_program_of_a_design_has_the_same_information_and_its_derivative(rate: float, psd: tuple[float, ...] | None):
    x = ca.SX.sym("x", 2)
    drift = ca.vertcat(-rate * x[0] + x[1], 2 * x[0] - x[1] + 0.3 * ca.sin(x[1]))
    outputs = {"y": x[0] + 0.1 * x[1] ** 2, "z": x[1] + 0.2 * x[1] ** 2}
    system = od.ControlAffineSystem(x, ("a", "b"), drift, {"u": ca.SX([0, 1])}, {"w": ca.SX([1, 0])}, outputs)
    criterion = od.Posterior(od.Prior((0.0, 0.0), std=(1.0, 1.0)), psd, ("w",), od.LogDet())
    problem = od.DesignProblem(
        system=system,
        start=np.array([0.3, 0.2]),
        duration=2.4,
        step=0.4,
        path=od.PiecewiseConstant(2),
        bounds={"u": (-1.0, 1.0)},
        scale=np.ones(2),
        criterion=criterion,
        tolerance=1e-2,
    )

    def judged(p: np.ndarray) -> np.ndarray:
        path = od.simulate(system, problem.x0, np.array(problem.path.inputs(p, problem.grid)), problem.step, tolerance=problem.tolerance)
        return od.posterior_information(system, path, criterion.prior, psd, ("w",))[-2]

    p, eps = np.array([0.3, -0.2]), 1e-5
    program = Program(problem)
    values = program.evaluate(p)
    np.testing.assert_allclose(values.matrices[0], judged(p), rtol=1e-9, atol=1e-10)
    central = [(judged(p + eps * unit) - judged(p - eps * unit)) / (2 * eps) for unit in np.eye(2)]
    np.testing.assert_allclose(program.derivatives(values).matrices[0], central, rtol=1e-5, atol=1e-7)
