"""The nonlinear program behind a design: single shooting, one SX graph, exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.compile import sample_information, transition
from obsdesign.criteria.abstract import Lift
from obsdesign.design.problem import DesignProblem, margins_of
from obsdesign.information.sampling import sampled
from obsdesign.status import Status

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
    """Return S W S (n, n) and the states x (n, N+1) of the path that the inputs u (N, m) steer."""
    system, n = problem.system, len(problem.x0)
    step, sample = transition(system, problem.step), sample_information(system)
    due = sampled(system, problem.steps, problem.step)
    w = ca.SX.zeros(len(system.model.unknown_inputs))
    states, Phi, W = [ca.SX(problem.x0)], ca.SX.eye(n), ca.SX.zeros(n, n)
    for k in range(problem.steps):
        blocks = ca.horzsplit(sample(states[k], Phi), n)
        for s in np.flatnonzero(due[k]):
            W = W + blocks[s]
        x_next, F, _ = step.call([states[k], u[k, :].T, w])
        states.append(x_next)
        Phi = F @ Phi
    S = ca.diag(ca.SX(problem.units))
    return S @ W @ S, ca.horzcat(*states)


def _margins(problem: DesignProblem, x: ca.SX) -> ca.SX:
    if not problem.constraints:
        return ca.SX.zeros(0)
    return ca.vertcat(*margins_of(problem, *(x[i, :].T for i in problem.position)))
