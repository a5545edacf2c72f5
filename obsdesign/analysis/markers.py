"""How many markers a vehicle needs: landmarks whose places are known, beside targets whose places are states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca

from obsdesign.analysis.query import Disturbance, KnownInputs, observability_of
from obsdesign.analysis.verdict import Verdict
from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count, require_known
from obsdesign.display import AbstractDisplay, Summary
from obsdesign.dynamics.control_affine import ControlAffineSystem
from obsdesign.dynamics.system import System
from obsdesign.errors import InputError
from obsdesign.vehicles.abstract import AbstractVehicle

Measure = Literal["bearing", "range"]

# on no common circle through four of them, no three on a line
_PLACES = ((2.0, 0.0), (-1.0, 1.7), (0.6, -2.3), (3.1, 2.2), (-2.4, -1.1), (0.3, 4.7), (-3.9, 2.8), (5.2, -1.6))


@dataclass(frozen=True, eq=False)
class LandmarkNeeds(AbstractDisplay):
    """What is seen of vehicle and targets, by numbers of markers and of targets."""

    measures: tuple[Measure, ...]
    """What is measured of each landmark."""
    verdicts: tuple[tuple[Verdict, ...], ...]
    """Row [t]: with t targets and 0 (1 where t = 0), 1, ... markers; entries without any landmark are left out."""
    first_markers: tuple[int, ...]
    """Number of markers of each row's first entry."""

    @property
    def markers_needed(self) -> tuple[int | None, ...]:
        """By number of targets the fewest markers with which vehicle and targets are seen; None: more than were tried."""
        return tuple(
            next((first + i for i, verdict in enumerate(row) if verdict.observable), None)
            for row, first in zip(self.verdicts, self.first_markers, strict=True)
        )

    def _summary(self) -> Summary:
        rows = [
            (
                f"{targets} target{'s' * (targets != 1)}",
                ", ".join(f"{first + i} markers: {verdict.dimension} of {verdict.null_space.shape[0]}" for i, verdict in enumerate(row)),
            )
            for targets, (row, first) in enumerate(zip(self.verdicts, self.first_markers, strict=True))
        ]
        return Summary(f"{' and '.join(self.measures)} of each landmark: dimensions seen", tuple(rows))


@validate_arguments
def landmark_needs(
    vehicle: AbstractVehicle,
    measures: Sequence[Measure] = ("bearing",),
    *,
    unknown_inputs: Sequence[str] = (),
    markers: int = 3,
    targets: int = 1,
    disturbance: Disturbance = "arbitrary",
    known_inputs: KnownInputs = "any",
    seed: int = 0,
) -> LandmarkNeeds:
    """Return what a vehicle sees of itself and of targets, by numbers of markers and targets.

    Bearing = atan2(landmark - position) - heading, range = |landmark - position|; markers are at places in general position, targets two
    states each, which do not change.

    Arguments:
        vehicle: with states x, y [m] and, for bearings, heading [rad].
        measures: what is measured of each landmark.
        unknown_inputs: names of inputs of the vehicle that nobody knows, beside its own disturbances.
        markers, targets: up to so many are tried, at most 8 markers.
        disturbance, known_inputs, seed: as in `observability`.
    Raises InputError for a vehicle without these states, and numbers that are not accepted.
    Source: Belo, Salaris and Bicchi 2010, Proposition 1 and section IV-C.
    """
    require_count("markers", markers, minimum=0)
    require_count("targets", targets, minimum=0)
    require_known("measures", tuple(measures), ("bearing", "range"))
    if markers > len(_PLACES):
        raise InputError(f"markers is {markers}: must be at most {len(_PLACES)}")
    needed = ("x", "y", "heading") if "bearing" in measures else ("x", "y")
    require_known("landmark_needs: the state", needed, [signal.name for signal in vehicle.states])
    firsts = tuple(0 if count else 1 for count in range(targets + 1))
    moving = System(vehicle, (), tuple(unknown_inputs))
    verdicts = tuple(
        tuple(
            observability_of(_with_landmarks(moving, tuple(measures), number, count).model, None, None, disturbance, known_inputs, seed)
            for number in range(first, markers + 1)
        )
        for count, first in enumerate(firsts)
    )
    return LandmarkNeeds(tuple(measures), verdicts, firsts)


def _with_landmarks(system: System, measures: Sequence[Measure], markers: int, targets: int) -> ControlAffineSystem:
    """Return the system with so many landmarks of each kind, what is measured of them being the outputs."""
    model = system.model
    places = ca.SX.sym("target", 2 * targets)
    state, still = ca.vertcat(model.x, places), ca.SX.zeros(2 * targets)
    position = ca.vertcat(*(model.x[model.state_names.index(name)] for name in ("x", "y")))
    landmarks = [ca.SX(ca.DM(point)) for point in _PLACES[:markers]] + [places[2 * i : 2 * i + 2] for i in range(targets)]
    outputs: dict[str, ca.SX] = {}
    for i, landmark in enumerate(landmarks):
        east, north = ca.vertsplit(landmark - position)
        if "bearing" in measures:
            outputs[f"bearing_{i}"] = ca.atan2(north, east) - model.x[model.state_names.index("heading")]
        if "range" in measures:
            outputs[f"range_{i}"] = ca.sqrt(east**2 + north**2)
    inputs, unknown = ([signal.name for signal in signals] for signals in (model.inputs, model.unknown_inputs))
    return ControlAffineSystem(
        state=state,
        names=(*model.state_names, *(f"target{i}_{axis}" for i in range(targets) for axis in "xy")),
        drift=ca.vertcat(model.drift, still),
        known={name: ca.vertcat(model.B[:, i], still) for i, name in enumerate(inputs)},
        unknown={name: ca.vertcat(model.G[:, i], still) for i, name in enumerate(unknown)},
        outputs=outputs,
    )
