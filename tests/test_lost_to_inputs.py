"""What unknown inputs and noise leave of what is known, where a step shrinks states by e^-10 and more: against exact fractions."""

from __future__ import annotations

import random
from contextlib import suppress
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest
from flint import fmpq, fmpq_mat
from scipy.linalg import expm
from test_lasting_errors import drawn_case, worst_error

import obsdesign as od
from obsdesign.dynamics.process_noise import noise_factor
from obsdesign.dynamics.simulation import substeps_along
from obsdesign.dynamics.step import looped_step
from obsdesign.information import root_recursion

# ---------------------------------------------------------------- chains of states with unknown inputs


@dataclass(frozen=True)
class Chain:
    """x' = A x + B w + noise, y = C x with errors of deviations sigma, w unknown; active (N, q): which samples arrive."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    sigma: list[float]
    deviations: list[float]
    active: np.ndarray
    step: float
    psd: tuple[float, ...] | None = None

    @property
    def names(self) -> list[str]:
        return [f"w{j}" for j in range(self.B.shape[1])]

    @property
    def system(self) -> od.ControlAffineSystem:
        x = ca.SX.sym("x", len(self.A))
        outputs = {f"y{i}": ca.SX(ca.DM(row[None])) @ x for i, row in enumerate(self.C)}
        inputs = {name: ca.SX(ca.DM(self.B[:, j])) for j, name in enumerate(self.names)}
        states = tuple(f"x{i}" for i in range(len(self.A)))
        return od.ControlAffineSystem(x, states, ca.SX(ca.DM(self.A)) @ x, {}, inputs, outputs, dict(zip(outputs, self.sigma, strict=True)))

    @property
    def path(self) -> od.Trajectory:
        return od.simulate(self.system, np.zeros(len(self.A)), np.zeros((len(self.active), 0)), self.step)

    @property
    def prior(self) -> od.Prior:
        return od.Prior(np.zeros(len(self.A)), self.deviations)

    def information(self) -> np.ndarray:
        return od.posterior_information(self.system, self.path, self.prior, self.psd, unknown_inputs=self.names, active=self.active)


def drawn_chain(seed: int) -> Chain:
    """Two to five states, each the next one's input, that decay by e^-0.01 to e^-40 in a step; sensors and prior decades apart."""
    r = random.Random(seed)
    n, step, steps = r.choice([2, 3, 4, 5]), r.choice([0.1, 1.0]), r.choice([6, 12, 24])
    A = np.diag([-r.choice([0.01, 0.5, 5, 12, 25, 40]) / step for _ in range(n)])
    for i in range(1, n):
        A[i, i - 1] = 10.0 ** r.uniform(-3, 3)
    B = np.zeros((n, 1 if n < 4 else r.choice([1, 2])))
    B[0, 0] = B[r.randrange(n), -1] = 10.0 ** r.uniform(-2, 2)
    C = np.eye(n)[[n - 1, r.randrange(n)]]
    every = r.choice([1, 3])
    active = np.array([[k % every == 0, k % 3 == 0] for k in range(steps)])
    deviations = [10.0 ** r.uniform(-3, 6) for _ in range(n)]
    return Chain(A, B, C, [10.0 ** r.uniform(-4, 4) for _ in range(2)], deviations, active, step)


def fraction(value: float) -> fmpq:
    return fmpq(*float(value).as_integer_ratio())


def fractions(values: np.ndarray) -> fmpq_mat:
    return fmpq_mat(*values.shape, [fraction(value) for value in values.ravel()])


def step_matrices(chain: Chain) -> tuple[np.ndarray, np.ndarray]:
    """F and B of a step as the doubles that they are."""
    step = looped_step(chain.system.model, chain.step, substeps_along(chain.system, chain.path))
    inputs = [np.zeros(len(chain.A)), np.zeros(step.all_inputs.numel())]
    return tuple(np.array(value.full()) for value in ca.Function("step", [step.x, step.all_inputs], [step.F, step.B_w])(*inputs))


def exact_informations(chain: Chain) -> list[fmpq_mat]:
    """J+ = M - M b (b'M b + q)^# b'M, M = F^-T J F^-1, q = 0 for an input, 1 for a column of noise, one after the other, in fractions.

    Nothing is rounded, and 0 is 0.
    """
    F, B = step_matrices(chain)
    L = noise_factor(chain.psd, len(F), chain.step)
    backward = fractions(F).inv()
    columns = [(fractions(b[:, None]), 0) for b in B.T] + [(fractions(b[:, None]), 1) for b in L.T]
    J = fractions(np.diag(np.ones(len(F))))
    for i, deviation in enumerate(chain.deviations):
        J[i, i] = 1 / fraction(deviation) ** 2
    results = []
    for arrivals in chain.active:
        for row, sigma in zip(chain.C[arrivals], np.array(chain.sigma)[arrivals], strict=True):
            J += fractions(row[:, None]) * fractions(row[None]) * (1 / fraction(sigma) ** 2)
        results.append(J)
        J = backward.transpose() * J * backward
        for b, known in columns:
            along = J * b
            size = (b.transpose() * along)[0, 0] + known
            J = J if size == 0 else J - along * along.transpose() * (1 / size)
    return [*results, J]


