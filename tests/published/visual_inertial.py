"""Cameras and inertial sensors.

Body-frame models follow one another closely: feature is the position of a point feature, velocity the body's own, gravity the
gravitational acceleration, all in the body frame; specific force and body rates are the inputs.
"""

from __future__ import annotations

from functools import partial

import casadi as ca

import obsdesign as od

from .case import Case, column, symbols

# dyadic: CasADi folds constants in double precision, exact arithmetic would see the rounding
GRAVITY = 9.8125
INERTIAL = ("force_x", "force_y", "force_z", "rate_x", "rate_y", "rate_z")


def _triple(name: str) -> tuple[str, str, str]:
    return (f"{name}_x", f"{name}_y", f"{name}_z")


def _projection(name: str, point: ca.SX) -> dict[str, ca.SX]:
    """Image coordinates of a point in the camera frame, optical axis z."""
    return {f"{name}_u": point[0] / point[2], f"{name}_v": point[1] / point[2]}


def _assembled(
    names: tuple[str, ...], state: ca.SX, derivative: ca.SX, inputs: ca.SX, missing: tuple[str, ...], outputs: dict[str, ca.SX]
) -> od.ControlAffineSystem:
    """System of a derivative affine in the inputs INERTIAL; the missing ones are unknown."""
    matrix = ca.jacobian(derivative, inputs)
    fields = {name: ca.densify(matrix[:, k]) for k, name in enumerate(INERTIAL)}
    return od.ControlAffineSystem(
        state=state,
        names=names,
        drift=ca.substitute(derivative, inputs, ca.SX.zeros(6)),
        known={name: field for name, field in fields.items() if name not in missing},
        unknown={name: fields[name] for name in missing},
        outputs=outputs,
    )


def _rotation_rates(roll: ca.SX, pitch: ca.SX, rate: ca.SX) -> ca.SX:
    """Derivative of (roll, pitch, yaw) for body rates."""
    along = ca.sin(roll) * rate[1] + ca.cos(roll) * rate[2]
    return ca.vertcat(rate[0] + ca.tan(pitch) * along, ca.cos(roll) * rate[1] - ca.sin(roll) * rate[2], along / ca.cos(pitch))


