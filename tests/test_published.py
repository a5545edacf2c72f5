"""Verdicts on published models: never wrong, and decided but for one."""

import pytest
from published import biology, classics, robotics, tracking, visual_inertial

import obsdesign as od

# Above 0.3 s on one core.
SLOW = {
    "Nomoto ship: GPS, unknown current",
    "two-link arm: second encoder, unknown first torque",
    "body frame: one feature, camera pose on the body",
    "body frame: no gyroscopes",
    "body frame: two accelerometers only",
    "body frame: one accelerometer only",
    "body frame: one accelerometer only, two features",
    "body frame: no accelerometers",
    "body frame: no accelerometers, two features",
    "body frame: range instead of image",
    "vertical plane: no gyroscope, one accelerometer",
    "vertical plane: no accelerometers",
    "world frame: unknown feature, biases",
    "world frame: legged robot, unknown foot, biases",
    "world frame: GPS, biases and antenna arm",
    "camera calibration: one known feature",
    "camera calibration: two known features",
    "two agents: no accelerometers on the second",
    "two agents: no inertial sensor on the second",
    "structure from motion: two points, velocity unknown",
    "attitude and gyro biases: one vector",
    "pancreatic tumour",
    "chemo immunotherapy",
    "tumour angiogenesis",
    "chemotherapy immunity",
    "bound drug",
    "minimal model unknown meal",
    "hovorka",
    "hovorka unknown meal",
    "catenary chain",
    "saturating chain",
    "saturating chain unknown input",
    "cooled reactor unknown feed",
    "akt",
    "akt known production",
    "kholodenko cascade",
    "il13 unknown",
    "nf kb unknown",
    "nf kb unknown, degree 0",
    "circadian clock",
}
UNDECIDED = {"two agents: no inertial sensor on the second"}
"""The dimension is found, but nothing proves that there is no more."""
MODULES = (robotics, tracking, visual_inertial, biology, classics)
CASES = {case.name: case for module in MODULES for case in module.CASES}
# those of the classics have tests of their own, which assert more
IN_SLOW_RUNS = SLOW | {case.name for case in classics.CASES}


def test_names_are_distinct_and_those_listed_exist():
    assert len(CASES) == sum(len(module.CASES) for module in MODULES)
    assert not (SLOW | UNDECIDED) - set(CASES)


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in IN_SLOW_RUNS)) for name in CASES])
def test_verdict(name):
    case = CASES[name]
    system = case.build()
    disturbance = "arbitrary" if case.disturbance == "arbitrary" else od.Polynomial(case.disturbance)
    verdict = od.observability(system, case.at, case.held, disturbance, case.known_inputs)
    assert verdict.dimension == case.dimension  # what is not decided is a lower bound, which is reached in the one such case
    assert verdict.decided or name in UNDECIDED
    assert verdict.observable == (case.dimension == len(verdict.at))
    if case.observable_states is not None:
        assert tuple(state for state in verdict.observable_states if state in system.names) == case.observable_states
    if verdict.observable:
        assert set(system.names) <= set(verdict.observable_states)
