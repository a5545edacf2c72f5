"""The schedule for the filter as a part of result.json."""

from __future__ import annotations

import numpy as np

from obsdesign.report.derived_quantities import segment_nodes
from obsdesign.report.document import FilterPart, RatedPart
from obsdesign.report.names import minimised_in_words
from obsdesign.study.rated_schedules import FilterAnswer
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
        seconds=dict(zip(scenario.sensor_names, (np.diff(segment_nodes(study)) @ schedule.chosen).tolist(), strict=True)),
        value=schedule.value,
        bound=schedule.bound,
        gap=schedule.gap,
        bound_by=schedule.bound_by,
        memory=schedule.memory,
        prices=schedule.prices.tolist(),
        predicted=dict(zip(scenario.state_names, schedule.predicted.T.tolist(), strict=True)),
        compared={other.name: other.value for other in schedule.compared},
        rated={rated.name: RatedPart(information=rated.information, cost=rated.cost, broken=list(rated.breaks)) for rated in answer.rated},
        notes=list(schedule.notes),
    )
