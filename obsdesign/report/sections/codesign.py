"""Path and schedule chosen together: the part of the result, a sentence, a caption and a table."""

from __future__ import annotations

import math

from obsdesign.design.record import Design
from obsdesign.joint.result import Joint
from obsdesign.report.document import JointPart, PairPart
from obsdesign.report.names import criterion_name, has_relative_gap
from obsdesign.report.number_format import numeral, percent, plain
from obsdesign.report.tables import DASH, Cell, Table
from obsdesign.selection.schedule import Schedule
from obsdesign.status import Status
from obsdesign.study.record import Study

PATH_FIRST, SENSORS_FIRST, TOGETHER = "path first", "sensors first", "together"


def answers(joint: Joint) -> dict[str, tuple[Design, Schedule, float]]:
    """The three answers: a path, a schedule, and what they are worth together."""
    return {
        PATH_FIRST: (joint.path_first.design, joint.path_first.schedule, joint.path_first.value),
        SENSORS_FIRST: (joint.sensors_first.design, joint.sensors_first.schedule, joint.sensors_first.value),
        TOGETHER: (joint.design, joint.schedule, joint.value),
    }


def joint_part(study: Study, joint: Joint) -> JointPart:
    """Return the part of the result."""
    parts = {name: _pair(study, *answer) for name, answer in answers(joint).items()}
    return JointPart(
        status=joint.status.name,
        joint=parts[TOGETHER],
        path_first=parts[PATH_FIRST],
        sensors_first=parts[SENSORS_FIRST],
        alternation=list(joint.alternation),
        bound=joint.schedule.bound,
        gap=joint.schedule.gap,
    )


def _pair(study: Study, design: Design, schedule: Schedule, value: float) -> PairPart:
    path = design.trajectory
    states = {} if path is None else dict(zip(study.scenario.state_names, path.x.T.tolist(), strict=True))
    histories = {} if path is None else {"t": path.t.tolist(), **states}
    return PairPart(value=value, chosen=schedule.chosen.astype(int).tolist(), trajectory=histories)


def codesign_answer(study: Study, joint: Joint) -> str:
    """Answer "Together?": what choosing both at once gains, and how far that is proven."""
    name, value = criterion_name(study), joint.value
    ratio = study.scenario.criterion.scales_with_information
    better = max(joint.path_first.value, joint.sensors_first.value)
    gain = f", {percent(value / better - 1)} more than the better of the two" if ratio and better > 0 and math.isfinite(better) else ""
    schedule = joint.schedule
    proof = (
        "proven to be the best"
        if schedule.status is Status.OPTIMAL
        else f"within {percent(schedule.gap) if has_relative_gap(study) else numeral(schedule.gap)} of the best"
    )
    return (
        f"Designing the path for all sensors and then choosing which are on gives a {name} of {numeral(joint.path_first.value)}; choosing "
        f"them for the path one takes without thinking and then designing the path for them gives {numeral(joint.sensors_first.value)}. "
        f"Path and schedule chosen together reach {numeral(value)}{gain}. The schedule is {proof} for this path; the path is the best "
        "found near by, as no method proves more."
    )


def joint_map_caption(study: Study) -> str:
    """Caption of the map."""
    return "The path that goes with its schedule, in the colours of the sensors that are on, and the two one-sided answers."


def answers_table(study: Study, joint: Joint) -> Table:
    """What each order of choosing comes to."""
    total = study.scenario.time.segment
    names = study.scenario.sensor_names
    rows = tuple(
        (
            Cell(name),
            Cell(numeral(value) if math.isfinite(value) else DASH, "good" if name == TOGETHER else ""),
            *(Cell(plain(round(total * float(on), 9))) for on in schedule.chosen.sum(axis=0)),
        )
        for name, (_, schedule, value) in answers(joint).items()
    )
    return Table(
        "Path and schedule, one after the other and together",
        "Good: together is never below the others, as its search begins at both.",
        ("chosen", f"{criterion_name(study)} [–]", *(f"{name} on [s]" for name in names)),
        rows,
    )
