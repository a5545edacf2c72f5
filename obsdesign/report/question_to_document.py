"""What was asked and what the sensors see, as parts of JSON documents; the versions that may change a number."""

from __future__ import annotations

import platform
from importlib.metadata import version
from pathlib import Path

import obsdesign
from obsdesign.analysis.verdict import Verdict
from obsdesign.report.document_parts import ScenarioPart, VerdictPart
from obsdesign.scenario.schema import Scenario

_PACKAGES = ("casadi", "clarabel", "cvxpy", "numpy", "python-flint", "scipy")


def versions() -> dict[str, str]:
    """Return the versions that may change a number."""
    return {"obsdesign": obsdesign.__version__, "python": platform.python_version()} | {name: version(name) for name in _PACKAGES}


def scenario_part(scenario: Scenario) -> ScenarioPart:
    """Return which scenario it is about."""
    return ScenarioPart(
        title=scenario.title,
        file=Path(scenario.file).name,
        sha256=scenario.digest,
        source=scenario.source,
        states=list(scenario.state_names),
        state_units=[signal.unit for signal in scenario.states],
        sensors=list(scenario.sensor_names),
    )


def verdict_part(verdict: Verdict) -> VerdictPart:
    """Return what a suite of sensors sees."""
    return VerdictPart(
        dimension=verdict.dimension,
        states=len(verdict.null_space),
        observable=verdict.observable,
        decided=verdict.decided,
        ranks=list(verdict.ranks),
        observable_states=list(verdict.observable_states),
        unobservable_states=list(verdict.unobservable_states),
        hidden=verdict.hidden,
        null_space=verdict.null_space.T.tolist(),
        proof=verdict.proof,
    )
