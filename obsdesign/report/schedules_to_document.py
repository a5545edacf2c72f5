"""The schedules for the filter, and the cheapest one, as parts of result.json."""

from __future__ import annotations

import numpy as np

from obsdesign.report.derived_quantities import segment_nodes
from obsdesign.report.document import CheapestPart, FilterPart, RatedPart, RequirementPart
from obsdesign.report.names import minimised_in_words
from obsdesign.selection.posterior.requirement import RequiredKnowledge
from obsdesign.study.rated_schedules import CheapestAnswer, FilterAnswer
from obsdesign.study.record import Study


def filter_part(study: Study, answer: FilterAnswer) -> FilterPart:
    """Return the part of the schedule for the filter."""
    scenario, schedule = study.scenario, answer.schedule
    over, criterion = scenario.selection.over, scenario.filter_criterion
    return FilterPart(
        criterion=scenario.filter_criterion_kind,
        minimised=minimised_in_words(scenario),
        over=over if isinstance(over, str) else list(over),
        gap_kind=criterion.gap_kind,
        status=schedule.status.name,
        chosen=schedule.chosen.astype(int).tolist(),
        seconds=_seconds_on(study, schedule.chosen),
        value=schedule.value,
        bound=schedule.bound,
        gap=schedule.gap,
        bound_by=schedule.bound_by,
        memory=schedule.memory,
        prices=schedule.prices.tolist(),
        predicted=dict(zip(scenario.state_names, schedule.predicted.T.tolist(), strict=True)),
        compared={rival.name: rival.value for rival in schedule.compared},
        rated={rated.name: RatedPart(information=rated.information, cost=rated.cost, broken=list(rated.breaks)) for rated in answer.rated},
        notes=list(schedule.notes),
    )


def cheapest_part(study: Study, answer: CheapestAnswer) -> CheapestPart:
    """Return the part of the cheapest schedule that keeps what is required."""
    schedule, settings, names = answer.schedule, study.scenario.selection, study.scenario.sensor_names
    return CheapestPart(
        status=schedule.status.name,
        chosen=schedule.chosen.astype(int).tolist(),
        seconds=_seconds_on(study, schedule.chosen),
        cost={name: 1.0 if settings.cost is None else settings.cost.get(name, 0.0) for name in names},
        start={name: settings.start.get(name, 0.0) for name in names},
        value=schedule.value,
        bound=schedule.bound,
        gap=schedule.gap,
        bound_by=schedule.bound_by,
        compared={rival.name: rival.value for rival in schedule.compared},
        requirements=[_requirement_part(study, required, schedule.predicted) for required in answer.required],
        notes=list(schedule.notes),
    )


def _requirement_part(study: Study, required: RequiredKnowledge, predicted: np.ndarray) -> RequirementPart:
    requirement, has_answer = required.requirement, bool(np.isfinite(predicted).any())
    size, k = required.worst(predicted)
    return RequirementPart(
        about=list(requirement.about),
        at_most=requirement.at_most,
        unit=required.unit,
        share=requirement.share,
        after=requirement.after,
        instants=int(required.counted.sum()),
        may_fail=required.misses,
        failures=required.failures(predicted) if has_answer else None,
        size=size,
        at=float(study.main.path.t[k]) if has_answer else float("nan"),
    )


def _seconds_on(study: Study, chosen: np.ndarray) -> dict[str, float]:
    return dict(zip(study.scenario.sensor_names, (np.diff(segment_nodes(study)) @ chosen).tolist(), strict=True))
