"""Paths, designs, filter runs and way points as parts of the JSON document."""

from __future__ import annotations

from dataclasses import asdict

from obsdesign.design.path_bound.certificate import PathBound
from obsdesign.design.record import Design, Evidence, Start
from obsdesign.design.violation import Violation
from obsdesign.estimation.validation import Validation
from obsdesign.information.contribution_shares import Contributions
from obsdesign.report.document import ValidationPart
from obsdesign.report.document_parts import (
    CapPart,
    ContributionPart,
    DesignPart,
    EvidencePart,
    GapSearchPart,
    OptimumPart,
    PathBoundPart,
    PathCertificatePart,
    PathPart,
    QualityPart,
    RobustnessPart,
    StartPart,
    ViolationPart,
    WayPointsPart,
)
from obsdesign.study.record import Candidate, Quality, Study
from obsdesign.study.thinned_path import ThinnedPath


def suite_key(study: Study, sensors: tuple[str, ...]) -> str:
    """Return the key of a suite: all, or its sensors joined with +."""
    return "all" if set(sensors) == set(study.scenario.sensor_names) else "+".join(sensors)


def design_part(design: Design) -> DesignPart:
    """Return the part of a design."""
    cap, robustness, evidence, search = design.cap, design.robustness, design.evidence, design.search
    return DesignPart(
        status=design.status.name,
        value=design.value,
        objective=design.objective,
        eigenvalues=list(design.eigenvalues),
        duration=design.problem.longest,
        residual=design.residual,
        iterations=design.iterations,
        cap=None if cap is None else CapPart(value=cap.value, states=list(cap.states), reached=design.reaches_cap),
        bound=design.bound,
        gap=design.gap,
        proof=_proof(design.proof),
        optima=[OptimumPart(value=optimum.value, starts=list(optimum.starts)) for optimum in design.optima],
        robustness=None if robustness is None else RobustnessPart(**asdict(robustness)),
        evidence=None if evidence is None else _evidence(evidence),
        search=None if search is None else GapSearchPart(gap=search.gap, limit=search.limit, in_words=search.in_words(design)),
        starts=[_start(start) for start in design.starts],
    )


def _proof(proof: PathBound) -> PathBoundPart:
    certificate = proof.certificate
    return PathBoundPart(
        class_of_paths=proof.class_of_paths,
        left_out=list(proof.left_out),
        reason=proof.reason,
        certificate=None if certificate is None else PathCertificatePart(**asdict(certificate)),
    )


def _start(start: Start) -> StartPart:
    return StartPart(
        name=start.name,
        status=start.status.name,
        value=start.value,
        iterations=start.iterations,
        residual=start.residual,
        refined=start.refined,
    )


def _evidence(evidence: Evidence) -> EvidencePart:
    return EvidencePart(
        estimate=evidence.estimate,
        remaining=evidence.remaining,
        dual=evidence.Z.tolist(),
        climbs=evidence.climbs,
        in_words=evidence.in_words,
    )


def path_part(study: Study, candidate: Candidate) -> PathPart:
    """Return the part of a path."""
    return PathPart(
        feasible=candidate.feasible,
        shortfalls=violation_parts(candidate.violations),
        duration=candidate.duration,
        quality={suite_key(study, quality.sensors): _quality(quality) for quality in candidate.qualities},
        contributions=_contributions(candidate.contributions),
    )


def _contributions(contributions: Contributions) -> dict[str, ContributionPart]:
    return {
        state.name: ContributionPart(
            std=float(contributions.std[i]),
            by_sensor=dict(zip(contributions.sensors, contributions.shares[i].sum(axis=0).tolist(), strict=True)),
            in_words=contributions.sentences[i],
        )
        for i, state in enumerate(contributions.states)
    }


def _quality(quality: Quality) -> QualityPart:
    return QualityPart(value=quality.value, eigenvalues=quality.eigenvalues.tolist(), std=quality.std.tolist())


def violation_parts(violations: tuple[Violation, ...]) -> list[ViolationPart]:
    """Return the parts of what is violated."""
    return [ViolationPart(what=violation.what, time=violation.time, by=violation.by, unit=violation.unit) for violation in violations]


def validation_part(names: tuple[str, ...], validation: Validation) -> ValidationPart:
    """Return the filter runs along a path; names: of the states."""
    return ValidationPart(
        verdict=validation.verdict,
        in_band=validation.in_band,
        nees_interval=validation.nees_interval,
        nees=validation.nees.tolist(),
        final_rmse=dict(zip(names, validation.rmse[-1].tolist(), strict=True)),
        final_bound=dict(zip(names, validation.bound[-1].tolist(), strict=True)),
        rmse=dict(zip(names, validation.rmse.T.tolist(), strict=True)),
        bound=dict(zip(names, validation.bound.T.tolist(), strict=True)),
        runs=validation.runs,
    )


def way_points_part(thinned: ThinnedPath) -> WayPointsPart:
    """Return what a path costs as way points."""
    return WayPointsPart(
        points=len(thinned.points),
        of=thinned.of,
        tolerance=thinned.tolerance,
        every=thinned.every,
        autopilot=thinned.autopilot,
        deviation=thinned.deviation,
        duration=thinned.durations,
        reached=thinned.reached,
        lambda_min=thinned.smallest_eigenvalue,
        std=dict(zip(thinned.states, map(tuple, thinned.std.T.tolist()), strict=True)),
        broken=list(thinned.broken),
    )
