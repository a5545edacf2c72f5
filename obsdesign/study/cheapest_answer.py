"""The cheapest schedule that keeps what a scenario requires of a filter along a path."""

from __future__ import annotations

from obsdesign.scenario.schema import Scenario
from obsdesign.selection.posterior.cheapest_selection import cheapest_schedule
from obsdesign.selection.posterior.requirement import Requirement, require_requirements
from obsdesign.study.rated_schedules import CheapestAnswer
from obsdesign.study.record import Candidate


def answer_for_requirements(scenario: Scenario, candidate: Candidate, seed: int) -> CheapestAnswer | None:
    """Look for the cheapest schedule along a path that keeps the requirements of a scenario; None where it has none.

    Raises SolveError where that is what is asked, none was found and none was proven impossible.
    """
    settings, path = scenario.selection, candidate.path
    if not settings.requirements:
        return None
    requirements = tuple(Requirement(table.about, table.at_most, table.share, table.after) for table in settings.requirements)
    schedule = cheapest_schedule(
        scenario.system,
        path,
        scenario.prior_at_start,
        requirements,
        settings.cost,
        settings.start,
        per_segment=settings.per_segment,
        segment=path.t[candidate.nodes].tolist(),
        disturbance_psd=scenario.disturbance_psd,
        input_psd=scenario.input_psd,
        rules=scenario.rules_for("cheapest"),
        gap=scenario.filter_gap,
        seed=seed,
        throw=scenario.schedule_question == "cheapest",
    )
    return CheapestAnswer(schedule, require_requirements(requirements, scenario.system.model, path.t[: path.steps]))
