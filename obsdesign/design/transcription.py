"""The nonlinear program behind a design: single shooting, one SX graph, exact derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.criteria.abstract import Knowledge, Lift
from obsdesign.design.problem import DesignProblem, margins_of
from obsdesign.information.posterior import disturbance_of, posterior_start, posterior_step
from obsdesign.information.sampling import sampled
from obsdesign.packing import packed, symmetric
from obsdesign.simulation import simulate
from obsdesign.status import Status
from obsdesign.step import Step, blocks_of, sensitivity_of, step_of

ITERATIONS = 400  # work, not seconds, decides when a start is given up

_STATUS = {
    "Solve_Succeeded": Status.LOCALLY_OPTIMAL,
    "Solved_To_Acceptable_Level": Status.LOCALLY_OPTIMAL,
    "Infeasible_Problem_Detected": Status.LOCALLY_INFEASIBLE,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
}


@dataclass(frozen=True, eq=False)
class Transcription:
    """Maximise lift.objective over z = (p, lift.variables).

    information: p -> S W S (n, n); solver: the NLP with the unit c as its parameter; equalities and margins count its rows.
    """

    information: ca.Function
    solver: ca.Function
    lift: Lift
    equalities: int
    margins: int


@dataclass(frozen=True, eq=False)
class Solution:
    """Where IPOPT stopped: parameters p (q, m), its own objective, status, iterations, KKT residual."""

    p: np.ndarray
    objective: float
    status: Status
    iterations: int
    residual: float


@lru_cache(8)
def transcribe(problem: DesignProblem) -> Transcription:
    """Build the program once; equal problems share it."""
    m = len(problem.system.model.inputs)
    p = ca.SX.sym("p", problem.path.rows(problem.steps), m)
    W, x = _shoot(problem, problem.path.inputs(p, problem.steps))
    c = ca.SX.sym("c")
    lift = problem.criterion.lift(W, c)
    margins = _margins(problem, x)
    program = {
        "x": ca.vertcat(ca.vec(p), lift.variables),
        "p": c,
        "f": -lift.objective / c,
        "g": ca.vertcat(lift.equalities, margins),
    }
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.max_iter": ITERATIONS}
    return Transcription(
        information=ca.Function("information", [p], [ca.densify(W)]),
        solver=ca.nlpsol("design", "ipopt", program, options),
        lift=lift,
        equalities=lift.equalities.numel(),
        margins=margins.numel(),
    )


def solve(problem: DesignProblem, p: np.ndarray) -> Solution:
    """Run IPOPT from the parameters p (q, m)."""
    program = transcribe(problem)
    W = program.information(p).full()
    c = float(np.trace(W)) / len(W)
    free = len(program.lift.lower)
    count = p.size
    bounds = [np.repeat(side, len(p)) for side in (problem.lower, problem.upper)]
    result = program.solver(
        x0=np.concatenate([p.ravel(order="F"), program.lift.start(W, c)]),
        p=c,
        lbx=np.concatenate([bounds[0], program.lift.lower]),
        ubx=np.concatenate([bounds[1], np.full(free, np.inf)]),
        lbg=np.zeros(program.equalities + program.margins),
        ubg=np.concatenate([np.zeros(program.equalities), np.full(program.margins, np.inf)]),
    )
    stats = program.solver.stats()
    found = result["x"].full().ravel()[:count]
    return Solution(
        # IPOPT relaxes bounds by 1e-8: what is returned respects them
        p=np.clip(found, *bounds).reshape(p.shape, order="F"),
        objective=-float(result["f"]) * c,
        status=_STATUS.get(stats["return_status"], Status.NUMERICAL_ERROR),
        iterations=int(stats["iter_count"]),
        residual=float(max(stats["iterations"]["inf_pr"][-1], stats["iterations"]["inf_du"][-1])),
    )


def _shoot(problem: DesignProblem, u: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return S W S (n, n), W what the criterion judges, and the states x (n, N+1) of the path that the inputs u (N, m) steer."""
    known = problem.criterion.knowledge
    start, add, total = _gramian(problem) if known is None else _posterior(problem, known)
    fly = _called(step_of(problem.system.model, problem.step).without_disturbance())
    states, carry = [ca.SX(problem.x0)], start
    for k in range(problem.steps):
        carry = add(k, states[k], u[k, :].T, carry)
        states.append(fly(states[k], u[k, :].T))
    S = ca.diag(ca.SX(problem.units))
    return S @ total(carry) @ S, ca.horzcat(*states)


def _called(one: Step) -> ca.Function:
    return ca.Function("advance", [one.x, one.u], [one.x_next])


# (carry before the first step; (k, x, u, carry) -> carry; carry -> the matrix that is judged)
_Recursion = tuple[ca.SX, Callable[[int, ca.SX, ca.SX, ca.SX], ca.SX], Callable[[ca.SX], ca.SX]]


def _gramian(problem: DesignProblem) -> _Recursion:
    """Carry (Phi's free entries, lower triangle of W)."""
    system, n = problem.system, len(problem.x0)
    one, shape = step_of(system.model, problem.step), sensitivity_of(system.model, problem.step)
    due = sampled(system, problem.steps, problem.step)
    W, sums = symmetric("W", n)
    moved = ca.Function("moved", [one.x, one.u, shape.free], [shape.next])
    gain = ca.Function("gain", [one.x, shape.free], [packed(block) for block in blocks_of(system.model, shape.Phi)])

    def add(k: int, x: ca.SX, u: ca.SX, carry: ca.SX) -> ca.SX:
        Phi, total = carry[: shape.free.numel()], carry[shape.free.numel() :]
        gained = gain.call([x, Phi])
        total += sum((gained[s] for s in np.flatnonzero(due[k])), ca.SX.zeros(total.numel()))
        return ca.vertcat(moved(x, u, Phi), total)

    start = ca.vertcat(ca.SX(shape.start), ca.SX.zeros(sums.numel()))
    judged = ca.Function("judged", [sums], [ca.densify(W)])
    return start, add, lambda carry: judged(carry[shape.free.numel() :])


def _posterior(problem: DesignProblem, known: Knowledge) -> _Recursion:
    """Carry: T, a root of J = T'T, column by column."""
    system = problem.system
    idle = simulate(system, problem.x0, np.tile((problem.lower + problem.upper) / 2, (problem.steps, 1)), problem.step)
    disturbance = disturbance_of(system, idle, known.prior, known.disturbance_psd, known.unknown_inputs)
    due = sampled(system, problem.steps, problem.step).astype(float)
    recursion = posterior_step(system.model, problem.step, disturbance)
    n = len(problem.x0)
    start = ca.SX(posterior_start(known.prior))

    def judged(carry: ca.SX) -> ca.SX:
        T = ca.reshape(carry, n, n)
        return T.T @ T

    def add(k: int, x: ca.SX, u: ca.SX, carry: ca.SX) -> ca.SX:
        before_next, after_samples = recursion.call([carry, x, u, due[k]])
        return after_samples if k == problem.steps - 1 else before_next

    return start, add, judged


def _margins(problem: DesignProblem, x: ca.SX) -> ca.SX:
    if not problem.constraints:
        return ca.SX.zeros(0)
    return ca.vertcat(*margins_of(problem, *(x[i, :].T for i in problem.position)))
