"""Together? Path and schedule chosen together, and one after the other."""

from __future__ import annotations

import math

from obsdesign.joint.result import Joint
from obsdesign.report import derived_quantities as facts
from obsdesign.report.figures import joint_map
from obsdesign.report.names import criterion_name, has_relative_gap
from obsdesign.report.number_format import join, numeral, percent
from obsdesign.report.section import Section
from obsdesign.report.table import Table, TableColumn, Toned, finite, seconds, tabulate
from obsdesign.selection.schedule import Schedule
from obsdesign.status import Status
from obsdesign.study.record import Study

_LOOSE = 0.5  # share of the value: a bound farther away says nothing that helps


def section(study: Study, joint: Joint[Schedule]) -> Section:
    """Return the answer to "Together?"."""
    picture = joint_map.picture(study)
    pictures = () if picture is None else (picture,)
    return Section("together", "Together?", answer(study, joint), pictures, (answers_table(study, joint),), (_bound_note(joint),))


def answer(study: Study, joint: Joint[Schedule]) -> str:
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
        f"Path and schedule chosen together reach {numeral(value)}{gain}. The schedule is {proof} for this path; {_of_all(study, joint)}."
    )


def _of_all(study: Study, joint: Joint[Schedule]) -> str:
    """Say what is proven of every path with every schedule, where that is near enough to help."""
    excess = (joint.bound - joint.value) / abs(joint.value) if joint.value else math.inf
    if not math.isfinite(joint.bound) or excess > _LOOSE:
        return "the path is the best found near by, and that no other is much better is not proven"
    if not study.scenario.criterion.scales_with_information:
        return f"no path with any schedule is above {numeral(joint.bound, 5)}, and that is proven"
    return f"no path with any schedule is better by more than {percent(excess)}, and that is proven"


def _bound_note(joint: Joint[Schedule]) -> str:
    """Say what no path with any schedule exceeds, which ones that is about, and what the bound made no use of."""
    proof = joint.proof
    if not math.isfinite(proof.bound):
        return f"No bound on other paths and schedules is proven: {proof.reason}."
    left_out = f" It makes no use of: {join(proof.left_out)}." if proof.left_out else ""
    return f"The bound {numeral(proof.bound, 5)} holds for {proof.class_of_paths}.{left_out}"


def answers_table(study: Study, joint: Joint[Schedule]) -> Table:
    """What each order of choosing comes to."""
    total = study.scenario.time.segment
    rows = (
        (name, Toned(value, "good" if name == facts.TOGETHER else ""), *(total * float(on) for on in schedule.chosen.sum(axis=0)))
        for name, (_, schedule, value) in facts.joint_answers(joint).items()
    )
    on = (TableColumn(f"{name} on [s]", seconds) for name in study.scenario.sensor_names)
    return tabulate(
        "Path and schedule, one after the other and together",
        "Good: together is never below the others, as its search begins at both.",
        (TableColumn("chosen"), TableColumn(f"{criterion_name(study)} [–]", finite), *on),
        rows,
    )
