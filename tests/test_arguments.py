"""Whatever a caller gives, what comes back is an answer or one InputError: no public name lets another exception out."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any, Literal

import casadi as ca
import numpy as np
import pytest
from numpy.typing import ArrayLike

import obsdesign as od
from obsdesign.arguments import validate_arguments
from obsdesign.design.path_bound.proof import path_bound_of
from obsdesign.joint.joint_proof import joint_bound_of

X = ca.SX.sym("x", 2)
BEACON = (50.0, 20.0)
CORNERS = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
SYSTEM = od.System(od.Dubins(5.0), (od.GPS(1.0), od.Range(BEACON, 1.0)))
GUSTY = od.System(od.Dubins(5.0, wind="unknown"), (od.GPS(1.0),))
LINEAR = {"state": X, "names": ("a", "b"), "drift": ca.vertcat(X[1], 0), "known": {"u": ca.vertcat(0, 1)}, "outputs": {"y": X[0]}}
U_INPUT, W_INPUT = ca.SX.sym("u"), ca.SX.sym("w")
OWN = {"state": X, "names": ("a", "b"), "inputs": {"u": U_INPUT}, "outputs": {"y": X[0] + U_INPUT**2}}
U = np.full((8, 1), 0.1)
PATH, GUSTY_PATH = (od.simulate(system, [0.0, 0.0, 0.1], U, 0.5) for system in (SYSTEM, GUSTY))
PRIOR = od.Prior(PATH.x[0], std=(10.0, 10.0, 0.1))
W = od.variational_gramian(SYSTEM, PATH)
BLOCKS = W.by_segment(4)
PROBLEM = {
    "system": SYSTEM,
    "start": [0.0, 0.0, 0.1],
    "duration": 4.0,
    "step": 0.5,
    "path": od.PiecewiseConstant(2),
    "bounds": {"turn_rate": (-0.3, 0.3)},
}
DESIGN_PROBLEM = od.DesignProblem(**PROBLEM)
CERTIFICATE = path_bound_of(DESIGN_PROBLEM).certificate
JOINT_CERTIFICATE = joint_bound_of(DESIGN_PROBLEM, 4, 1).certificate
ALONG = {"system": SYSTEM, "path": PATH}
FROM_START = {"system": SYSTEM, "x0": PATH.x[0], "u": U, "dt": 0.5}
THREE = od.System(od.Unicycle(), tuple(od.Bearing(place, 0.1) for place in ((2.0, 0.0), (-1.0, 1.7), (-1.0, -1.7))))
SAMPLES = od.LogSamples(("range",), [0.0, 1.0], [0, 0], [5.0, 6.0])
LOG = od.Log(od.LogInputs(("turn_rate",), [0.0], [[0.1]]), SAMPLES)
SCENARIO = "scenarios/aerosonde_wind.toml"

# every public name that takes arguments of a user, with arguments that it accepts
ACCEPTED: Mapping[str, Mapping[str, Any]] = {
    "simulate": FROM_START,
    "variational_gramian": ALONG,
    "empirical_gramian": ALONG,
    "perturbation": ALONG,
    "posterior_information": {**ALONG, "prior": PRIOR},
    "unknown_input_information": {"system": GUSTY, "path": GUSTY_PATH, "prior": PRIOR, "unknown_inputs": ("wind_x",)},
    "segment_information": {**ALONG, "segments": 4},
    "sliding_information": {**ALONG, "window": 4},
    "batch_information": {"system": SYSTEM, "starts": np.tile(PATH.x[0], (3, 1)), "u": U, "dt": 0.5},
    "contributions": {"system": SYSTEM, "information": W},
    "information_gradient": {**FROM_START, "criterion": od.LogDet()},
    "information_value": {**FROM_START, "criterion": od.LogDet()},
    "standard_deviations": {"J": np.eye(3)},
    "observability": {"system": od.ControlAffineSystem(**LINEAR), "known_at_start": ("b",)},
    "check_path_bound": {"problem": DESIGN_PROBLEM, "certificate": CERTIFICATE},
    "check_joint_bound": {"problem": DESIGN_PROBLEM, "segments": 4, "per_segment": 1, "certificate": JOINT_CERTIFICATE},
    "circle_residuals": {"system": THREE, "path": od.simulate(THREE, [0.0, 0.0, 0.1], np.tile([0.3, 0.1], (8, 1)), 0.5)},
    "estimability": {**ALONG, "prior": PRIOR},
    "landmark_needs": {"vehicle": od.Omnidirectional(), "markers": 1, "targets": 0},
    "explain": {"system": od.ControlAffineSystem(**LINEAR), "held": {}},
    "remedies": {"system": od.ControlAffineSystem(**LINEAR), "held": {}, "at_once": 1},
    "singularities": {"system": THREE, "path": od.simulate(THREE, [0.0, 0.0, 0.1], np.tile([0.3, 0.1], (8, 1)), 0.5)},
    "singular_set": {"system": THREE, "at": [0.0, 0.0, 0.1], "east": (0.0, 1.0), "north": (0.0, 1.0), "points": 3},
    "landmark_circle": {"landmarks": CORNERS},
    "shortest_curve": {"start": (0.0, 0.0, 0.0), "end": (5.0, 5.0, 1.0), "radius": 1.0},
    "design_trajectory": {"problem": DESIGN_PROBLEM, "starts": 1},
    "codesign": {"problem": DESIGN_PROBLEM, "segments": 4, "starts": 1, "rounds": 1},
    "select_sensors": {"blocks": BLOCKS},
    "select_for_filter": {**ALONG, "prior": PRIOR, "segment": 1.0},
    "select_next": {"system": SYSTEM, "belief": PRIOR, "inputs_ahead": U, "step": 0.5, "segment": 2.0},
    "cheapest_schedule": {**ALONG, "prior": PRIOR, "require": (od.Requirement(("x",), 5.0),), "segment": 1.0},
    "sensor_losses": {"blocks": BLOCKS, "schedule": od.select_sensors(BLOCKS)},
    "upper_bound": {"blocks": BLOCKS, "Z": np.eye(3) / 3},
    "pareto": {"blocks": BLOCKS, "budget": od.EnergyBudget(5.0, 1.0), "points": 2},
    "estimate_log": {"system": SYSTEM, "log": LOG, "prior": PRIOR},
    "calibrate": {"system": SYSTEM, "log": LOG, "prior": PRIOR},
    "path_of_estimate": {"system": SYSTEM, "log": LOG, "estimate": od.estimate_log(SYSTEM, LOG, PRIOR)},
    "replay": {"system": SYSTEM, "log": LOG, "prior": PRIOR, "restarts": 1},
    "validate": {**ALONG, "prior": PRIOR, "runs": 2},
    "sweep": {"vary": {"seed": [0]}},
    "estimate_states": {"system": SYSTEM, "prior": PRIOR, "u": U, "y": np.ones((8, 3)), "dt": 0.5},
    "fit_floor": {"residuals": [[0.1, -0.2], [0.3]], "sigma": 0.1},
    "fly": {"problem": DESIGN_PROBLEM, "prior": PRIOR, "every": 2.0, "duration": 2.0},
    "export": {"result": "nowhere", "to": "kml"},
    "load_scenario": {"file": SCENARIO},
    "system_from_text": {"table": {"states": ["x"], "rates": {"x": "-x"}, "outputs": {"y": "x"}}},
    "read_log": {"file": "no_such.csv", "system": SYSTEM},
    "read_recording": {"file": "no_such.csv"},
    "load_study": {"file": "nowhere"},
    "run": {"scenario": od.load_scenario(SCENARIO)},
    "write_report": {"folder": "nowhere", "study": None},
    "BSpline": {"points": 5},
    "Bearing": {"beacon": BEACON, "sigma": 0.1},
    "Budget": {"cost": od.FlightTime(), "at_most": 1.0},
    "CircleClearance": {"clearance": 1.0, "time_scale": 1.0},
    "OutputNoise": {"sigma": 0.1},
    "ControlAffineSystem": {**LINEAR, "unknown": {"w": ca.vertcat(1, 0)}, "sigmas": {"y": 2.0}, "angles": ("a",)},
    "GeneralSystem": {**OWN, "rates": ca.vertcat(X[1] * W_INPUT, ca.sin(U_INPUT)), "unknown": {"w": W_INPUT}, "angles": ("a",)},
    "DiscreteSystem": {**OWN, "next_state": ca.vertcat(X[1], X[0] + ca.sin(U_INPUT)), "period": 0.5, "sigmas": {"y": 2.0}},
    "Course": {"sigma": 0.1},
    "DesignProblem": PROBLEM,
    "Dubins": {"speed": 5.0},
    "DubinsPath": {"word": "LSR", "blend": 1.0},
    "Effort": {"weights": {"turn_rate": 1.0}},
    "EnergyBudget": {"limit": 5.0, "cost": 1.0},
    "Exclusive": {"sensors": (0, 1)},
    "FlightTime": {},
    "ExtendedKalmanFilter": {"gate": od.Gate()},
    "FixedIntervalSmoother": {},
    "Floor": {"seconds": 1.0, "value": 1.0},
    "GPS": {"sigma": 1.0},
    "Gate": {"probability": 0.99},
    "Goal": {"point": BEACON, "tolerance": 1.0},
    "GoalPose": {"point": BEACON, "heading": 0.0, "tolerance": 1.0, "heading_tolerance": 0.1},
    "GoalRegion": {"corners": CORNERS},
    "GroundSpeed": {"least": 1.0},
    "HeadingSector": {"low": -1.0, "high": 1.0},
    "InputStates": {"system": GUSTY, "orders": {"wind_x": 2}},
    "IteratedExtendedKalmanFilter": {"iterations": 2},
    "Information": {"blocks": W.blocks, "names": W.names},
    "KeepIn": {"corners": CORNERS},
    "KeepOut": {"centre": BEACON, "radius": 1.0},
    "KeepOutPolygon": {"corners": CORNERS},
    "Log": {"inputs": None, "samples": SAMPLES},
    "LogDet": {},
    "LogInputs": {"names": ("turn_rate",), "t": [0.0, 1.0], "u": [[0.1], [0.2]]},
    "LogSamples": {"names": ("range",), "t": [0.0, 1.0], "sensor": [0, 0], "y": [5.0, 6.0]},
    "LogTruth": {"names": ("x",), "t": [0.0, 1.0], "x": [[0.0], [1.0]]},
    "Loiter": {"centre": BEACON, "radius": 5.0, "first": 1.0},
    "Magnetometer": {"sigma": 0.1},
    "MaxRange": {"distance": 10.0},
    "MaxUses": {"sensor": 0, "most": 1},
    "MinEigenvalue": {},
    "MinimumDwell": {"least": 2},
    "Omnidirectional": {},
    "PathLength": {},
    "PerSpeed": {"psd": 0.1},
    "PiecewiseConstant": {"pieces": 3},
    "Planner": {"problem": DESIGN_PROBLEM},
    "Polynomial": {"degree": 1},
    "Posterior": {"prior": PRIOR},
    "Price": {"cost": od.FlightTime(), "per_unit": 1.0},
    "Prior": {"mean": [0.0, 0.0], "std": [1.0, 1.0]},
    "Range": {"beacon": BEACON, "sigma": 1.0},
    "RangeBearing": {"beacon": BEACON, "sigma": 0.1, "bearing_sigma": 0.02},
    "SpeedOverGround": {"sigma": 0.1},
    "Airspeed": {"sigma": 0.1},
    "Accelerometer": {"sigma": 0.1},
    "Camera": {"sigma": 0.1, "feature": (1.0, 2.0, 3.0)},
    "GlobalBearing": {"beacon": BEACON, "sigma": 0.1},
    "Gyroscope": {"sigma": 0.1},
    "PeerBearing": {"sigma": 0.1},
    "PeerRange": {"sigma": 0.1},
    "QuaternionNorm": {"sigma": 0.1},
    "RelativeBearing": {"sigma": 0.1, "beacons": (BEACON, (0.0, 9.0))},
    "Aerial3D": {"wind": "unknown", "direction": (0.0, 1.0, 0.0)},
    "InertialVisual": {"gravity": 9.81},
    "PolarUnicycle": {},
    "TargetMotion": {},
    "TwoRobots": {},
    "Depth": {"sigma": 0.1},
    "VelocityLog": {"sigma": 0.1},
    "Doppler": {"beacon": BEACON, "sigma": 0.1},
    "TimeDifference": {"beacon": BEACON, "sigma": 0.1, "reference": (0.0, 9.0)},
    "SecondOrderUnicycle": {},
    "Submersible": {},
    "Requirement": {"about": ("x", "y"), "at_most": 5.0},
    "Requires": {"sensor": 0, "other": 1},
    "Robust": {"prior": PRIOR},
    "Segments": {"names": ("a", "b"), "count": 3},
    "Signal": {"name": "a"},
    "StandOff": {"distance": 1.0},
    "SwitchingCost": {"cost": 1.0},
    "System": {"vehicle": od.Dubins(5.0), "sensors": (od.GPS(1.0),)},
    "TraceInverse": {},
    "Trajectory": {"t": PATH.t, "x": PATH.x, "u": PATH.u},
    "Unavailable": {"sensor": 0, "segments": (0,)},
    "UnavailableBetween": {"sensor": 0, "first": 0.0, "last": 1.0},
    "UnavailableOutside": {"sensor": 0, "centre": BEACON, "radius": 1.0},
    "Unicycle": {},
    "UnscentedKalmanFilter": {"kappa": 1.0},
    "JointCertificate": {"branches": ((-1, -1),), "ends": (CERTIFICATE,)},
    "PathCertificate": {"level": 1.0, "share": 0.1, "lengths": (1, 1), "multipliers": (1.0,)},
    "Via": {"point": BEACON, "tolerance": 1.0},
}
# records that obsdesign returns, enumerations, errors: nothing that a user gives goes into them
RETURNED = (
    *(
        "CalibratedNumber",
        "Calibration",
        "CircleResiduals",
        "Contributions",
        "Curve",
        "Design",
        "Estimate",
        "LockOut",
        "RankCorrelation",
        "Replay",
        "ReplayWindow",
        "Evidence",
        "Export",
        "FilterSchedule",
        "Flight",
        "InputError",
        "Joint",
        "Loss",
        "ObsdesignError",
        "JointBound",
        "PathBound",
        "Recording",
        "Topic",
    ),
    *(
        "Pareto",
        "Perturbation",
        "Plan",
        "Robustness",
        "Scenario",
        "ScenarioError",
        "Schedule",
        "SolveError",
        "Status",
        "Violation",
        "ViolationKind",
    ),
    *(
        "Study",
        "Sweep",
        "SweepRun",
        "HiddenInterval",
        "Estimability",
        "ExplainedVerdict",
        "LandmarkNeeds",
        "Reason",
        "ReasonKind",
        "Remedies",
        "Remedy",
        "Singularities",
        "SingularSet",
        "Symmetry",
        "SymmetryKind",
        "ThinnedPath",
        "UnobservableError",
        "Validation",
        "Verdict",
        "figures",
    ),
)


class Odd:
    """A value of no use to anybody."""


WRONG = (
    *(None, 3, -1.5, True, "word", "", [], {}, (), Odd(), math.nan, math.inf, np.array([np.nan, 1.0]), [1, "a"], [[1.0, 2.0], [3.0]], 1j),
    *({"a": 1}, {1: 2}, [None], ca.SX.sym("z"), ca.MX.sym("z", 2), ca.DM(1), b"x", 10**400, np.zeros((2, 2, 2)), int, np.array(["a"])),
    *({"turn_rate": "x"}, {"a": None}, iter([1]), BEACON, np.int64(1)),
)


def test_every_public_name_is_looked_at() -> None:
    assert {*ACCEPTED, *RETURNED} >= set(od.__all__)


@pytest.mark.parametrize("name", [name for name in ACCEPTED if name not in ("run", "sweep", "write_report", "load_study")])
def test_wrong_arguments_are_refused_by_name_or_accepted(name: str) -> None:
    public, accepted = getattr(od, name), ACCEPTED[name]
    for parameter in inspect.signature(public).parameters:
        # what runs a whole study or design when it accepts is given fewer
        for wrong in WRONG[::5] if name in ("fly", "codesign", "design_trajectory") else WRONG:
            if parameter == "progress" and callable(wrong):  # what a caller's own function raises is the caller's
                continue
            try:
                public(**{**accepted, parameter: wrong})
            except od.ObsdesignError as error:
                assert str(error)


@pytest.mark.parametrize("name", ["run", "sweep", "write_report"])
@pytest.mark.parametrize("wrong", [None, 3, "word", {}, Odd()])
def test_a_study_is_no_other_thing(name: str, wrong: object) -> None:
    with pytest.raises(od.InputError, match="must be a "):
        getattr(od, name)(
            **{"folder": "nowhere"} if name == "write_report" else ACCEPTED[name] if name == "sweep" else {},
            **{"study" if name == "write_report" else "scenario": wrong},
        )


MATRIX = ca.DM.eye(2)
NAMED = {
    "drift as a list": ({"drift": [X[1], X[0]]}, "drift is "),
    "drift as MX": ({"drift": ca.MX.sym("z", 2)}, "drift is z: must be a CasADi SX"),
    "state as MX": ({"state": ca.MX.sym("z", 2)}, "state is MX"),
    "outputs as a list": ({"outputs": [X[0]]}, "outputs is "),
    "known as a matrix": ({"known": MATRIX}, "known is "),
    "names that are numbers": ({"names": (1, 2)}, r"names\[0\] is 1: must be a text"),
    "a field as MX": ({"known": {"u": ca.MX.sym("z", 2)}}, r"known\['u'\] is z: must be a CasADi SX"),
    "an output that is no expression": ({"outputs": {"y": "x"}}, r"outputs\['y'\] is x: must be a CasADi SX"),
    "a sigma in words": ({"sigmas": {"y": "big"}}, "y"),
}


@pytest.mark.parametrize("case", NAMED)
def test_a_system_is_refused_by_the_name_of_what_is_wrong(case: str) -> None:
    arguments, message = NAMED[case]
    with pytest.raises(od.InputError, match=message):
        od.ControlAffineSystem(**{**LINEAR, **arguments})


def test_a_verdict_is_refused_by_the_name_of_what_is_wrong() -> None:
    system = od.ControlAffineSystem(**LINEAR)
    od.select_next(**ACCEPTED["select_next"])  # loads a system that is no public name
    with pytest.raises(od.InputError, match=r"system is None: must be one of ControlAffineSystem, (\w+, )*System"):
        od.observability(None)  # pyright: ignore[reportArgumentType]
    with pytest.raises(od.InputError, match=r"held is \['u'\]: must be a dict from a text to a number"):
        od.observability(system, held=["u"])  # pyright: ignore[reportArgumentType]
    with pytest.raises(od.InputError, match=r"held\['u'\] is 'x': must be a number"):
        od.observability(system, held={"u": "x"})  # pyright: ignore[reportArgumentType]


@validate_arguments
def sample(  # noqa: PLR0917  # one of each kind
    whole: int = 1,
    number: float = 1.0,
    pair: tuple[float, float] = (0.0, 1.0),
    names: Sequence[str] = (),
    table: Mapping[str, float] | None = None,
    choice: Literal["a", "b"] = "a",
    values: ArrayLike | None = None,
    made_by: Callable[[], int] | None = None,
    executor: Executor | None = None,
) -> str:
    """Return that all was accepted."""
    return "accepted"


@pytest.mark.parametrize(
    "arguments",
    [
        {"whole": np.int64(3), "number": np.float32(2.0)},
        {"number": 3, "pair": np.array([1.0, 2.0]), "names": ["a", "b"]},
        {"table": {"a": 1}, "choice": "b", "values": [[1, 2], [3, 4]], "made_by": int},
        {"values": np.zeros((2, 0)), "table": None},
    ],
)
def test_what_stands_for_the_annotated_type_is_accepted(arguments: Mapping[str, Any]) -> None:
    assert sample(**arguments) == "accepted"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"whole": 2.0}, "whole is 2.0: must be a whole number"),
        ({"whole": True}, "whole is True: must be a whole number"),
        ({"number": math.nan}, "number is nan: must be a number"),
        ({"number": "3"}, "number is '3': must be a number"),
        ({"pair": (1.0,)}, r"pair is \(1.0,\): must be 2 entries, each a number"),
        ({"pair": (1.0, None)}, r"pair\[1\] is None: must be a number"),
        ({"names": "word"}, "names is 'word': must be a tuple or list, each entry a text"),
        ({"table": {"a": None}}, r"table\['a'\] is None: must be a number"),
        ({"table": {1: 1.0}}, r"table: the key 1 is 1: must be a text"),
        ({"choice": "c"}, "choice is 'c': must be one of 'a', 'b'"),
        ({"values": [[1, 2], [3]]}, r"values is \[\[1, 2\], \[3\]\]: must be an array of real numbers or None"),
        ({"made_by": 3}, "made_by is 3: must be a function or None"),
        ({"executor": 3}, "executor is 3: must be a"),
    ],
)
def test_the_message_names_the_argument_the_value_and_what_is_accepted(arguments: Mapping[str, Any], message: str) -> None:
    with pytest.raises(od.InputError, match=message):
        sample(**arguments)
