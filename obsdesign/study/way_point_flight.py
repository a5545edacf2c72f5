"""Flying through way points as autopilots do: along the legs, cutting corners, no faster round than the vehicle turns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.calculus import wrap
from obsdesign.design.problem_checks import position_of
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import simulate
from obsdesign.dynamics.step import step_of
from obsdesign.errors import InputError
from obsdesign.study.thinned_path import Autopilot
from obsdesign.trajectory import Trajectory

_PERIOD = 0.2  # between commands [s], unless steps are shorter; autopilots command at 10 Hz and more
_LONGEST = 1.5  # times as long as planned a flight may take
_STEEPEST = 1 / math.sqrt(2)  # sine of the steepest angle at which a leg is met


@dataclass(frozen=True)
class Guidance:
    """The L1 guidance of an autopilot: lateral acceleration 4 damping^2 V^2 / L1 sin(eta), L1 = damping period V / pi.

    The next leg begins `early` * V metres before a way point, or, where early is None, L1 times the turn there in right angles, at
    most L1. Source: S. Park, J. Deyst, J. How 2004; ArduPilot's AP_L1_Control (NAVL1_PERIOD 17 s, NAVL1_DAMPING 0.75,
    turn_distance); PX4's DirectionalGuidance (NPFG_PERIOD 10 s, NPFG_DAMPING 0.7, switch distance 0.32 period damping V).
    """

    period: float
    damping: float
    early: float | None

    def length(self, speed: float) -> float:
        """L1 [m]."""
        return self.damping * self.period * speed / math.pi

    def switch_distance(self, speed: float, turn: float) -> float:
        """How far before a way point [m] the next leg begins, which turns by `turn` [rad]."""
        share = min(abs(turn) / (math.pi / 2), 1.0)
        return self.length(speed) * share if self.early is None else self.early * speed


GUIDANCE: dict[Autopilot, Guidance] = {"px4": Guidance(10.0, 0.7, 0.32 * 10.0 * 0.7), "ardupilot": Guidance(17.0, 0.75, None)}


@dataclass(frozen=True)
class _Legs:
    """Way points (M, 2), the planned speed along each leg (M-1,), and how the vehicle takes commands."""

    points: np.ndarray
    speeds: np.ndarray
    guidance: Guidance
    low: float
    high: float

    def next_leg(self, leg: int, position: np.ndarray, speed: float) -> int:
        """Return the leg to follow: the next one near the way point, or beyond it; M-1 behind the last."""
        while leg < len(self.speeds):
            start, end = self.points[leg], self.points[leg + 1]
            is_last = leg + 1 == len(self.speeds)
            turn = 0.0 if is_last else wrap(_angle(self.points[leg + 2] - end) - _angle(end - start))
            near = 0.0 if is_last else self.guidance.switch_distance(speed, turn)
            if np.linalg.norm(position - end) > near and (position - end) @ (end - start) < 0:
                break
            leg += 1
        return leg

    def turn_rate(self, leg: int, position: np.ndarray, velocity: np.ndarray, air_speed: float) -> float:
        """Return the commanded turn rate [rad/s] along a leg."""
        along = self.points[leg + 1] - self.points[leg]
        offset, speed = position - self.points[leg], float(np.linalg.norm(velocity))
        length = max(self.guidance.length(speed), 1e-6)
        left = float(along[0] * offset[1] - along[1] * offset[0]) / max(float(np.linalg.norm(along)), 1e-9)
        meeting = math.asin(min(max(-left / length, -_STEEPEST), _STEEPEST))
        eta = min(max(meeting + wrap(_angle(along) - _angle(velocity)), -math.pi / 2), math.pi / 2)
        acceleration = 4 * self.guidance.damping**2 * speed**2 / length * math.sin(eta)
        return min(max(acceleration / max(air_speed, 1e-6), self.low), self.high)


def fly_way_points(
    system: AbstractSystem, path: Trajectory, points: np.ndarray, bounds: tuple[float, float], autopilot: Autopilot
) -> tuple[Trajectory, bool]:
    """Return the path flown through the way points of a path (indices (M,)), and whether the last was reached.

    The vehicle follows the legs by the autopilot's guidance, its turn rate within bounds [rad/s], its speed (input `speed` or `forward`)
    as planned along the leg; commands hold for at most 0.2 s, and the path has their mean over each of its steps.
    Raises InputError for a vehicle without x, y, heading and turn_rate.
    """
    model = system.model
    states, inputs = model.state_names, model.input_names
    if "heading" not in states or "turn_rate" not in inputs:
        raise InputError(f"way points are flown by vehicles with heading and turn_rate: this one has {', '.join((*states, *inputs))}")
    columns = list(position_of(states))
    legs = _Legs(path.x[points][:, columns], _leg_speeds(path, points, inputs, columns), GUIDANCE[autopilot], *bounds)
    count = max(round(path.step / _PERIOD), 1)
    one, whole = _step_function(system, path.step / count), _step_function(system, path.step)
    wind = [states.index(name) for name in ("wind_x", "wind_y") if name in states]
    x, leg, rows = path.x[0], 0, []
    velocity = (path.x[1] - path.x[0])[columns] / path.step
    while leg < len(legs.speeds) and len(rows) < _LONGEST * path.steps:
        commands, inside = [], x
        for _ in range(count):
            position, air = inside[columns], velocity - (inside[wind] if wind else 0.0)
            leg = legs.next_leg(leg, position, float(np.linalg.norm(velocity)))
            followed = min(leg, len(legs.speeds) - 1)
            rate = legs.turn_rate(followed, position, velocity, float(np.linalg.norm(air)))
            commands.append(_command(inputs, rate, legs.speeds[followed]))
            after = one(inside, commands[-1])
            velocity, inside = (after - inside)[columns] * count / path.step, after
        rows.append(np.mean(commands, axis=0))
        x = whole(x, rows[-1])
    return simulate(system, path.x[0], np.array(rows), path.step, tolerance=path.tolerance), leg >= len(legs.speeds)


def _angle(vector: np.ndarray) -> float:
    return math.atan2(vector[1], vector[0])


def _command(inputs: tuple[str, ...], turn_rate: float, speed: float) -> np.ndarray:
    values = {"turn_rate": turn_rate, "speed": speed, "forward": speed}
    return np.array([values.get(name, 0.0) for name in inputs])


def _leg_speeds(path: Trajectory, points: np.ndarray, inputs: tuple[str, ...], columns: list[int]) -> np.ndarray:
    """Return the planned speed of each leg: the mean of the input `speed`, or its length over its time."""
    if "speed" in inputs:
        return np.add.reduceat(path.u[:, inputs.index("speed")], points[:-1]) / np.diff(points)
    return np.linalg.norm(np.diff(path.x[points][:, columns], axis=0), axis=1) / np.diff(path.t[points])


def _step_function(system: AbstractSystem, dt: float):  # noqa: ANN202  # a closure over a CasADi function
    step = step_of(system.model, dt).without_disturbance()
    function = ca.Function("one", [step.x, step.u], [step.x_next])

    def advance(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the state (n,) after a step."""
        return np.array(function(x, u)).ravel()

    return advance
