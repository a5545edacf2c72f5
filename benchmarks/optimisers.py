"""scipy's optimisers on a design problem: the same evaluation, the same limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from scipy import optimize

import obsdesign as od
from obsdesign.design.feasibility import initial_rows
from obsdesign.design.nlp.program import Derivatives, Evaluation, Program

_TOLERANCE = 1e-5  # by how much a margin may fall short for the answer to count
_SECONDS = 20.0


@dataclass(frozen=True)
class Answer:
    """What an optimiser came to: lambda_min (nan where a limit is broken), seconds, evaluations, how it ended."""

    name: str
    value: float
    seconds: float
    evaluations: int
    said: str


@dataclass(frozen=True, eq=False)
class _Once:
    """The program's values and slopes at the last point asked for: none is computed twice."""

    program: Program
    last: dict[str, object] = field(default_factory=dict)

    def values(self, p: np.ndarray) -> Evaluation:
        if not np.array_equal(self.last.get("p", ()), p):
            self.last.update(p=p.copy(), values=self.program.evaluate(p), slopes=None, count=self.count + 1)
        return self.last["values"]  # pyright: ignore[reportReturnType]

    def slopes(self, p: np.ndarray) -> Derivatives:
        values = self.values(p)
        if self.last["slopes"] is None:
            self.last["slopes"] = self.program.derivatives(values)
        return self.last["slopes"]  # pyright: ignore[reportReturnType]

    @property
    def count(self) -> int:
        return self.last.get("count", 0)  # pyright: ignore[reportReturnType]


def answers(problem: od.DesignProblem, starts: list[np.ndarray]) -> Iterator[Answer]:
    """Yield the best answer of each optimiser over the starts (parameters), with the time of all of them; then that of one population."""
    for name, gradients in (("SLSQP", True), ("SLSQP, differences", False), ("trust-constr", True), ("trust-constr, differences", False)):
        found = [_climbed(problem, name, gradients, start) for start in starts]
        yield _together(name, found)
    yield _evolved(problem)


def _together(name: str, found: list[Answer]) -> Answer:
    value = max((each.value for each in found if np.isfinite(each.value)), default=float("nan"))
    said = f"{sum(np.isfinite(each.value) for each in found)} of {len(found)} starts end within the limits"
    return Answer(name, value, sum(each.seconds for each in found), sum(each.evaluations for each in found), said)


def _climbed(problem: od.DesignProblem, name: str, gradients: bool, start: np.ndarray) -> Answer:
    """Maximise lambda_min directly: where eigenvalues meet, the gradient is that of one of them."""
    once, size = _functions(problem)
    lowest, slope, rows, row_slopes = _parts(once, size)
    began = perf_counter()

    def stop(*_: object) -> None:
        if perf_counter() - began > _SECONDS:
            raise StopIteration

    bounds = optimize.Bounds(once.program.lower, once.program.upper)
    jac = slope if gradients else None
    if name.startswith("SLSQP"):
        limits = {"type": "ineq", "fun": rows} | ({"jac": row_slopes} if gradients else {})
        options = {"method": "SLSQP", "constraints": [limits], "options": {"maxiter": 500, "ftol": 1e-9}}
    else:
        limit = optimize.NonlinearConstraint(rows, 0, np.inf, jac=row_slopes if gradients else "2-point", hess=optimize.BFGS())
        options = {"method": "trust-constr", "constraints": [limit], "hess": optimize.BFGS(), "options": {"maxiter": 1000}}
        jac = slope if gradients else "2-point"
    try:
        found = optimize.minimize(lowest, start, jac=jac, bounds=bounds, callback=stop, **options)
        p, said = found.x, found.message
    except StopIteration:
        p, said = once.last["p"], f"stopped after {_SECONDS:g} s"
    return Answer(name, _value(once, p), perf_counter() - began, once.count, str(said))


def _evolved(problem: od.DesignProblem) -> Answer:
    once, size = _functions(problem)
    lowest, _, rows, _ = _parts(once, size)
    began = perf_counter()
    box = list(zip(once.program.lower, once.program.upper, strict=True))

    def penalised(p: np.ndarray) -> float:
        return lowest(p) + 10 * max(0.0, -float(rows(p).min(initial=0.0)))

    found = optimize.differential_evolution(penalised, box, seed=0, maxiter=60, popsize=10, polish=False)
    return Answer(
        "differential evolution", _value(once, found.x), perf_counter() - began, once.count, "one population of 400, 60 generations"
    )


def _functions(problem: od.DesignProblem) -> tuple[_Once, float]:
    program = Program(problem, initial_rows(problem))
    once = _Once(program)
    W = once.values((program.lower + program.upper) / 2).matrices[0]
    return once, float(np.trace(W)) / len(W) * 0.01


_Function = Callable[[np.ndarray], np.ndarray]


def _parts(once: _Once, size: float) -> tuple[Callable[[np.ndarray], float], _Function, _Function, _Function]:
    """-lambda_min / size, its gradient, the margins, and theirs."""

    def inside(p: np.ndarray) -> np.ndarray:
        return np.clip(p, once.program.lower, once.program.upper)

    def lowest(p: np.ndarray) -> float:
        return -float(np.linalg.eigvalsh(once.values(inside(p)).matrices[0])[0]) / size

    def slope(p: np.ndarray) -> np.ndarray:
        u = np.linalg.eigh(once.values(inside(p)).matrices[0])[1][:, 0]
        return -np.einsum("i,qij,j->q", u, once.slopes(inside(p)).matrices[0], u) / size

    return lowest, slope, lambda p: once.values(inside(p)).rows, lambda p: once.slopes(inside(p)).rows


def _value(once: _Once, p: np.ndarray) -> float:
    values = once.values(np.clip(p, once.program.lower, once.program.upper))
    if values.rows.min(initial=0.0) < -_TOLERANCE:
        return float("nan")
    return float(np.linalg.eigvalsh(values.matrices[0])[0])
