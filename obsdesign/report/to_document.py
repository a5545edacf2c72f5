"""The result of a study as one JSON document."""

from __future__ import annotations

from dataclasses import asdict
from statistics import median

import numpy as np

from obsdesign.design.record import Design
from obsdesign.joint.result import AnyJoint
from obsdesign.planning.closed_loop import Flight
from obsdesign.report.derived_quantities import PATH_FIRST, SENSORS_FIRST, TOGETHER, joint_answers, segment_nodes
from obsdesign.report.document import (
    SCHEMA_VERSION,
    FlightHistoryPart,
    FlightPart,
    JointPart,
    LossPart,
    PairPart,
    ParetoPart,
    PlanPart,
    Result,
    SelectionPart,
    ValidationPart,
)
from obsdesign.report.document_parts import JointBoundPart, JointCertificatePart
from obsdesign.report.expectations import check_expectations
from obsdesign.report.paths_to_document import (
    design_part,
    path_part,
    suite_key,
    validation_part,
    violation_parts,
    way_points_part,
)
from obsdesign.report.question_to_document import scenario_part, verdict_part, versions
from obsdesign.report.schedules_to_document import cheapest_part, filter_part
from obsdesign.report.sections.flight import final_errors, flight_violations, smallest_margin
from obsdesign.report.study_record import encode_study
from obsdesign.selection.pareto import Pareto
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.schedule import Schedule
from obsdesign.study.record import Study


def document_of(study: Study) -> Result:
    """Return the document of a study, expectations checked."""
    draft = _build_document(study)
    expected = check_expectations(study.scenario.expected, draft.model_dump())
    return draft.model_copy(update={"expected": expected, "record": encode_study(study) if study.scenario.source else []})


def _build_document(study: Study) -> Result:
    suites = [suite_key(study, suite) for suite in study.suites] if study.designs else []
    manoeuvres = dict.fromkeys(analysis.manoeuvre for analysis in study.analyses)
    checks: dict[str, dict[str, ValidationPart]] = {}
    for path_study in study.each:
        for check in path_study.checks:
            checks.setdefault(check.path, {})[check.schedule] = validation_part(study.scenario.state_names, check.validation)
    return Result(
        schema_version=SCHEMA_VERSION,
        scenario=scenario_part(study.scenario),
        seed=study.seed,
        versions=versions(),
        analyses={
            name: {"+".join(entry.sensors): verdict_part(entry.verdict) for entry in study.analyses if entry.manoeuvre == name}
            for name in manoeuvres
        },
        designs={suite: design_part(design) for suite, design in zip(suites, study.designs, strict=True)},
        paths={candidate.name: path_part(study, candidate) for candidate in study.candidates},
        selection=_selection(study),
        selections={path_study.about: _selection(path_study) for path_study in study.each},
        t=study.main.path.t.tolist(),
        validation=checks,
        joint=None if study.joint is None else _joint(study, study.joint),
        flight=None if study.flight is None else _flight(study, study.flight),
        way_points=[way_points_part(thinned) for thinned in study.way_points],
        expected=[],
        timings=_timings(study),
    )