def _rotation(roll: ca.SX, pitch: ca.SX, yaw: ca.SX) -> ca.SX:
    """Body to world."""
    about_x = ca.blockcat([[1, 0, 0], [0, ca.cos(roll), -ca.sin(roll)], [0, ca.sin(roll), ca.cos(roll)]])
    about_y = ca.blockcat([[ca.cos(pitch), 0, ca.sin(pitch)], [0, 1, 0], [-ca.sin(pitch), 0, ca.cos(pitch)]])
    about_z = ca.blockcat([[ca.cos(yaw), -ca.sin(yaw), 0], [ca.sin(yaw), ca.cos(yaw), 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def _cayley(parameters: ca.SX) -> ca.SX:
    """Rotation matrix of a Gibbs vector, up to the positive factor that an image does not see."""
    square = ca.dot(parameters, parameters)
    return (1 - square) * ca.SX.eye(3) + 2 * parameters @ parameters.T + 2 * ca.skew(parameters)


def body_frame(
    missing: tuple[str, ...] = (), features: int = 1, biases: bool = False, extrinsic: bool = False, ranging: bool = False
) -> od.ControlAffineSystem:
    """Visual-inertial structure from motion in the body frame: features, velocity, gravity vector, biases, camera pose on the body."""
    names = (
        *(name for k in range(features) for name in _triple(f"feature{k}")),
        *_triple("velocity"),
        *_triple("gravity"),
        *((*_triple("force_bias"), *_triple("rate_bias")) if biases else ()),
        *((*_triple("camera_rotation"), *_triple("camera_arm")) if extrinsic else ()),
    )
    state, _ = symbols(*names)
    inputs, start = ca.SX.sym("inputs", 6), 3 * features
    force, rate = inputs[:3], inputs[3:]
    velocity, gravity = state[start : start + 3], state[start + 3 : start + 6]
    if biases:
        force, rate = force - state[start + 6 : start + 9], rate - state[start + 9 : start + 12]
    rotation, arm = (_cayley(state[-6:-3]), state[-3:]) if extrinsic else (ca.SX.eye(3), ca.SX.zeros(3))
    points = [state[3 * k : 3 * k + 3] for k in range(features)]
    moving = [
        *(-ca.cross(rate, point) - velocity for point in points),
        -ca.cross(rate, velocity) + force + gravity,
        -ca.cross(rate, gravity),
    ]
    still = ca.SX.zeros(len(names) - 3 * len(moving))
    outputs: dict[str, ca.SX] = {}
    for k, point in enumerate(points):
        outputs |= {f"range{k}": ca.sqrt(ca.dot(point, point))} if ranging else _projection(f"image{k}", rotation.T @ (point - arm))
    return _assembled(names, state, ca.vertcat(*moving, still), inputs, missing, outputs)


def planar_body_frame(missing: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Visual-inertial structure from motion in a vertical plane: feature, velocity and gravity in the body frame, bearing seen."""
    names = ("feature_x", "feature_y", "velocity_x", "velocity_y", "gravity_x", "gravity_y")
    state, (x, y, speed_x, speed_y, gravity_x, gravity_y) = symbols(*names)
    fields = {
        "force_x": column(0, 0, 1, 0, 0, 0),
        "force_y": column(0, 0, 0, 1, 0, 0),
        "rate": column(y, -x, speed_y, -speed_x, gravity_y, -gravity_x),
    }
    return od.ControlAffineSystem(
        state=state,
        names=names,
        drift=column(-speed_x, -speed_y, gravity_x, gravity_y, 0, 0),
        known={name: field for name, field in fields.items() if name not in missing},
        unknown={name: fields[name] for name in missing},
        outputs={"bearing": ca.atan2(y, x)},
    )


def world_frame(sensor: str, biases: bool, arm: bool = False, missing: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Inertial navigation in the world frame with roll, pitch and yaw; sensor is camera (unknown feature), gps or leg (unknown foot)."""
    names = (
        *_triple("position"),
        *_triple("velocity"),
        "roll",
        "pitch",
        "yaw",
        *((*_triple("force_bias"), *_triple("rate_bias")) if biases else ()),
        *(_triple("point") if sensor != "gps" else ()),
        *(_triple("arm") if arm else ()),
    )
    state, _ = symbols(*names)
    inputs = ca.SX.sym("inputs", 6)
    force, rate = inputs[:3], inputs[3:]
    if biases:
        force, rate = force - state[9:12], rate - state[12:15]
    position, velocity, (roll, pitch, yaw) = state[:3], state[3:6], ca.vertsplit(state[6:9])
    rotation = _rotation(roll, pitch, yaw)
    acceleration = rotation @ force - column(0, 0, GRAVITY)
    still = ca.SX.zeros(len(names) - 9)
    derivative = ca.vertcat(velocity, acceleration, _rotation_rates(roll, pitch, rate), still)
    if sensor == "gps":
        seen = position + (rotation @ state[-3:] if arm else 0)
        outputs = {f"gps_{axis}": seen[k] for k, axis in enumerate("xyz")}
    else:
        relative = rotation.T @ (state[-3:] - position)
        outputs = _projection("image", relative) if sensor == "camera" else {f"leg_{axis}": relative[k] for k, axis in enumerate("xyz")}
    return _assembled(names, state, derivative, inputs, missing, outputs)


def camera_calibration(features: int) -> od.ControlAffineSystem:
    """Camera at an unknown pose on an inertial unit without biases, features at known places."""
    names = (
        *_triple("position"),
        *_triple("velocity"),
        "roll",
        "pitch",
        "yaw",
        *_triple("camera_rotation"),
        *_triple("camera_arm"),
    )
    state, _ = symbols(*names)
    inputs = ca.SX.sym("inputs", 6)
    rotation = _rotation(*ca.vertsplit(state[6:9]))
    acceleration = rotation @ inputs[:3] - column(0, 0, GRAVITY)
    derivative = ca.vertcat(state[3:6], acceleration, _rotation_rates(state[6], state[7], inputs[3:]), ca.SX.zeros(6))
    places = ((0.0, 0.0, 0.0), (1.0, 0.0, 2.0), (-1.0, 3.0, 1.0))
    outputs: dict[str, ca.SX] = {}
    for k, place in enumerate(places[:features]):
        outputs |= _projection(f"image{k}", _cayley(state[9:12]).T @ (rotation.T @ (column(*place) - state[:3]) - state[12:]))
    return _assembled(names, state, derivative, inputs, (), outputs)


def two_agents(missing: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Two inertial units, one sees the other: relative position, velocity and attitude quaternion in the frame of the first."""
    names = (*_triple("position"), *_triple("velocity"), "q0", "q1", "q2", "q3")
    state, _ = symbols(*names)
    position, velocity, scalar, vector = state[:3], state[3:6], state[6], state[7:]
    inputs = ca.SX.sym("inputs", 12)
    force1, rate1, force2, rate2 = inputs[:3], inputs[3:6], inputs[6:9], inputs[9:]
    norm = scalar**2 + ca.dot(vector, vector)
    rotation = ((scalar**2 - ca.dot(vector, vector)) * ca.SX.eye(3) + 2 * vector @ vector.T + 2 * scalar * ca.skew(vector)) / norm
    derivative = ca.vertcat(
        -ca.cross(rate1, position) + velocity,
        -ca.cross(rate1, velocity) + rotation @ force2 - force1,
        ca.dot(rate1 - rate2, vector) / 2,
        (scalar * (rate2 - rate1) + ca.cross(vector, rate2 + rate1)) / 2,
    )
    matrix = ca.jacobian(derivative, inputs)
    fields = {f"{name}{agent}": ca.densify(matrix[:, 6 * (agent - 1) + k]) for agent in (1, 2) for k, name in enumerate(INERTIAL)}
    return od.ControlAffineSystem(
        state=state,
        names=names,
        drift=ca.substitute(derivative, inputs, ca.SX.zeros(12)),
        known={name: field for name, field in fields.items() if name not in missing},
        unknown={name: fields[name] for name in missing},
        outputs=_projection("image", position),
    )


def structure_from_motion(points: int, rates_known: bool) -> od.ControlAffineSystem:
    """Points in the frame of a camera whose velocity is unknown, and its body rates known or unknown too."""
    names = tuple(name for k in range(points) for name in _triple(f"point{k}"))
    state, _ = symbols(*names)
    every = [state[3 * k : 3 * k + 3] for k in range(points)]
    unit = ca.SX.eye(3)
    translations = {f"velocity_{axis}": ca.vertcat(*(-unit[:, k] for _ in every)) for k, axis in enumerate("xyz")}
    rotations = {f"rate_{axis}": ca.vertcat(*(-ca.cross(unit[:, k], point) for point in every)) for k, axis in enumerate("xyz")}
    outputs: dict[str, ca.SX] = {}
    for k, point in enumerate(every):
        outputs |= _projection(f"image{k}", point)
    unknown = translations if rates_known else translations | rotations
    return od.ControlAffineSystem(state=state, names=names, known=rotations if rates_known else {}, unknown=unknown, outputs=outputs)


def structure_from_constant_motion(points: int) -> od.ControlAffineSystem:
    """Points in the frame of a camera moving at a constant unknown velocity and constant unknown body rates."""
    names = (*(name for k in range(points) for name in _triple(f"point{k}")), *_triple("velocity"), *_triple("rate"))
    state, _ = symbols(*names)
    velocity, rate = state[-6:-3], state[-3:]
    every = [state[3 * k : 3 * k + 3] for k in range(points)]
    drift = ca.vertcat(*(-ca.cross(rate, point) - velocity for point in every), ca.SX.zeros(6))
    outputs: dict[str, ca.SX] = {}
    for k, point in enumerate(every):
        outputs |= _projection(f"image{k}", point)
    return od.ControlAffineSystem(state=state, names=names, drift=drift, outputs=outputs)


def attitude(vectors: int, biases: bool = True) -> od.ControlAffineSystem:
    """Attitude quaternion and gyro biases, known directions (magnetic field, sun) seen in the body frame."""
    names = ("q0", "q1", "q2", "q3", *(_triple("rate_bias") if biases else ()))
    state, _ = symbols(*names)
    scalar, vector = state[0], state[1:4]
    inputs = ca.SX.sym("inputs", 3)
    rate = inputs - state[4:] if biases else inputs
    norm = scalar**2 + ca.dot(vector, vector)
    rotation = ((scalar**2 - ca.dot(vector, vector)) * ca.SX.eye(3) + 2 * vector @ vector.T + 2 * scalar * ca.skew(vector)) / norm
    derivative = ca.vertcat(-ca.dot(vector, rate) / 2, (scalar * rate + ca.cross(vector, rate)) / 2, ca.SX.zeros(len(names) - 4))
    matrix = ca.jacobian(derivative, inputs)
    outputs = {}
    for k, direction in enumerate(((1.0, 0.0, 2.0), (0.0, 1.0, 0.0))[:vectors]):
        seen = rotation.T @ column(*direction)
        outputs |= {f"vector{k}_{axis}": seen[i] for i, axis in enumerate("xyz")}
    return od.ControlAffineSystem(
        state=state,
        names=names,
        drift=ca.substitute(derivative, inputs, ca.SX.zeros(3)),
        known={f"rate_{axis}": ca.densify(matrix[:, k]) for k, axis in enumerate("xyz")},
        outputs=outputs,
    )


def magnetometer(missing: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Magnetic field in the body frame and the offset of the magnetometer, body rates as inputs."""
    names = (*_triple("field"), *_triple("offset"))
    state, _ = symbols(*names)
    unit = ca.SX.eye(3)
    fields = {f"rate_{axis}": ca.vertcat(-ca.cross(unit[:, k], state[:3]), ca.SX.zeros(3)) for k, axis in enumerate("xyz")}
    return od.ControlAffineSystem(
        state=state,
        names=names,
        known={name: field for name, field in fields.items() if name not in missing},
        unknown={name: fields[name] for name in missing},
        outputs={f"magnetometer_{axis}": state[k] + state[3 + k] for k, axis in enumerate("xyz")},
    )


CASES = (
    Case(
        name="body frame: one feature",
        source="Martinelli 2012, IEEE T-RO 28(1): feature, velocity and gravity are observable in the body frame",
        build=body_frame,
        dimension=9,
    ),
    Case(
        name="body frame: one feature, biases",
        source="Martinelli 2012, IEEE T-RO 28(1): feature, velocity, gravity and biases are observable in the body frame",
        build=partial(body_frame, biases=True),
        dimension=15,
    ),
    Case(
        name="body frame: one feature, camera pose on the body",
        source="Kelly & Sukhatme 2011, IJRR 30(1); Martinelli 2012, IEEE T-RO 28(1): the camera calibrates itself",
        build=partial(body_frame, extrinsic=True),
        dimension=15,
    ),
    Case(
        name="body frame: no gyroscopes",
        source="Martinelli 2014, ICRA: nothing is lost",
        build=partial(body_frame, INERTIAL[3:]),
        dimension=9,
    ),
    Case(
        name="body frame: two accelerometers only",
        source="Martinelli 2014, ICRA: nothing is lost",
        build=partial(body_frame, ("force_x", *INERTIAL[3:])),
        dimension=9,
    ),
    Case(
        name="body frame: one accelerometer only",
        source="Martinelli 2014, ICRA: nothing is lost while the camera is calibrated; grows until order 7",
        build=partial(body_frame, ("force_x", "force_y", *INERTIAL[3:])),
        dimension=9,
    ),
    Case(
        name="body frame: one accelerometer only, two features",
        source="Martinelli 2014, ICRA: nothing is lost while the camera is calibrated",
        build=partial(body_frame, ("force_x", "force_y", *INERTIAL[3:]), features=2),
        dimension=12,
    ),
    Case(
        name="body frame: no accelerometers",
        source="computed; hidden: scale, the unknown specific force following",
        build=partial(body_frame, INERTIAL[:3]),
        dimension=8,
        observable_states=(),
    ),
    Case(
        name="body frame: no accelerometers, two features",
        source="computed; hidden: scale, the unknown specific force following",
        build=partial(body_frame, INERTIAL[:3], features=2),
        dimension=11,
        observable_states=(),
    ),
    Case(
        name="body frame: range instead of image",
        source="computed",
        build=partial(body_frame, ranging=True),
        dimension=9,
    ),
    Case(
        name="vertical plane: no gyroscope, one accelerometer",
        source="plane version of Martinelli 2014, ICRA; figure computed",
        build=partial(planar_body_frame, ("rate", "force_x")),
        dimension=6,
    ),
    Case(
        name="vertical plane: no accelerometers",
        source="plane version of Martinelli 2014, ICRA; figure computed: 2 up to order 3, then 3, 5; hidden: scale",
        build=partial(planar_body_frame, ("force_x", "force_y")),
        dimension=5,
        observable_states=(),
    ),
    Case(
        name="vertical plane: no inertial sensor",
        source="plane version of Martinelli 2014, ICRA; figure computed, relative degree 1",
        build=partial(planar_body_frame, ("rate", "force_x", "force_y")),
        dimension=1,
        observable_states=(),
    ),
    Case(
        name="world frame: unknown feature, biases",
        source=(
            "Jones & Soatto 2011, IJRR 30(4); Hesch, Kottas, Bowman & Roumeliotis 2014, IJRR 33(1): hidden: world translations and yaw"
        ),
        build=partial(world_frame, "camera", biases=True),
        dimension=14,
        observable_states=("velocity_z", "roll", "pitch", *_triple("force_bias"), *_triple("rate_bias")),
    ),
    Case(
        name="world frame: legged robot, unknown foot, biases",
        source="Bloesch, Hutter, Hoepflinger et al. 2012, RSS: hidden: position and yaw",
        build=partial(world_frame, "leg", biases=True),
        dimension=14,
        observable_states=("velocity_z", "roll", "pitch", *_triple("force_bias"), *_triple("rate_bias")),
    ),
    Case(
        name="world frame: GPS, biases",
        source=(
            "Hong, Lee, Chun, Kwon & Speyer 2005, IEEE TVT 54(2); Tang, Wu, Wu et al. 2009, IEEE TVT 58(3): observable under manoeuvres"
        ),
        build=partial(world_frame, "gps", biases=True),
        dimension=15,
    ),
    Case(
        name="world frame: GPS, biases and antenna arm",
        source="Hong, Lee, Chun, Kwon & Speyer 2005, IEEE TVT 54(2): arm observable under rotation",
        build=partial(world_frame, "gps", biases=True, arm=True),
        dimension=18,
    ),
    Case(
        name="camera calibration: one known feature",
        source=(
            "after Mirzaei & Roumeliotis 2008, IEEE T-RO 24(5); figure computed; hidden: rotation about the vertical through the feature"
        ),
        build=partial(camera_calibration, 1),
        dimension=14,
        observable_states=("position_z", "velocity_z", "roll", "pitch", *_triple("camera_rotation"), *_triple("camera_arm")),
    ),
    Case(
        name="camera calibration: two known features",
        source="after Mirzaei & Roumeliotis 2008, IEEE T-RO 24(5), who estimate biases too; figure computed",
        build=partial(camera_calibration, 2),
        dimension=15,
    ),
    Case(
        name="two agents: one sees the other",
        source=(
            "Martinelli, Renzaglia & Oliva 2020, Autonomous Robots 44: relative position, velocity and attitude observable; "
            "here also hidden: the norm of the quaternion"
        ),
        build=two_agents,
        dimension=9,
        observable_states=(*_triple("position"), *_triple("velocity")),
    ),
    Case(
        name="two agents: no accelerometers on the second",
        source="computed; hidden: the norm of the quaternion",
        build=partial(two_agents, ("force_x2", "force_y2", "force_z2")),
        dimension=9,
        observable_states=(*_triple("position"), *_triple("velocity")),
    ),
    Case(
        name="two agents: no inertial sensor on the second",
        source="computed; hidden: the quaternion, the unknown inputs following",
        build=partial(two_agents, tuple(f"{name}2" for name in INERTIAL)),
        dimension=6,
        observable_states=(*_triple("position"), *_triple("velocity")),
    ),
    Case(
        name="structure from motion: three points, motion unknown",
        source="computed; six outputs, six unknown inputs, relative degree 1: the images only",
        build=partial(structure_from_motion, 3, rates_known=False),
        dimension=6,
        observable_states=(),
    ),
    Case(
        name="structure from motion: four points, motion unknown",
        source="computed; hidden: scale",
        build=partial(structure_from_motion, 4, rates_known=False),
        dimension=11,
        observable_states=(),
    ),
    Case(
        name="structure from motion: five points, motion unknown",
        source="computed; hidden: scale",
        build=partial(structure_from_motion, 5, rates_known=False),
        dimension=14,
        observable_states=(),
    ),
    Case(
        name="structure from motion: two points, velocity unknown",
        source="computed; hidden: scale",
        build=partial(structure_from_motion, 2, rates_known=True),
        dimension=5,
        observable_states=(),
    ),
    Case(
        name="structure from motion: three points, constant motion",
        source="Chiuso, Favaro, Jin & Soatto 2002, IEEE PAMI 24(4): observable up to scale",
        build=partial(structure_from_constant_motion, 3),
        dimension=14,
        observable_states=("rate_x", "rate_y", "rate_z"),
    ),
    Case(
        name="attitude and gyro biases: one vector",
        source=(
            "model of Lefferts, Markley & Shuster 1982, JGCD 5(5); figure computed; hidden: rotation about the vector, norm "
            "of the quaternion"
        ),
        build=partial(attitude, 1),
        dimension=5,
        observable_states=(*_triple("rate_bias"),),
    ),
    Case(
        name="attitude and gyro biases: two vectors",
        source="model of Lefferts, Markley & Shuster 1982, JGCD 5(5); figure computed; hidden: norm of the quaternion",
        build=partial(attitude, 2),
        dimension=6,
        observable_states=(*_triple("rate_bias"),),
    ),
    Case(
        name="magnetometer offset: rates unknown",
        source="after Alonso & Shuster 2002, J. Astronaut. Sci. 50(4), attitude-independent calibration; figure computed",
        build=partial(magnetometer, INERTIAL[3:]),
        dimension=6,
    ),
)
