"""Wheeled robots, SLAM, underwater vehicles, multirotors, arms and drives.

A wheeled robot is (x, y, heading) throughout; speed and turn are its speed along the heading and its turn rate.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import casadi as ca

import obsdesign as od

from .case import Case, column, symbols

# dyadic, as every constant here: CasADi folds constants in double precision, exact arithmetic would see the rounding
GRAVITY = 9.8125
INPUTS_OF_QUADROTOR = ("thrust", "rate_x", "rate_y", "rate_z")


def _system(
    names: tuple[str, ...],
    drift: ca.SX | None,
    known: dict[str, ca.SX],
    unknown: dict[str, ca.SX],
    outputs: dict[str, ca.SX],
    state: ca.SX,
) -> od.ControlAffineSystem:
    return od.ControlAffineSystem(state=state, names=names, drift=drift, known=known, unknown=unknown, outputs=outputs)


def _divided(fields: dict[str, ca.SX], missing: tuple[str, ...]) -> tuple[dict[str, ca.SX], dict[str, ca.SX]]:
    """The input fields as (known, unknown): the missing ones are unknown."""
    return {k: v for k, v in fields.items() if k not in missing}, {k: fields[k] for k in missing}


def _bearing(x: ca.SX, y: ca.SX, heading: ca.SX, landmark: tuple[ca.SX | float, ca.SX | float] = (0.0, 0.0)) -> ca.SX:
    """Direction to the landmark in the robot's own frame."""
    return ca.atan2(landmark[1] - y, landmark[0] - x) - heading


def _range(x: ca.SX, y: ca.SX, landmark: tuple[ca.SX | float, ca.SX | float] = (0.0, 0.0)) -> ca.SX:
    return ca.sqrt((landmark[0] - x) ** 2 + (landmark[1] - y) ** 2)


