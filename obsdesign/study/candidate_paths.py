"""The paths of a study: naive ones, the shortest, the best weave, the designed ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.constraints.abstract import AT_END
from obsdesign.design.feasibility import violations
from obsdesign.design.initial_guesses import shortest_inputs
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design
from obsdesign.design.weave import Weave, best_weave
from obsdesign.information.blocks import Information
from obsdesign.information.contribution_shares import contributions
from obsdesign.information.gramian import variational_gramian
from obsdesign.moment import Moment
from obsdesign.scenario.path_names import DESIGNED, SHORTEST, STRAIGHT, WEAVE
from obsdesign.scenario.schema import Scenario
from obsdesign.study.record import Candidate, Quality, suites_of
from obsdesign.trajectory import Trajectory


def candidates_of(scenario: Scenario, designs: tuple[Design, ...]) -> tuple[Weave | None, tuple[Candidate, ...]]:
    """The naive paths, the best weave, the designed path, and the paths designed for other suites."""
    problem = designs[0].problem
    paths = {name: _constant_input_path(problem, inputs) for name, inputs in _baselines(scenario).items()}
    shortest = _shortest(problem)
    if shortest is not None:
        paths[SHORTEST] = shortest
    weave = best_weave(problem) if "turn_rate" in problem.system.model.input_names else None
    if weave is not None:
        paths[WEAVE] = weave[1]
    for suite, design in zip(suites_of(scenario), designs, strict=True):
        name = DESIGNED if design is designs[0] else f"{DESIGNED} for {' + '.join(suite)}"
        if design.trajectory is not None:
            paths[name] = design.trajectory
    problems = tuple(design.problem for design in designs)
    candidates = tuple(candidate_of(scenario, problems, name, path) for name, path in paths.items())
    return None if weave is None else weave[0], candidates


def _baselines(scenario: Scenario) -> dict[str, dict[str, float]]:
    return {STRAIGHT: {}} | {baseline.name: baseline.inputs for baseline in scenario.baselines}


def _constant_input_path(problem: DesignProblem, inputs: dict[str, float]) -> Trajectory:
    """The path of constant inputs; those not named stay as near 0 as their bounds allow."""
    idle = dict(zip(problem.system.model.input_names, np.clip(0.0, problem.lower, problem.upper).tolist(), strict=True)) | inputs
    return problem.path_along(np.tile(list(idle.values()), (problem.steps, 1)))


def _shortest(problem: DesignProblem) -> Trajectory | None:
    """The shortest way to the goal of a Dubins vehicle, up to the node that meets the goal best; None where there is none."""
    u = shortest_inputs(problem)
    if u is None:
        return None
    path = problem.path_along(u)
    moment = Moment(dict(zip(problem.system.model.state_names, path.x[1:].T, strict=True)), {}, {}, problem.system.model.landmarks)
    margins = [margin for constraint in problem.constraints if constraint.span == AT_END for margin in constraint.margins(moment)]
    arrival = 1 + int(np.min(margins, axis=0).argmax())
    if problem.floor is not None:  # a path that is shorter than a stretch of it cannot be judged
        arrival = max(arrival, round(problem.floor.seconds / problem.step))
    return problem.path_along(u[:arrival])


def candidate_of(scenario: Scenario, problems: tuple[DesignProblem, ...], name: str, path: Trajectory) -> Candidate:
    """Return a path with its quality for each suite: one problem each."""
    problem, suites = problems[0], suites_of(scenario)
    information = variational_gramian(problem.system, path)
    nodes = np.append(np.arange(0, path.steps, round(scenario.time.segment / path.step)), path.steps)
    qualities = tuple(rate(suite_problem, path, information, suite) for suite_problem, suite in zip(problems, suites, strict=True))
    contribution = contributions(problem.system, information, None, problem.units)
    first = nodes[:-1]
    shares, weakest = np.add.reduceat(contribution.shares, first, axis=1), np.add.reduceat(contribution.weakest_shares, first, axis=0)
    contribution = replace(contribution, shares=shares, weakest_shares=weakest)
    return Candidate(name, path, information, nodes, qualities, contribution, violations(problem, path))


def rate(problem: DesignProblem, path: Trajectory, information: Information, sensors: tuple[str, ...]) -> Quality:
    """Return the quality of a path for the suite of sensors that the problem is about."""
    sight = information.only(*sensors).visibility
    eigenvalues, vectors = sight.principal_axes(problem.units)
    return Quality(sensors, problem.value(path), eigenvalues, sight.std, vectors)