def error_bounds(J: np.ndarray, exact: fmpq_mat, deviations: list[float]) -> tuple[float, float]:
    """Smallest and largest eigenvalue of J - exact in units of (exact_ii)^-1/2, but at least of 1e-18 of what was known at first."""
    floors = [max(exact[i, i], fraction(1e-18) / fraction(deviation) ** 2) for i, deviation in enumerate(deviations)]
    units = [fmpq(2) ** ((int(floor.q).bit_length() - int(floor.p).bit_length()) // 2) for floor in floors]
    difference = [[(fraction(J[i, j]) - exact[i, j]) * units[i] * units[j] for j in range(len(units))] for i in range(len(units))]
    values = np.linalg.eigvalsh([[int(value.p) / int(value.q) for value in row] for row in difference])
    return values[0], values[-1]


def errors_of(chain: Chain) -> tuple[float, float]:
    """What is lost and what is invented at any instant; nothing where the inputs are refused, as no sample sees them."""
    try:
        claimed = chain.information()
    except od.InputError as error:
        assert "trace" in str(error)
        return 0.0, 0.0
    bounds = [error_bounds(J, exact, chain.deviations) for J, exact in zip(claimed, exact_informations(chain), strict=True)]
    return min(lost for lost, _ in bounds), max(invented for _, invented in bounds)


@pytest.mark.parametrize("seed", range(20))
def test_no_more_is_claimed_than_the_inputs_leave_and_nothing_is_lost(seed: int):
    lost, invented = errors_of(drawn_chain(seed))
    assert lost > -1e-7
    assert invented < 1e-7


@pytest.mark.parametrize("seed", range(10))
def test_no_more_is_claimed_than_noise_leaves_and_nothing_is_lost(seed: int):
    r, chain = random.Random(seed), drawn_chain(seed)
    psd = tuple(10.0 ** r.uniform(-20, 3) if r.random() < 0.7 else 0.0 for _ in chain.deviations)
    unseen = chain.B[:, : seed % 2]  # with unknown inputs as well, and without
    lost, invented = errors_of(replace(chain, psd=psd, B=unseen, active=chain.active[:12]))
    assert lost > -1e-7
    assert invented < 1e-7


def test_a_state_that_forgets_is_known_by_its_noise():
    # P+ = f^2 P + q with f = e^-30: what was known comes back e^60 times, and noise takes all of it; the variance is q to the last digit
    A, nothing = np.diag([-30.0, -0.1]), np.zeros((2, 0))
    chain = Chain(A, nothing, np.eye(2), [1.0, 1.0], [1.0, 1.0], np.zeros((5, 2), bool), 1.0, (1e-4, 0.0))
    np.testing.assert_allclose(chain.information()[1:, 0, 0], 1e4, rtol=1e-9)


@pytest.mark.parametrize("rate", [-150.0, -260.0, -700.0])
def test_what_is_left_of_a_state_that_forgets_nearly_all_is_its_noise(rate: float):
    """P+ = F P F' + Q with F = e^rate or so, by NumPy: F^-1 is up to 1e304, its square no number; noise hangs together, or is none."""
    for psd in ((1e-4, 2e-3), (0.0, 2e-3)):
        A, nothing = np.array([[rate, 1.0], [0.0, -0.1]]), np.zeros((2, 0))
        chain = Chain(A, nothing, np.eye(2), [1.0, 1.0], [1.0, 1.0], np.zeros((4, 2), bool), 1.0, psd)
        F, P = expm(A), np.eye(2)
        for J in chain.information()[1:]:
            P = F @ P @ F.T + np.diag(psd)
            np.testing.assert_allclose(np.linalg.inv(J), P, rtol=1e-6)


def test_a_step_that_leaves_nothing_of_a_state_is_named():
    chain = Chain(np.diag([-800.0, -0.1]), np.zeros((2, 0)), np.eye(2), [1.0, 1.0], [1.0, 1.0], np.zeros((4, 2), bool), 1.0, (1.0, 1.0))
    with pytest.raises(od.InputError, match="a step leaves 1 of 2 states"):
        chain.information()


@pytest.mark.parametrize("seed", range(30, 36))
def test_long_numbers_say_what_all_samples_at_once_say_also_where_errors_last(seed: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(root_recursion, "_is_rounding_claimed", lambda *_: True)
    assert worst_error(drawn_case(seed)) < 1e-12


@pytest.mark.parametrize("seed", range(30))
def test_vehicles_are_computed_in_doubles(seed: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delattr(root_recursion, "_roots_in_long_numbers")
    case = drawn_case(seed)
    with suppress(od.InputError):  # unknown inputs without a trace
        od.posterior_information(case.system, case.path, case.prior, case.psd, case.unknown, case.active)


def test_a_sensor_behind_three_lags_keeps_what_it_knows_of_itself_when_the_input_has_taken_the_rest():
    # a pulse is felt by all lags within a step; after as many steps as there are states the input has taken all but the last sample
    lags = np.diag([-5.0, -50, -50, -120, -5]) + np.diag([50.0, 50, 120, 0.5], -1)
    active = np.zeros((12, 1), bool)
    active[::3] = True
    chain = Chain(lags, np.eye(5)[:, :1] * 10, np.array([[0, 0.1, 0, 0, 1]]), [1.7], [0.01, 28.0, 0.6, 29e3, 78e3], active, 0.1)
    J = chain.information()
    row = chain.C[0] / chain.sigma[0]
    for k in (6, 9):
        np.testing.assert_allclose(J[k], np.outer(row, row), rtol=1e-6, atol=1e-9)
