"""What a criterion makes of a path on which a direction is hidden: nothing, not the square of a rounding."""

from __future__ import annotations

import numpy as np
import pytest

import obsdesign as od

HEADINGS = (0.0, np.pi, 0.3, np.pi / 3, -2.7, -np.pi / 2)


def radial(heading: float) -> od.System:
    """A beacon 2 km straight ahead: of position and heading only the distance is seen."""
    return od.System(od.Dubins(10.0), (od.Range((2000 * np.cos(heading), 2000 * np.sin(heading)), sigma=1.0),))


@pytest.mark.parametrize("heading", HEADINGS)
def test_criteria_of_a_radial_leg_see_nothing(heading: float):
    # turning the start about the beacon, and sliding it across the leg, changes no distance to first order: rank 1 of 3
    system, u = radial(heading), np.zeros((20, 1))
    found = [od.information_value(system, [0, 0, heading], u, 0.5, each) for each in (od.MinEigenvalue(), od.LogDet(), od.TraceInverse())]
    assert found == [0.0, -np.inf, -np.inf]


@pytest.mark.parametrize("heading", HEADINGS)
def test_a_design_problem_rates_a_radial_leg_zero_in_any_unit(heading: float):
    system, u = radial(heading), np.zeros((20, 1))
    for unit in (1e-6, 1.0, 1e6):
        problem = od.DesignProblem(
            system=system,
            start=[0, 0, heading],
            duration=10.0,
            step=0.5,
            path=od.PiecewiseConstant(2),
            bounds={"turn_rate": (-0.3, 0.3)},
            scale=[unit, unit, 0.1],
        )
        assert problem.value(od.simulate(system, [0, 0, heading], u, 0.5)) == 0.0
        assert problem.values(np.array([[0, 0, heading]]), u).tolist() == [0.0]


def test_what_is_weak_and_true_keeps_its_value():
    # a second beacon across the leg, however bad: 1e-9 of the first one's information is there
    system = od.System(od.Dubins(10.0), (od.GPS(sigma=1.0), od.Magnetometer(sigma=1e4)))
    path = od.simulate(system, [0, 0, 0.3], np.zeros((1, 1)), 0.5)  # one sample: nothing but the magnetometer sees the heading
    problem = od.DesignProblem(
        system=system, start=[0, 0, 0.3], duration=0.5, step=0.5, path=od.PiecewiseConstant(1), bounds={"turn_rate": (-0.3, 0.3)}
    )
    assert problem.value(path) == pytest.approx(1e-8, rel=1e-12)
    assert od.information_value(system, path.x[0], path.u, 0.5, od.MinEigenvalue(), [1e-3, 1e-3, 1e-3]) == pytest.approx(1e-14, rel=1e-12)