def unicycle(outputs: Callable[..., dict[str, ca.SX]], missing: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Unicycle with the inputs speed and turn, some of them missing."""
    names = ("x", "y", "heading")
    state, (x, y, heading) = symbols(*names)
    fields = {"speed": column(ca.cos(heading), ca.sin(heading), 0), "turn": column(0, 0, 1)}
    return _system(names, None, *_divided(fields, missing), outputs(x, y, heading), state)


def _position(x: ca.SX, y: ca.SX, _heading: ca.SX) -> dict[str, ca.SX]:
    return {"east": x, "north": y}


def _range_to_origin(x: ca.SX, y: ca.SX, _heading: ca.SX) -> dict[str, ca.SX]:
    return {"range": _range(x, y)}


def _bearing_to_origin(x: ca.SX, y: ca.SX, heading: ca.SX) -> dict[str, ca.SX]:
    return {"bearing": _bearing(x, y, heading)}


def _azimuth_from_origin(x: ca.SX, y: ca.SX, _heading: ca.SX) -> dict[str, ca.SX]:
    return {"azimuth": ca.atan2(y, x)}


def _bearings_to_known(x: ca.SX, y: ca.SX, heading: ca.SX, count: int) -> dict[str, ca.SX]:
    landmarks = ((0.0, 0.0), (3.0, 1.0), (-1.0, 4.0))
    return {f"bearing{k}": _bearing(x, y, heading, landmark) for k, landmark in enumerate(landmarks[:count])}


def unicycle_with_slip(missing: tuple[str, ...]) -> od.ControlAffineSystem:
    """Unicycle that also slips sideways, seen by GPS."""
    names = ("x", "y", "heading")
    state, (x, y, heading) = symbols(*names)
    fields = {
        "speed": column(ca.cos(heading), ca.sin(heading), 0),
        "turn": column(0, 0, 1),
        "slip": column(-ca.sin(heading), ca.cos(heading), 0),
    }
    return _system(names, None, *_divided(fields, missing), {"east": x, "north": y}, state)


def two_robots(outputs: tuple[str, ...], missing: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Position and heading of a second unicycle in the frame of the first."""
    names = ("x", "y", "relative_heading")
    state, (x, y, relative) = symbols(*names)
    fields = {
        "speed1": column(-1, 0, 0),
        "turn1": column(y, -x, -1),
        "speed2": column(ca.cos(relative), ca.sin(relative), 0),
        "turn2": column(0, 0, 1),
    }
    every = {"range": _range(x, y), "bearing": ca.atan2(y, x), "orientation": relative}
    return _system(names, None, *_divided(fields, missing), {k: every[k] for k in outputs}, state)


def cooperative(count: int) -> od.ControlAffineSystem:
    """Unicycles in one world frame, the distances between neighbours in the list and between the last and the first measured."""
    names = tuple(f"{name}{k}" for k in range(count) for name in ("x", "y", "heading"))
    state, entries = symbols(*names)
    fields, zeros = {}, ca.SX.zeros(3 * count)
    for k in range(count):
        heading = entries[3 * k + 2]
        for name, block in (("speed", column(ca.cos(heading), ca.sin(heading), 0)), ("turn", column(0, 0, 1))):
            fields[f"{name}{k}"] = ca.vertcat(zeros[: 3 * k], block, zeros[3 * k + 3 :])
    pairs = [(k, (k + 1) % count) for k in range(count if count > 2 else 1)]
    outputs = {f"range{i}{j}": _range(entries[3 * i], entries[3 * i + 1], (entries[3 * j], entries[3 * j + 1])) for i, j in pairs}
    return _system(names, None, fields, {}, outputs, state)


def slam(count: int, outputs: tuple[str, ...], missing: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Unicycle and landmarks at unknown places."""
    names = ("x", "y", "heading", *(f"{axis}_landmark{k}" for k in range(count) for axis in "xy"))
    state, (x, y, heading, *landmarks) = symbols(*names)
    zeros = ca.SX.zeros(2 * count)
    fields = {"speed": column(ca.cos(heading), ca.sin(heading), 0, zeros), "turn": column(0, 0, 1, zeros)}
    seen = {}
    for k in range(count):
        landmark = (landmarks[2 * k], landmarks[2 * k + 1])
        if "bearing" in outputs:
            seen[f"bearing{k}"] = _bearing(x, y, heading, landmark)
        if "range" in outputs:
            seen[f"range{k}"] = _range(x, y, landmark)
    return _system(names, None, *_divided(fields, missing), seen, state)


def odometry_and_bearing_calibration() -> od.ControlAffineSystem:
    """Differential drive with unknown wheels and base, a bearing sensor mounted at an unknown pose, one landmark at the origin."""
    names = ("x", "y", "heading", "arm", "arm_angle", "mounting_angle", "right_wheel", "left_wheel", "base")
    state, (x, y, heading, arm, arm_angle, mounting, right, left, base) = symbols(*names)
    zeros = ca.SX.zeros(6)
    known = {
        "right_rate": column(right * ca.cos(heading) / 2, right * ca.sin(heading) / 2, right / base, zeros),
        "left_rate": column(left * ca.cos(heading) / 2, left * ca.sin(heading) / 2, -left / base, zeros),
    }
    camera = (x + arm * ca.cos(heading + arm_angle), y + arm * ca.sin(heading + arm_angle))
    return _system(names, None, known, {}, {"bearing": _bearing(*camera, heading + mounting)}, state)


def odometry_calibration_by_gps() -> od.ControlAffineSystem:
    """Differential drive with unknown wheels and base, seen by GPS."""
    names = ("x", "y", "heading", "right_wheel", "left_wheel", "base")
    state, (x, y, heading, right, left, base) = symbols(*names)
    zeros = ca.SX.zeros(3)
    known = {
        "right_rate": column(right * ca.cos(heading) / 2, right * ca.sin(heading) / 2, right / base, zeros),
        "left_rate": column(left * ca.cos(heading) / 2, left * ca.sin(heading) / 2, -left / base, zeros),
    }
    return _system(names, None, known, {}, {"east": x, "north": y}, state)


def car(missing: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Kinematic car with an unknown wheelbase, steered by the steering rate, its rear axle seen by GPS."""
    names = ("x", "y", "heading", "steering", "wheelbase")
    state, (x, y, heading, steering, wheelbase) = symbols(*names)
    fields = {
        "speed": column(ca.cos(heading), ca.sin(heading), ca.tan(steering) / wheelbase, 0, 0),
        "steering_rate": column(0, 0, 0, 1, 0),
    }
    return _system(names, None, *_divided(fields, missing), {"east": x, "north": y}, state)


def trailers(count: int, on_last: bool, missing: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Unicycle that pulls trailers hitched at the axles; (x, y) is the axle of the last trailer, or of the tractor."""
    names = ("x", "y", "heading", *(f"trailer{k + 1}" for k in range(count)))
    state, (x, y, *angles) = symbols(*names)
    lengths = (1.0, 2.0, 0.5)
    # speed of each axle, from the tractor backwards, for unit speed of the tractor
    speeds, rates = [ca.SX(1)], []
    for k in range(count):
        rates.append(speeds[-1] * ca.sin(angles[k] - angles[k + 1]) / lengths[k])
        speeds.append(speeds[-1] * ca.cos(angles[k] - angles[k + 1]))
    axle = count if on_last else 0
    fields = {
        "speed": column(speeds[axle] * ca.cos(angles[axle]), speeds[axle] * ca.sin(angles[axle]), 0, *rates),
        "turn": column(0, 0, 1, *([0] * count)),
    }
    return _system(names, None, *_divided(fields, missing), {"east": x, "north": y}, state)


def auv_with_current(dimensions: int, constant: bool) -> od.ControlAffineSystem:
    """Underwater vehicle of known velocity through the water, the range to a beacon at the origin; the current a state or unknown."""
    axes = "xyz"[:dimensions]
    names = (*axes, *((f"current_{axis}" for axis in axes) if constant else ()))
    state, entries = symbols(*names)
    position = entries[:dimensions]
    unit, n = ca.SX.eye(len(names)), dimensions
    known = {f"velocity_{axis}": unit[:, k] for k, axis in enumerate(axes)}
    unknown = {} if constant else {f"current_{axis}": unit[:, k] for k, axis in enumerate(axes)}
    drift = ca.vertcat(*entries[n:], ca.SX.zeros(n)) if constant else None
    distance = ca.sqrt(sum(entry**2 for entry in position))
    return _system(names, drift, known, unknown, {"range": distance}, state)


def auv_without_compass() -> od.ControlAffineSystem:
    """Unicycle in a constant current, the range to one beacon at the origin."""
    names = ("x", "y", "heading", "current_x", "current_y")
    state, (x, y, heading, current_x, current_y) = symbols(*names)
    known = {"speed": column(ca.cos(heading), ca.sin(heading), 0, 0, 0), "turn": column(0, 0, 1, 0, 0)}
    return _system(names, column(current_x, current_y, 0, 0, 0), known, {}, {"range": _range(x, y)}, state)


def nomoto(constant_current: bool, compass: bool) -> od.ControlAffineSystem:
    """Nomoto ship of known speed through the water with a rudder offset in a current; GPS, and a compass or not."""
    names = ("x", "y", "heading", "turn_rate", "offset", *(("current_x", "current_y") if constant_current else ()))
    state, (x, y, heading, turn_rate, offset, *current) = symbols(*names)
    speed, gain, time_constant = 5.0, 0.25, 8.0
    flow = current or [0.0, 0.0]
    zeros = ca.SX.zeros(len(current))
    drift = column(
        speed * ca.cos(heading) + flow[0],
        speed * ca.sin(heading) + flow[1],
        turn_rate,
        (gain * offset - turn_rate) / time_constant,
        0,
        zeros,
    )
    known = {"rudder": column(0, 0, 0, gain / time_constant, 0, zeros)}
    unknown = {} if constant_current else {"current_x": column(1, 0, 0, 0, 0), "current_y": column(0, 1, 0, 0, 0)}
    outputs = {"east": x, "north": y, **({"compass": heading} if compass else {})}
    return _system(names, drift, known, unknown, outputs, state)


def vtol(oscillation_centre: bool, missing: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Planar vertical take-off aircraft; seen is its centre of mass or its centre of oscillation."""
    names = ("x", "z", "roll", "speed_x", "speed_z", "roll_rate")
    state, (x, z, roll, speed_x, speed_z, roll_rate) = symbols(*names)
    coupling = 0.5
    fields = {
        "thrust": column(0, 0, 0, -ca.sin(roll), ca.cos(roll), 0),
        "moment": column(0, 0, 0, coupling * ca.cos(roll), coupling * ca.sin(roll), 1),
    }
    arm = coupling if oscillation_centre else 0.0
    outputs = {"across": x - arm * ca.sin(roll), "up": z + arm * ca.cos(roll)}
    return _system(names, column(speed_x, speed_z, roll_rate, 0, -GRAVITY, 0), *_divided(fields, missing), outputs, state)


def quadrotor(missing: tuple[str, ...] = (), wind: bool = False, yaw_seen: bool = False) -> od.ControlAffineSystem:
    """Quadrotor with thrust and body rates as inputs, its position seen; wind is an unknown acceleration."""
    names = ("x", "y", "z", "speed_x", "speed_y", "speed_z", "roll", "pitch", "yaw")
    state, (x, y, z, *speeds, roll, pitch, yaw) = symbols(*names)
    zeros = ca.SX.zeros(3)
    direction = column(
        ca.cos(roll) * ca.sin(pitch) * ca.cos(yaw) + ca.sin(roll) * ca.sin(yaw),
        ca.cos(roll) * ca.sin(pitch) * ca.sin(yaw) - ca.sin(roll) * ca.cos(yaw),
        ca.cos(roll) * ca.cos(pitch),
    )
    fields = {
        "thrust": column(zeros, direction, zeros),
        "rate_x": column(zeros, zeros, 1, 0, 0),
        "rate_y": column(zeros, zeros, ca.sin(roll) * ca.tan(pitch), ca.cos(roll), ca.sin(roll) / ca.cos(pitch)),
        "rate_z": column(zeros, zeros, ca.cos(roll) * ca.tan(pitch), -ca.sin(roll), ca.cos(roll) / ca.cos(pitch)),
    }
    known, unknown = _divided(fields, missing)
    if wind:
        unit = ca.SX.eye(9)
        unknown |= {f"wind_{axis}": unit[:, 3 + k] for k, axis in enumerate("xyz")}
    outputs = {"east": x, "north": y, "up": z, **({"compass": yaw} if yaw_seen else {})}
    return _system(names, column(*speeds, 0, 0, -GRAVITY, zeros), known, unknown, outputs, state)


def arm(outputs: tuple[str, ...], missing: tuple[str, ...]) -> od.ControlAffineSystem:
    """Two-link arm in the vertical plane, unit links with unit point masses at their ends, joint torques as inputs."""
    names = ("angle1", "angle2", "rate1", "rate2")
    state, (angle1, angle2, rate1, rate2) = symbols(*names)
    mass11, mass12, mass22 = 3 + 2 * ca.cos(angle2), 1 + ca.cos(angle2), 1
    determinant = mass11 * mass22 - mass12**2
    load1 = ca.sin(angle2) * (2 * rate1 * rate2 + rate2**2) - GRAVITY * (2 * ca.cos(angle1) + ca.cos(angle1 + angle2))
    load2 = -ca.sin(angle2) * rate1**2 - GRAVITY * ca.cos(angle1 + angle2)
    drift = column(rate1, rate2, (mass22 * load1 - mass12 * load2) / determinant, (mass11 * load2 - mass12 * load1) / determinant)
    fields = {
        "torque1": column(0, 0, mass22 / determinant, -mass12 / determinant),
        "torque2": column(0, 0, -mass12 / determinant, mass11 / determinant),
    }
    every = {"encoder1": angle1, "encoder2": angle2}
    return _system(names, drift, *_divided(fields, missing), {k: every[k] for k in outputs}, state)


def pendulum() -> od.ControlAffineSystem:
    """Free pendulum with unknown stiffness (gravity over length) and damping, its angle seen."""
    names = ("angle", "rate", "stiffness", "damping")
    state, (angle, rate, stiffness, damping) = symbols(*names)
    return _system(names, column(rate, -stiffness * ca.sin(angle) - damping * rate, 0, 0), {}, {}, {"encoder": angle}, state)


def cart_pole(output: str, friction: bool) -> od.ControlAffineSystem:
    """Cart of mass 2 with a unit point mass on a unit pole, a known force on the cart, and an unknown friction force or not."""
    names = ("place", "speed", "angle", "rate")
    state, (place, speed, angle, rate) = symbols(*names)
    sine, cosine = ca.sin(angle), ca.cos(angle)
    denominator = 2 + sine**2
    drift = column(
        speed,
        (sine * rate**2 - GRAVITY * sine * cosine) / denominator,
        rate,
        (3 * GRAVITY * sine - sine * cosine * rate**2) / denominator,
    )
    field = column(0, 1 / denominator, 0, -cosine / denominator)
    every = {"rail": place, "encoder": angle}
    return _system(names, drift, {"force": field}, {"friction": field} if friction else {}, {output: every[output]}, state)


def dc_motor(unknown_constant: bool) -> od.ControlAffineSystem:
    """DC motor with its current seen, the voltage known, the load torque unknown, the torque constant known or a state."""
    names = ("current", "rate", *(("torque_constant",) if unknown_constant else ("angle",)))
    state, (current, rate, third) = symbols(*names)
    resistance, inductance, inertia, damping = 1.5, 0.25, 0.5, 0.125
    constant = third if unknown_constant else ca.SX(0.75)
    drift = column(
        -(resistance * current + constant * rate) / inductance,
        (constant * current - damping * rate) / inertia,
        0 if unknown_constant else rate,
    )
    known, unknown = {"voltage": column(1 / inductance, 0, 0)}, {"load": column(0, -1 / inertia, 0)}
    return _system(names, drift, known, unknown, {"ammeter": current}, state)


def induction_motor() -> od.ControlAffineSystem:
    """Induction motor in the stator frame, stator currents seen, stator voltages known, load torque unknown."""
    names = ("current_a", "current_b", "flux_a", "flux_b", "speed")
    state, (current_a, current_b, flux_a, flux_b, speed) = symbols(*names)
    rotor_rate, coupling, losses, inverse, torque, inertia, mutual = 2.0, 3.0, 5.0, 4.0, 0.5, 0.25, 0.75
    drift = column(
        coupling * rotor_rate * flux_a + coupling * speed * flux_b - losses * current_a,
        coupling * rotor_rate * flux_b - coupling * speed * flux_a - losses * current_b,
        -rotor_rate * flux_a - speed * flux_b + rotor_rate * mutual * current_a,
        -rotor_rate * flux_b + speed * flux_a + rotor_rate * mutual * current_b,
        torque / inertia * (flux_a * current_b - flux_b * current_a),
    )
    known = {"voltage_a": column(inverse, 0, 0, 0, 0), "voltage_b": column(0, inverse, 0, 0, 0)}
    unknown = {"load": column(0, 0, 0, 0, -1 / inertia)}
    return _system(names, drift, known, unknown, {"ammeter_a": current_a, "ammeter_b": current_b}, state)


def permanent_magnet_motor() -> od.ControlAffineSystem:
    """Surface permanent-magnet synchronous motor in the stator frame, currents seen, voltages known, load torque unknown."""
    names = ("current_a", "current_b", "speed", "angle")
    state, (current_a, current_b, speed, angle) = symbols(*names)
    resistance, inductance, flux, inertia = 1.5, 0.5, 0.75, 0.25
    drift = column(
        (-resistance * current_a + flux * speed * ca.sin(angle)) / inductance,
        (-resistance * current_b - flux * speed * ca.cos(angle)) / inductance,
        flux / inertia * (current_b * ca.cos(angle) - current_a * ca.sin(angle)),
        speed,
    )
    known = {"voltage_a": column(1 / inductance, 0, 0, 0), "voltage_b": column(0, 1 / inductance, 0, 0)}
    unknown = {"load": column(0, 0, -1 / inertia, 0)}
    return _system(names, drift, known, unknown, {"ammeter_a": current_a, "ammeter_b": current_b}, state)


def robot_with_unknown_inertia(resistance: bool) -> od.ControlAffineSystem:
    """Dynamic unicycle of unknown mass and inertia, force and torque known, seen by GPS, with an unknown resisting force or not."""
    names = ("x", "y", "heading", "speed", "turn_rate", "mass", "inertia")
    state, (x, y, heading, speed, turn_rate, mass, inertia) = symbols(*names)
    drift = column(speed * ca.cos(heading), speed * ca.sin(heading), turn_rate, 0, 0, 0, 0)
    known = {"force": column(0, 0, 0, 1 / mass, 0, 0, 0), "torque": column(0, 0, 0, 0, 1 / inertia, 0, 0)}
    unknown = {"resistance": column(0, 0, 0, -1 / mass, 0, 0, 0)} if resistance else {}
    return _system(names, drift, known, unknown, {"east": x, "north": y}, state)


CASES = (
    Case(
        name="unicycle: GPS, both inputs unknown",
        source=(
            "Rouchon, Fliess, Levine & Martin 1993, CDC: the position of a unicycle is a flat output, so the state follows "
            "from it without the inputs"
        ),
        build=partial(unicycle, _position, ("speed", "turn")),
        dimension=3,
    ),
    Case(
        name="unicycle: range to a beacon",
        source=(
            "after Bicchi, Prattichizzo, Marigo & Balestrino 1998, Theory and Practice of Control and Systems; figure "
            "computed; hidden: rotation about the beacon"
        ),
        build=partial(unicycle, _range_to_origin),
        dimension=2,
        observable_states=(),
    ),
    Case(
        name="unicycle: range to a beacon, speed unknown",
        source=("Martinelli 2019, IEEE TAC 64(1), the unicycle with one unknown input; figure computed; hidden: rotation about the beacon"),
        build=partial(unicycle, _range_to_origin, ("speed",)),
        dimension=2,
        observable_states=(),
    ),
    Case(
        name="unicycle: bearing of a landmark, turn rate unknown",
        source=(
            "Martinelli 2019, IEEE TAC 64(1), the unicycle with one unknown input; figure computed; hidden: rotation about the landmark"
        ),
        build=partial(unicycle, _bearing_to_origin, ("turn",)),
        dimension=2,
        observable_states=(),
    ),
    Case(
        name="unicycle: bearing of a landmark, speed unknown",
        source=(
            "Martinelli 2019, IEEE TAC 64(1), the unicycle with one unknown input; figure computed; hidden: rotation about "
            "the landmark and scale"
        ),
        build=partial(unicycle, _bearing_to_origin, ("speed",)),
        dimension=1,
        observable_states=(),
    ),
    Case(
        name="unicycle: azimuth seen from a station, turn rate unknown",
        source="Martinelli 2019, IEEE TAC 64(1), the unicycle with one unknown input; figure computed",
        build=partial(unicycle, _azimuth_from_origin, ("turn",)),
        dimension=3,
    ),
    Case(
        name="unicycle: azimuth seen from a station, speed unknown",
        source="Martinelli 2019, IEEE TAC 64(1), the unicycle with one unknown input; figure computed; hidden: scale",
        build=partial(unicycle, _azimuth_from_origin, ("speed",)),
        dimension=2,
        observable_states=("heading",),
    ),
    Case(
        name="unicycle: two known landmarks, both inputs unknown",
        source=(
            "Belo, Salaris & Bicchi 2010, IROS, who use three; figure for two computed; hidden: the circle on which the "
            "bearings differ by the same angle"
        ),
        build=partial(unicycle, partial(_bearings_to_known, count=2), ("speed", "turn")),
        dimension=2,
        observable_states=(),
    ),
    Case(
        name="unicycle: three known landmarks, both inputs unknown",
        source=(
            "Belo, Salaris & Bicchi 2010, IROS, title: 3 known landmarks are enough for solving planar bearing SLAM and fully "
            "reconstruct unknown inputs"
        ),
        build=partial(unicycle, partial(_bearings_to_known, count=3), ("speed", "turn")),
        dimension=3,
    ),
    Case(
        name="unicycle: GPS, unknown side slip",
        source="computed; the speed over ground beside the known speed along the heading leaves the slip up to sign",
        build=partial(unicycle_with_slip, ("slip",)),
        dimension=3,
    ),
    Case(
        name="unicycle: GPS, unknown speed and side slip",
        source="computed; hidden: the heading, turned together with the two unknown inputs",
        build=partial(unicycle_with_slip, ("speed", "slip")),
        dimension=2,
        observable_states=("x", "y"),
    ),
    Case(
        name="two robots: relative range",
        source="Martinelli & Siegwart 2005, IROS; figure computed: range alone sees the relative configuration",
        build=partial(two_robots, ("range",)),
        dimension=3,
    ),
    Case(
        name="two robots: relative bearing",
        source="Martinelli & Siegwart 2005, IROS; figure computed: bearing alone sees the relative configuration",
        build=partial(two_robots, ("bearing",)),
        dimension=3,
    ),
    Case(
        name="two robots: relative orientation",
        source="Martinelli & Siegwart 2005, IROS; figure computed: orientation sees only itself; hidden: the relative position",
        build=partial(two_robots, ("orientation",)),
        dimension=1,
        observable_states=("relative_heading",),
    ),
    Case(
        name="two robots: range and bearing, odometry of the second unknown",
        source="multi-robot relative pose in SE(2), arXiv 2401.15313 (2024): observable from range and bearing",
        build=partial(two_robots, ("range", "bearing"), ("speed2", "turn2")),
        dimension=3,
    ),
    Case(
        name="two robots: bearing, odometry of the second unknown",
        source=(
            "arXiv 2401.15313 (2024) says range and bearing must both be measured where the second robot does not send its "
            "odometry; figure computed: the word along the known speed of the first robot, sin(bearing) / range, gives the "
            "range, so 3"
        ),
        build=partial(two_robots, ("bearing",), ("speed2", "turn2")),
        dimension=3,
    ),
    Case(
        name="cooperative localisation: three robots, ranges",
        source=(
            "Huang, Trawny, Mourikis & Roumeliotis 2011, Autonomous Robots 30(1): three unobservable directions; hidden: "
            "world translations and rotation"
        ),
        build=partial(cooperative, 3),
        dimension=6,
        observable_states=(),
    ),
    Case(
        name="SLAM: one landmark, range and bearing",
        source=("Huang, Mourikis & Roumeliotis 2010, IJRR 29(5): three unobservable directions; hidden: world translations and rotation"),
        build=partial(slam, 1, ("range", "bearing")),
        dimension=2,
        observable_states=(),
    ),
    Case(
        name="SLAM: three landmarks, bearing",
        source=(
            "Huang, Mourikis & Roumeliotis 2010, IJRR 29(5): three unobservable directions, the known speed giving the scale; "
            "figure for bearings computed"
        ),
        build=partial(slam, 3, ("bearing",)),
        dimension=6,
        observable_states=(),
    ),
    Case(
        name="SLAM: two landmarks, bearing, speed unknown",
        source="computed; hidden: world translations, rotation and scale",
        build=partial(slam, 2, ("bearing",), ("speed",)),
        dimension=3,
        observable_states=(),
    ),
    Case(
        name="SLAM: two landmarks, range, speed unknown",
        source="computed; hidden: world translations and rotation",
        build=partial(slam, 2, ("range",), ("speed",)),
        dimension=4,
        observable_states=(),
    ),
    Case(
        name="SLAM: three landmarks, bearing, both inputs unknown",
        source="after Belo, Salaris & Bicchi 2010, IROS; figure computed; hidden: world translations, rotation and scale",
        build=partial(slam, 3, ("bearing",), ("speed", "turn")),
        dimension=5,
        observable_states=(),
    ),
    Case(
        name="odometry and bearing sensor calibration",
        source=(
            "after Martinelli 2011, IEEE T-RO 27(2), by continuous symmetries; figure computed; hidden: rotation about the "
            "landmark and scale"
        ),
        build=odometry_and_bearing_calibration,
        dimension=7,
        observable_states=("arm_angle", "mounting_angle"),
    ),
    Case(
        name="odometry calibration by GPS",
        source="after Antonelli, Chiaverini & Fusco 2005, IEEE T-RO 21(5); figure computed",
        build=odometry_calibration_by_gps,
        dimension=6,
    ),
    Case(
        name="car: GPS, unknown wheelbase, speed unknown",
        source="computed",
        build=partial(car, ("speed",)),
        dimension=5,
    ),
    Case(
        name="car: GPS, unknown wheelbase, both inputs unknown",
        source="computed; hidden: wheelbase and steering at constant curvature, the steering rate following",
        build=partial(car, ("speed", "steering_rate")),
        dimension=4,
        observable_states=("x", "y", "heading"),
    ),
    Case(
        name="tractor with a trailer: GPS on the tractor",
        source="computed; hidden: the trailer, which does not act on the tractor",
        build=partial(trailers, 1, on_last=False),
        dimension=3,
        observable_states=("x", "y", "heading"),
    ),
    Case(
        name="two trailers: GPS on the last, both inputs unknown",
        source="Rouchon, Fliess, Levine & Martin 1993, CDC: the position of the last trailer is a flat output",
        build=partial(trailers, 2, on_last=True, missing=("speed", "turn")),
        dimension=5,
    ),
    Case(
        name="three trailers: GPS on the last, both inputs unknown",
        source="Rouchon, Fliess, Levine & Martin 1993, CDC: the position of the last trailer is a flat output",
        build=partial(trailers, 3, on_last=True, missing=("speed", "turn")),
        dimension=6,
    ),
    Case(
        name="underwater vehicle in space: range, constant current",
        source=(
            "Batista, Silvestre & Oliveira 2011, Systems & Control Letters 60(8); Indiveri & Parlangeli 2013, arXiv 1308.0517: observable"
        ),
        build=partial(auv_with_current, 3, constant=True),
        dimension=6,
    ),
    Case(
        name="underwater vehicle in the plane: range, linear current",
        source="after Ross & Jouffroy 2005, UUST; here the current grows linearly; figure computed; augmented state of 6",
        build=partial(auv_with_current, 2, constant=False),
        dimension=6,
        disturbance=1,
    ),
    Case(
        name="underwater vehicle without compass: range, constant current",
        source="computed; hidden: rotation of everything about the beacon",
        build=auv_without_compass,
        dimension=4,
        observable_states=(),
    ),
    Case(
        name="Nomoto ship: GPS and compass, constant current",
        source="model of Nomoto 1957 with rudder offset; figure computed",
        build=partial(nomoto, constant_current=True, compass=True),
        dimension=7,
    ),
    Case(
        name="Nomoto ship: GPS, unknown current",
        source="model of Nomoto 1957 with rudder offset; figure computed: 2 up to order 2, then 3, 4, 5",
        build=partial(nomoto, constant_current=False, compass=False),
        dimension=5,
    ),
    Case(
        name="vertical take-off aircraft: centre of oscillation, both inputs unknown",
        source="Martin, Devasia & Paden 1996, Automatica 32(1): a flat output",
        build=partial(vtol, oscillation_centre=True, missing=("thrust", "moment")),
        dimension=6,
    ),
    Case(
        name="vertical take-off aircraft: centre of mass, both inputs unknown",
        source=("Hauser, Sastry & Meyer 1992, Automatica 28(4): relative degrees 2 and 2; hidden: the zero dynamics, roll and roll rate"),
        build=partial(vtol, oscillation_centre=False, missing=("thrust", "moment")),
        dimension=4,
        observable_states=("x", "z", "speed_x", "speed_z"),
    ),
    Case(
        name="quadrotor: position and yaw, all inputs unknown",
        source="Mellinger & Kumar 2011, ICRA: position and yaw are flat outputs",
        build=partial(quadrotor, INPUTS_OF_QUADROTOR, yaw_seen=True),
        dimension=9,
    ),
    Case(
        name="quadrotor: position, all inputs unknown",
        source="Mellinger & Kumar 2011, ICRA, without the yaw; hidden: rotation about the thrust axis, the body rates following",
        build=partial(quadrotor, INPUTS_OF_QUADROTOR),
        dimension=8,
        observable_states=("x", "y", "z", "speed_x", "speed_y", "speed_z"),
    ),
    Case(
        name="quadrotor: position, constant wind force",
        source="computed; augmented state of 12",
        build=partial(quadrotor, wind=True),
        dimension=12,
        disturbance=0,
    ),
    Case(
        name="two-link arm: both encoders, unknown torques",
        source="after Spong 1995, IEEE Control Systems 15(1); the rates are the derivatives of what is seen",
        build=partial(arm, ("encoder1", "encoder2"), ("torque1", "torque2")),
        dimension=4,
    ),
    Case(
        name="two-link arm: second encoder, unknown first torque",
        source="after Spong 1995, IEEE Control Systems 15(1); figure computed: 2 up to order 3, then 3, 4",
        build=partial(arm, ("encoder2",), ("torque1",)),
        dimension=4,
    ),
    Case(
        name="two-link arm: first encoder, unknown torques",
        source="after Spong 1995, IEEE Control Systems 15(1); figure computed, relative degree 2; hidden: the second joint",
        build=partial(arm, ("encoder1",), ("torque1", "torque2")),
        dimension=2,
        observable_states=("angle1", "rate1"),
    ),
    Case(
        name="pendulum with unknown stiffness and damping",
        source="computed",
        build=pendulum,
        dimension=4,
    ),
    Case(
        name="pendulum with unknown stiffness and damping, at rest",
        source="the equilibrium is one for every stiffness and damping, so nothing depends on them",
        build=pendulum,
        dimension=2,
        observable_states=("angle", "rate"),
        at=(0.0, 0.0, 4.0, 0.5),
    ),
    Case(
        name="cart and pole: rail, unknown friction",
        source="computed",
        build=partial(cart_pole, "rail", friction=True),
        dimension=4,
    ),
    Case(
        name="cart and pole: encoder, unknown friction",
        source="computed; hidden: place and speed of the cart",
        build=partial(cart_pole, "encoder", friction=True),
        dimension=2,
        observable_states=("angle", "rate"),
    ),
    Case(
        name="cart and pole: encoder, constant friction",
        source="computed; augmented state of 5; hidden: place and speed of the cart",
        build=partial(cart_pole, "encoder", friction=True),
        dimension=3,
        disturbance=0,
    ),
    Case(
        name="DC motor: current, unknown load",
        source="computed; hidden: the angle",
        build=partial(dc_motor, unknown_constant=False),
        dimension=2,
        observable_states=("current", "rate"),
    ),
    Case(
        name="DC motor: current, unknown torque constant and load",
        source="computed: 2 up to order 2, then 3",
        build=partial(dc_motor, unknown_constant=True),
        dimension=3,
    ),
    Case(
        name="induction motor: currents, unknown load",
        source="model of de Wit, Youssef, Barbot, Martin & Malrait 2000, CDC; figure with an arbitrary load computed",
        build=induction_motor,
        dimension=5,
    ),
    Case(
        name="induction motor: currents, constant load",
        source="model of de Wit, Youssef, Barbot, Martin & Malrait 2000, CDC; figure computed; augmented state of 6",
        build=induction_motor,
        dimension=6,
        disturbance=0,
    ),
    Case(
        name="permanent-magnet motor: currents, unknown load",
        source="model of Vaclavek, Blaha & Herman 2013, IEEE TIE 60(8); figure with an arbitrary load computed",
        build=permanent_magnet_motor,
        dimension=4,
    ),
    Case(
        name="wheeled robot of unknown inertia: GPS, unknown resistance",
        source="computed; a known force on top of the same resistance weighs the robot",
        build=partial(robot_with_unknown_inertia, resistance=True),
        dimension=7,
    ),
)
