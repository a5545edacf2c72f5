"""Together? Path and schedule chosen together, and one after the other."""

from __future__ import annotations

import math

from obsdesign.joint.result import AnyJoint
from obsdesign.report import derived_quantities as facts
from obsdesign.report.figures import joint_map
from obsdesign.report.names import criterion_name, has_relative_gap, minimised_in_words
from obsdesign.report.number_format import join, numeral, percent, rounded_up
from obsdesign.report.section import Section
from obsdesign.report.table import Table, TableColumn, Toned, finite, seconds, tabulate
from obsdesign.status import Status
from obsdesign.study.record import Study

_LOOSE = 0.5  # share of the value: a bound farther away says nothing that helps
_TINY = 1e-5  # share of the value: what is less is told as that much


def section(study: Study, joint: AnyJoint) -> Section:
    """Return the answer to "Together?"."""
    picture = joint_map.picture(study)
    pictures = () if picture is None else (picture,)
    return Section("together", "Together?", answer(study, joint), pictures, (answers_table(study, joint),), (_bound_note(joint),))


def answer(study: Study, joint: AnyJoint) -> str:
    """Answer "Together?": what choosing both at once gains, and how far that is proven."""
    words = _filter_answer(study, joint) if study.scenario.codesign_question == "filter" else _start_answer(study, joint)
    return f"{words} The schedule is {_schedule_proof(study, joint)} for this path; {_of_all(study, joint)}."


def _start_answer(study: Study, joint: AnyJoint) -> str:
    """Say what the samples tell of the start with the three answers."""
    name, value = criterion_name(study), joint.value
    ratio = study.scenario.criterion.scales_with_information
    better = max(joint.path_first.value, joint.sensors_first.value)
    gain = f", {percent(value / better - 1)} more than the better of the two" if ratio and better > 0 and math.isfinite(better) else ""
    return (
        f"Designing the path for all sensors and then choosing which are on gives a {name} of {numeral(joint.path_first.value)}; choosing "
        f"them for the path one takes without thinking and then designing the path for them gives {numeral(joint.sensors_first.value)}. "
        f"Path and schedule chosen together reach {numeral(value)}{gain}."
    )


def _filter_answer(study: Study, joint: AnyJoint) -> str:
    """Say what the three answers cost the filter."""
    path_first, sensors_first, together = (facts.filter_cost(study, value) for *_, value in facts.joint_answers(joint).values())
    better = min(path_first, sensors_first)
    gain = f", {percent(1 - together / better)} less than the better of the two" if _is_relative(study) and math.isfinite(better) else ""
    return (
        f"What is made small is {minimised_in_words(study.scenario)}. Designing the path for all sensors and then choosing which are on "
        f"leaves {numeral(path_first)} of it; choosing them for the path one takes without thinking and then designing the path for them "
        f"leaves {numeral(sensors_first)}. Path and schedule chosen together leave {numeral(together)}{gain}."
    )


def _is_relative(study: Study) -> bool:
    """Whether gaps are shares: of the filter's cost, or of what is told of the start."""
    is_for_filter = study.scenario.codesign_question == "filter"
    return study.scenario.filter_criterion.gap_kind == "relative" if is_for_filter else has_relative_gap(study)


def _schedule_proof(study: Study, joint: AnyJoint) -> str:
    schedule = joint.schedule
    if schedule.status is Status.OPTIMAL:
        return "proven to be the best"
    return f"within {percent(schedule.gap) if _is_relative(study) else numeral(schedule.gap)} of the best"


def _of_all(study: Study, joint: AnyJoint) -> str:
    """Say what is proven of every path with every schedule, where that is near enough to help."""
    excess = (joint.bound - joint.value) / abs(joint.value) if joint.value else math.inf
    if not math.isfinite(joint.bound) or excess > _LOOSE:
        return "the path is the best found near by, and that no other is much better is not proven"
    if not study.scenario.criterion.scales_with_information:
        return f"no path with any schedule is above {numeral(rounded_up(joint.bound, 5), 5)}, and that is proven"
    return f"no path with any schedule is better by more than {percent(rounded_up(max(excess, _TINY)))}, and that is proven"


def _bound_note(joint: AnyJoint) -> str:
    """Say what no path with any schedule exceeds, which ones that is about, and what the bound made no use of."""
    proof = joint.proof
    if not math.isfinite(proof.bound):
        return f"No bound on other paths and schedules is proven: {proof.reason}."
    left_out = f" It makes no use of: {join(proof.left_out)}." if proof.left_out else ""
    return f"The bound {numeral(rounded_up(proof.bound, 5), 5)} holds for {proof.class_of_paths}.{left_out}"


def answers_table(study: Study, joint: AnyJoint) -> Table:
    """What each order of choosing comes to."""
    total, is_for_filter = study.scenario.time.segment, study.scenario.codesign_question == "filter"
    values = {name: facts.filter_cost(study, value) if is_for_filter else value for name, (*_, value) in facts.joint_answers(joint).items()}
    rows = (
        (name, Toned(values[name], "good" if name == facts.TOGETHER else ""), *(total * float(on) for on in schedule.chosen.sum(axis=0)))
        for name, (_, schedule, _) in facts.joint_answers(joint).items()
    )
    on = (TableColumn(f"{name} on [s]", seconds) for name in study.scenario.sensor_names)
    better = "above" if is_for_filter else "below"
    return tabulate(
        "Path and schedule, one after the other and together",
        f"Good: together is never {better} the others, as its search begins at both.",
        (TableColumn("chosen"), TableColumn(f"{'cost to the filter' if is_for_filter else criterion_name(study)} [–]", finite), *on),
        rows,
    )