def _selection(study: Study) -> SelectionPart:
    selection, settings, sensors = study.selection, study.scenario.selection, study.scenario.sensor_names
    schedule, random = selection.schedule, selection.random_values
    return SelectionPart(
        question=selection.question,
        used=selection.chosen.astype(int).tolist(),
        filter=None if selection.filter is None else filter_part(study, selection.filter),
        cheapest=None if selection.cheapest is None else cheapest_part(study, selection.cheapest),
        criterion=settings.criterion,
        criterion_label=study.scenario.schedule_criterion.label,
        gap_kind=study.scenario.schedule_criterion.gap_kind,
        per_segment=settings.per_segment,
        robust_to=settings.robust_to,
        rules=[str(rule) for rule in settings.rules],
        status=schedule.status.name,
        chosen=schedule.chosen.astype(int).tolist(),
        seconds=dict(zip(sensors, (np.diff(segment_nodes(study)) @ schedule.chosen).tolist(), strict=True)),
        value=schedule.value,
        exact_value=selection.exact,
        bound=schedule.bound,
        root_bound=schedule.root_bound,
        gap=schedule.gap,
        fractional_segments=schedule.fractional,
        nodes=schedule.nodes,
        notes=list(schedule.notes),
        dual=schedule.dual.tolist(),
        offset=schedule.offset,
        prices=schedule.prices.tolist(),
        forced_on=schedule.forced_on.tolist(),
        forced_off=schedule.forced_off.tolist(),
        naive={rival.name: rival.value for rival in selection.rivals},
        broken={rival.name: list(rival.breaks) for rival in selection.rivals},
        random_best=float(random[-1]) if len(random) else float("nan"),
        random_median=float(random[len(random) // 2]) if len(random) else float("nan"),
        random_count=len(random),
        losses={sensors[loss.sensor]: LossPart(kept=loss.kept, rechosen=loss.rechosen, bound=loss.bound) for loss in selection.losses},
        pareto=None if selection.pareto is None else _pareto(selection.pareto),
    )


def _pareto(front: Pareto) -> ParetoPart:
    return ParetoPart(
        limits=front.limits.tolist(),
        spent=front.spent.tolist(),
        values=front.values.tolist(),
        bounds=front.bounds.tolist(),
        chosen=[schedule.chosen.astype(int).tolist() for schedule in front.schedules],
    )


def _joint(study: Study, joint: AnyJoint) -> JointPart:
    """Return the part of the result."""
    parts = {name: _pair(study, *answer) for name, answer in joint_answers(joint).items()}
    return JointPart(
        question=study.scenario.codesign_question,
        status=joint.status.name,
        joint=parts[TOGETHER],
        path_first=parts[PATH_FIRST],
        sensors_first=parts[SENSORS_FIRST],
        alternation=list(joint.alternation),
        bound=joint.schedule.bound,
        gap=joint.schedule.gap,
        proof=_joint_bound(joint),
    )


def _joint_bound(joint: AnyJoint) -> JointBoundPart:
    """Return the part of the bound on every path with every schedule."""
    proof = joint.proof
    return JointBoundPart(
        bound=proof.bound,
        gap=joint.gap,
        class_of_paths=proof.class_of_paths,
        left_out=list(proof.left_out),
        reason=proof.reason,
        certificate=None if proof.certificate is None else JointCertificatePart(**asdict(proof.certificate)),
    )


def _pair(study: Study, design: Design, schedule: Schedule | FilterSchedule, value: float) -> PairPart:
    path = design.trajectory
    states = {} if path is None else dict(zip(study.scenario.state_names, path.x.T.tolist(), strict=True))
    histories = {} if path is None else {"t": path.t.tolist(), **states}
    return PairPart(value=value, chosen=schedule.chosen.astype(int).tolist(), trajectory=histories)


def _flight(study: Study, flight: Flight) -> FlightPart:
    plans = zip(flight.statuses, flight.feasible, flight.ages, flight.values, strict=True)
    return FlightPart(
        t=flight.t.tolist(),
        flown=_flight_history(study, flight),
        middle=None if flight.straight is None else _flight_history(study, flight.straight),
        plans=[PlanPart(status=status.name, feasible=feasible, age=age, value=value) for status, feasible, age, value in plans],
        feasible_plans=sum(flight.feasible),
    )


def _flight_history(study: Study, flight: Flight) -> FlightHistoryPart:
    states, inputs = study.scenario.state_names, study.scenario.system.model.input_names
    return FlightHistoryPart(
        truth=_by_name(states, flight.truth),
        mean=_by_name(states, flight.mean),
        std=_by_name(states, flight.std),
        u=_by_name(inputs, flight.u),
        nees=flight.nees.tolist(),
        final_error=dict(zip(states, final_errors(study, flight).tolist(), strict=True)),
        final_std=dict(zip(states, flight.std[-1].tolist(), strict=True)),
        shortfalls=violation_parts(flight_violations(study, flight)),
        margin=smallest_margin(study, flight),
    )


def _by_name(names: tuple[str, ...], values: np.ndarray) -> dict[str, list[float]]:
    return dict(zip(names, values.T.tolist(), strict=True))


def _timings(study: Study) -> dict[str, float]:
    plans = study.flight.seconds if study.flight is not None else ()
    later = {"plan, median": median(plans[1:]), "plan, longest": max(plans[1:])} if len(plans) > 1 else {}
    return dict(study.seconds) | ({"first plan": plans[0]} if plans else {}) | later
