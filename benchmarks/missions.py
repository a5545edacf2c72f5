"""The design problems that are timed."""

from __future__ import annotations

import obsdesign as od

WIND = (0.3, -0.2)
START = (0.0, 0.0, 0.0, *WIND)
SCALE = (5.0, 5.0, 0.5, 0.3, 0.3)
BEACON = (10.0, 12.0)
DUBINS = od.Dubins(1.0, wind="constant")
LIMITS = (od.Goal((25.0, 5.0), tolerance=1.0), od.KeepOut((12.0, 2.0), radius=3.0))


def plateau() -> od.DesignProblem:
    """20 turn rates over 20 s, 100 samples of GPS of 1 m, unit scales: saturated."""
    return od.DesignProblem(
        system=od.System(DUBINS, (od.GPS(1.0),)),
        start=START,
        duration=20.0,
        step=0.2,
        path=od.PiecewiseConstant(20),
        bounds={"turn_rate": (-1.0, 1.0)},
    )


def mission(pieces: int = 40, step: float = 0.25) -> od.DesignProblem:
    """40 s to a goal past an obstacle, GPS of 2 m."""
    return _mission(od.System(DUBINS, (od.GPS(2.0),)), pieces, step)


def beacon_mission() -> od.DesignProblem:
    """The same with a compass, and range and bearing to a beacon, without GPS."""
    sensors = (od.Magnetometer(0.2), od.Range(BEACON, 1.0), od.Bearing(BEACON, 0.09))
    return _mission(od.System(DUBINS, sensors), 40, 0.25)


def _mission(system: od.System, pieces: int, step: float) -> od.DesignProblem:
    return od.DesignProblem(
        system=system,
        start=START,
        duration=40.0,
        step=step,
        path=od.PiecewiseConstant(pieces),
        bounds={"turn_rate": (-0.5, 0.5)},
        criterion=od.MinEigenvalue(),
        scale=SCALE,
        constraints=LIMITS,
    )
