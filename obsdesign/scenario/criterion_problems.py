"""What is wrong with what a design is judged by."""

from __future__ import annotations

from collections.abc import Iterator

import obsdesign.criteria
from obsdesign.families import kinds
from obsdesign.scenario.problem_text import Location, Problem, unknown_name
from obsdesign.scenario.schema import Scenario


def find_criterion_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield what is wrong with the criterion of a design, and with what does not go with it."""
    design = scenario.design
    yield from _posterior_problems(scenario)
    if design.criterion == "posterior":
        reasons = {"robust": "has a prior of its own", "floor": "has no windows"}
        wrong = [key for key in reasons if getattr(design, key) is not None]
        yield from (Problem(("design", key), f"does not go with the criterion posterior, which {reasons[key]}") for key in wrong)
    if design.evidence and (design.criterion != "min_eigenvalue" or design.prices or design.robust):
        message = f"is {design.evidence}: must be 0 unless the criterion is min_eigenvalue, without prices and robust"
        yield Problem(("design", "evidence"), message)


def _posterior_problems(scenario: Scenario) -> Iterator[Problem]:
    """What says how a posterior is judged, and when."""
    design = scenario.design
    if design.posterior_criterion not in criteria_of_matrices():
        yield unknown_name(("design", "posterior_criterion"), design.posterior_criterion, criteria_of_matrices())
    if design.criterion != "posterior":
        unused = [key for key in ("posterior_criterion", "over") if key in design.model_fields_set]
        yield from (Problem(("design", key), f"needs the criterion posterior: it is {design.criterion}") for key in unused)
    yield from find_weight_problems(scenario, ("design", "over"), design.over)


def find_weight_problems(scenario: Scenario, location: Location, over: str | tuple[float, ...]) -> Iterator[Problem]:
    """Yield what is wrong with the weights of instants."""
    if isinstance(over, str):
        return
    for i, weight in enumerate(over):
        if weight < 0:
            yield Problem((*location, i), f"is {weight:g}: must be at least 0")
    if not any(over):
        yield Problem(location, f"has {len(over)} weights, all 0: one at least must be above 0")
    if scenario.design.shortest is not None:
        yield Problem(location, "has weights, one for each step: they do not go with design.shortest")
    elif len(over) != scenario.steps:
        yield Problem(location, f"has {len(over)} weights: must be {scenario.steps}, one for each step of the path")


def criteria_of_matrices() -> list[str]:
    """Return the kinds of criteria that judge a matrix by itself."""
    return [kind for kind in kinds(obsdesign.criteria) if kind != "posterior"]
