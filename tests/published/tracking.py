"""Targets, orbits and wind."""

from __future__ import annotations

from functools import partial

import casadi as ca

import obsdesign as od

from .case import Case, column, symbols

# dyadic, as every constant here: CasADi folds constants in double precision, exact arithmetic would see the rounding
GRAVITY = 9.8125


def planar_target(outputs: tuple[str, ...], manoeuvre: bool, accelerating: bool = False) -> od.ControlAffineSystem:
    """Target relative to an observer whose acceleration is known; the target's is zero or unknown."""
    names = ("x", "y", "speed_x", "speed_y")
    state, (x, y, speed_x, speed_y) = symbols(*names)
    known = {"own_x": column(0, 0, -1, 0), "own_y": column(0, 0, 0, -1)} if manoeuvre else {}
    unknown = {"target_x": column(0, 0, 1, 0), "target_y": column(0, 0, 0, 1)} if accelerating else {}
    distance = ca.sqrt(x**2 + y**2)
    every = {"bearing": ca.atan2(y, x), "range": distance, "range_rate": (x * speed_x + y * speed_y) / distance}
    return od.ControlAffineSystem(
        state=state,
        names=names,
        drift=column(speed_x, speed_y, 0, 0),
        known=known,
        unknown=unknown,
        outputs={name: every[name] for name in outputs},
    )


def spatial_target(manoeuvre: bool) -> od.ControlAffineSystem:
    """Target at constant velocity, its azimuth and elevation seen."""
    names = ("x", "y", "z", "speed_x", "speed_y", "speed_z")
    state, (x, y, z, *speeds) = symbols(*names)
    unit = ca.SX.eye(6)
    known = {f"own_{axis}": -unit[:, 3 + k] for k, axis in enumerate("xyz")} if manoeuvre else {}
    outputs = {"azimuth": ca.atan2(y, x), "elevation": ca.atan2(z, ca.sqrt(x**2 + y**2))}
    return od.ControlAffineSystem(state=state, names=names, drift=column(*speeds, 0, 0, 0), known=known, outputs=outputs)


def doppler_target(outputs: tuple[str, ...]) -> od.ControlAffineSystem:
    """Source of an unknown constant frequency at constant velocity; received frequency and bearing, no manoeuvre."""
    names = ("x", "y", "speed_x", "speed_y", "source_frequency")
    state, (x, y, speed_x, speed_y, frequency) = symbols(*names)
    wave_speed = 16.0
    rate = (x * speed_x + y * speed_y) / ca.sqrt(x**2 + y**2)
    every = {"bearing": ca.atan2(y, x), "frequency": frequency * (1 - rate / wave_speed)}
    drift = column(speed_x, speed_y, 0, 0, 0)
    return od.ControlAffineSystem(state=state, names=names, drift=drift, outputs={name: every[name] for name in outputs})


def turning_target(outputs: tuple[str, ...], unknown_rate_change: bool = False) -> od.ControlAffineSystem:
    """Coordinated turn at an unknown turn rate, constant or driven by an unknown input, seen from the origin."""
    names = ("x", "y", "speed_x", "speed_y", "turn_rate")
    state, (x, y, speed_x, speed_y, turn_rate) = symbols(*names)
    every = {"east": x, "north": y, "bearing": ca.atan2(y, x), "range": ca.sqrt(x**2 + y**2)}
    return od.ControlAffineSystem(
        state=state,
        names=names,
        drift=column(speed_x, speed_y, -turn_rate * speed_y, turn_rate * speed_x, 0),
        unknown={"turn_change": column(0, 0, 0, 0, 1)} if unknown_rate_change else {},
        outputs={name: every[name] for name in outputs},
    )


def wheeled_target(outputs: tuple[str, ...]) -> od.ControlAffineSystem:
    """Wheeled target with unknown speed and turn rate, seen from the origin."""
    names = ("x", "y", "heading")
    state, (x, y, heading) = symbols(*names)
    every = {"bearing": ca.atan2(y, x), "range": ca.sqrt(x**2 + y**2)}
    return od.ControlAffineSystem(
        state=state,
        names=names,
        unknown={"speed": column(ca.cos(heading), ca.sin(heading), 0), "turn": column(0, 0, 1)},
        outputs={name: every[name] for name in outputs},
    )


def ballistic(outputs: tuple[str, ...], exponential: bool) -> od.ControlAffineSystem:
    """Falling body with an unknown drag coefficient, in air of constant or exponential density, seen from the origin."""
    names = ("x", "z", "speed_x", "speed_z", "drag")
    state, (x, z, speed_x, speed_z, drag) = symbols(*names)
    force = drag * ca.sqrt(speed_x**2 + speed_z**2) * (ca.exp(-z / 8) if exponential else 1)
    every = {"elevation": ca.atan2(z, x), "range": ca.sqrt(x**2 + z**2)}
    return od.ControlAffineSystem(
        state=state,
        names=names,
        drift=column(speed_x, speed_z, -force * speed_x, -force * speed_z - GRAVITY, 0),
        outputs={name: every[name] for name in outputs},
    )


def falling_body() -> od.ControlAffineSystem:
    """Vertically falling body with an unknown ballistic coefficient, the slant range seen from a radar beside its path."""
    names = ("altitude", "speed", "drag")
    state, (altitude, speed, drag) = symbols(*names)
    drift = column(-speed, -ca.exp(-altitude / 4) * speed**2 * drag, 0)
    return od.ControlAffineSystem(state=state, names=names, drift=drift, outputs={"slant_range": ca.sqrt(1 + (altitude - 2) ** 2)})


def relative_orbit(outputs: tuple[str, ...], known: tuple[str, ...] = (), unknown: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Clohessy-Wiltshire motion beside a circular orbit; x radial, y along the track, z across; thrusts known or unknown."""
    names = ("x", "y", "z", "speed_x", "speed_y", "speed_z")
    state, (x, y, z, speed_x, speed_y, speed_z) = symbols(*names)
    rate = 0.5
    drift = column(speed_x, speed_y, speed_z, 3 * rate**2 * x + 2 * rate * speed_y, -2 * rate * speed_x, -(rate**2) * z)
    unit = ca.SX.eye(6)
    fields = {f"thrust_{axis}": unit[:, 3 + k] for k, axis in enumerate("xyz")}
    every = {"azimuth": ca.atan2(y, x), "elevation": ca.atan2(z, ca.sqrt(x**2 + y**2)), "range": ca.sqrt(x**2 + y**2 + z**2)}
    return od.ControlAffineSystem(
        state=state,
        names=names,
        drift=drift,
        known={k: fields[k] for k in known},
        unknown={k: fields[k] for k in unknown},
        outputs={name: every[name] for name in outputs},
    )


def planar_orbit(outputs: tuple[str, ...], unknown_attraction: bool) -> od.ControlAffineSystem:
    """Two-body motion in its plane, seen from the attracting centre, whose strength is known or a state."""
    names = ("x", "y", "speed_x", "speed_y", *(("attraction",) if unknown_attraction else ()))
    state, (x, y, speed_x, speed_y, *attraction) = symbols(*names)
    strength = attraction[0] if attraction else ca.SX(1)
    distance = ca.sqrt(x**2 + y**2)
    drift = column(speed_x, speed_y, -strength * x / distance**3, -strength * y / distance**3, *([0] * len(attraction)))
    every = {"azimuth": ca.atan2(y, x), "range": distance}
    return od.ControlAffineSystem(state=state, names=names, drift=drift, outputs={name: every[name] for name in outputs})


def two_stations() -> od.ControlAffineSystem:
    """Target at constant velocity, its bearings seen from the origin and from (4, 0)."""
    names = ("x", "y", "speed_x", "speed_y")
    state, (x, y, speed_x, speed_y) = symbols(*names)
    outputs = {"bearing1": ca.atan2(y, x), "bearing2": ca.atan2(y, x - 4)}
    return od.ControlAffineSystem(state=state, names=names, drift=column(speed_x, speed_y, 0, 0), outputs=outputs)


def wind(outputs: tuple[str, ...], missing: tuple[str, ...] = ()) -> od.ControlAffineSystem:
    """Aeroplane in a constant horizontal wind, a pitot tube of unknown scale, GPS velocity; inputs acceleration and turn rate."""
    names = ("airspeed", "heading", "wind_x", "wind_y", "scale")
    state, (airspeed, heading, wind_x, wind_y, scale) = symbols(*names)
    fields = {"acceleration": column(1, 0, 0, 0, 0), "turn": column(0, 1, 0, 0, 0)}
    every = {
        "gps_x": airspeed * ca.cos(heading) + wind_x,
        "gps_y": airspeed * ca.sin(heading) + wind_y,
        "pitot": scale * airspeed,
        "compass": heading,
    }
    return od.ControlAffineSystem(
        state=state,
        names=names,
        known={k: v for k, v in fields.items() if k not in missing},
        unknown={k: fields[k] for k in missing},
        outputs={name: every[name] for name in outputs},
    )


CASES = (
    Case(
        name="bearing, no manoeuvre",
        source="Nardone & Aidala 1981, IEEE TAES 17(2): hidden: scale",
        build=partial(planar_target, ("bearing",), manoeuvre=False),
        dimension=3,
        observable_states=(),
    ),
    Case(
        name="bearing, known manoeuvre",
        source="Nardone & Aidala 1981, IEEE TAES 17(2): observable",
        build=partial(planar_target, ("bearing",), manoeuvre=True),
        dimension=4,
    ),
    Case(
        name="bearing, target accelerating constantly, no manoeuvre",
        source="Jauffret & Pillon 1996, IEEE TAES 32(4); augmented state of 6; hidden: scale",
        build=partial(planar_target, ("bearing",), manoeuvre=False, accelerating=True),
        dimension=5,
        disturbance=0,
    ),
    Case(
        name="bearing, unknown target acceleration, no manoeuvre",
        source="computed, relative degree 2",
        build=partial(planar_target, ("bearing",), manoeuvre=False, accelerating=True),
        dimension=2,
        observable_states=(),
    ),
    Case(
        name="bearing, unknown target acceleration, known manoeuvre",
        source="computed; the words along the known acceleration give bearing over range",
        build=partial(planar_target, ("bearing",), manoeuvre=True, accelerating=True),
        dimension=4,
    ),
    Case(
        name="range, no manoeuvre",
        source="Song 1999, IEEE J. Oceanic Eng. 24(3): hidden: rotation",
        build=partial(planar_target, ("range",), manoeuvre=False),
        dimension=3,
        observable_states=(),
    ),
    Case(
        name="range, known manoeuvre",
        source="Song 1999, IEEE J. Oceanic Eng. 24(3): observable",
        build=partial(planar_target, ("range",), manoeuvre=True),
        dimension=4,
    ),
    Case(
        name="bearing and range rate, unknown target acceleration",
        source="computed, relative degrees 2 and 1",
        build=partial(planar_target, ("bearing", "range_rate"), manoeuvre=False, accelerating=True),
        dimension=3,
        observable_states=(),
    ),
    Case(
        name="bearing and range, unknown target acceleration",
        source="computed: the position is seen",
        build=partial(planar_target, ("bearing", "range"), manoeuvre=False, accelerating=True),
        dimension=4,
    ),
    Case(
        name="bearing, target coming straight in",
        source="the bearing moves by y / x to first order while y = speed_y = 0, so only y and speed_y show",
        build=partial(planar_target, ("bearing",), manoeuvre=False),
        dimension=2,
        observable_states=("y", "speed_y"),
        at=(3.0, 0.0, -1.0, 0.0),
    ),
    Case(
        name="range, target coming straight in",
        source="the range moves by x to first order while y = speed_y = 0, so only x and speed_x show",
        build=partial(planar_target, ("range",), manoeuvre=False),
        dimension=2,
        observable_states=("x", "speed_x"),
        at=(3.0, 0.0, -1.0, 0.0),
    ),
    Case(
        name="range, target standing still",
        source="the squared range moves by 2 p dp + 2 t p dv while the velocity is zero",
        build=partial(planar_target, ("range",), manoeuvre=False),
        dimension=2,
        observable_states=(),
        at=(3.0, 4.0, 0.0, 0.0),
    ),
    Case(
        name="two stations, target on the base line",
        source="both bearings move by dy / distance while y = speed_y = 0, so only y and speed_y show",
        build=two_stations,
        dimension=2,
        observable_states=("y", "speed_y"),
        at=(1.0, 0.0, 2.0, 0.0),
    ),
    Case(
        name="two stations",
        source="computed: the position is seen",
        build=two_stations,
        dimension=4,
    ),
    Case(
        name="azimuth and elevation, no manoeuvre",
        source="Hammel & Aidala 1985, IEEE TAES 21(2): hidden: scale",
        build=partial(spatial_target, manoeuvre=False),
        dimension=5,
        observable_states=(),
    ),
    Case(
        name="bearing and frequency, no manoeuvre",
        source="Passerieux, Pillon, Blanc-Benon & Jauffret 1988, Asilomar: observable",
        build=partial(doppler_target, ("bearing", "frequency")),
        dimension=5,
    ),
    Case(
        name="frequency, no manoeuvre",
        source="computed; hidden: rotation",
        build=partial(doppler_target, ("frequency",)),
        dimension=4,
        observable_states=("source_frequency",),
    ),
    Case(
        name="coordinated turn: position",
        source="model of Bar-Shalom, Li & Kirubarajan 2001, chapter 11; figure computed",
        build=partial(turning_target, ("east", "north")),
        dimension=5,
    ),
    Case(
        name="coordinated turn: position, standing still",
        source="a target at rest stays there whatever its turn rate",
        build=partial(turning_target, ("east", "north")),
        dimension=4,
        observable_states=("x", "y", "speed_x", "speed_y"),
        at=(1.0, 2.0, 0.0, 0.0, 0.5),
    ),
    Case(
        name="coordinated turn: bearing",
        source="model of Bar-Shalom, Li & Kirubarajan 2001, chapter 11; figure computed; hidden: scale",
        build=partial(turning_target, ("bearing",)),
        dimension=4,
        observable_states=("turn_rate",),
    ),
    Case(
        name="coordinated turn: bearing, unknown change of the turn rate",
        source="model of Bar-Shalom, Li & Kirubarajan 2001, chapter 11; figure computed, relative degree 3",
        build=partial(turning_target, ("bearing",), unknown_rate_change=True),
        dimension=3,
        observable_states=(),
    ),
    Case(
        name="wheeled target: bearing, unknown inputs",
        source="computed, relative degree 1",
        build=partial(wheeled_target, ("bearing",)),
        dimension=1,
        observable_states=(),
    ),
    Case(
        name="wheeled target: bearing and range, unknown inputs",
        source="computed: the position is seen, a flat output",
        build=partial(wheeled_target, ("bearing", "range")),
        dimension=3,
    ),
    Case(
        name="ballistic target: elevation, unknown drag",
        source="after Farina, Ristic & Benvenuti 2002, IEEE TAES 38(3); figure computed; gravity gives the scale",
        build=partial(ballistic, ("elevation",), exponential=True),
        dimension=5,
    ),
    Case(
        name="ballistic target: range, unknown drag, constant density",
        source="computed",
        build=partial(ballistic, ("range",), exponential=False),
        dimension=5,
    ),
    Case(
        name="falling body: slant range, unknown drag",
        source="model of Athans, Wishner & Bertolini 1968, IEEE TAC 13(5); figure computed",
        build=falling_body,
        dimension=3,
    ),
    Case(
        name="relative orbit: angles",
        source="Woffinden & Geller 2009, IEEE TAES 45(3): hidden: scale",
        build=partial(relative_orbit, ("azimuth", "elevation")),
        dimension=5,
        observable_states=(),
    ),
    Case(
        name="relative orbit: angles, known thrust",
        source="Woffinden & Geller 2009, IEEE TAES 45(3): observable",
        build=partial(relative_orbit, ("azimuth", "elevation"), ("thrust_z",)),
        dimension=6,
    ),
    Case(
        name="relative orbit: angles, unknown thrust across",
        source="computed; hidden: scale, the thrust following",
        build=partial(relative_orbit, ("azimuth", "elevation"), (), ("thrust_z",)),
        dimension=5,
        observable_states=(),
    ),
    Case(
        name="relative orbit: angles, unknown thrust in all axes",
        source="computed, relative degrees 2 and 2: the angles and their rates",
        build=partial(relative_orbit, ("azimuth", "elevation"), (), ("thrust_x", "thrust_y", "thrust_z")),
        dimension=4,
        observable_states=(),
    ),
    Case(
        name="relative orbit: angles, constant thrust in the plane",
        source="computed; augmented state of 8; hidden: scale",
        build=partial(relative_orbit, ("azimuth", "elevation"), (), ("thrust_x", "thrust_y")),
        dimension=7,
        disturbance=0,
    ),
    Case(
        name="relative orbit: range",
        source="computed: observable to first order, mirror images apart",
        build=partial(relative_orbit, ("range",)),
        dimension=6,
    ),
    Case(
        name="relative orbit: range, unknown thrust along the track",
        source="computed, relative degree 2",
        build=partial(relative_orbit, ("range",), (), ("thrust_y",)),
        dimension=2,
        observable_states=(),
    ),
    Case(
        name="planar orbit: azimuth, unknown attraction",
        source="computed; hidden: scale, by Kepler's third law",
        build=partial(planar_orbit, ("azimuth",), unknown_attraction=True),
        dimension=4,
        observable_states=(),
    ),
    Case(
        name="planar orbit: azimuth",
        source="computed; the attraction gives the scale",
        build=partial(planar_orbit, ("azimuth",), unknown_attraction=False),
        dimension=4,
    ),
    Case(
        name="planar orbit: altitude, unknown attraction",
        source="computed; hidden: rotation",
        build=partial(planar_orbit, ("range",), unknown_attraction=True),
        dimension=4,
        observable_states=("attraction",),
    ),
    Case(
        name="wind: GPS and pitot, turn rate known",
        source="model of Cho, Kim, Lee & Kee 2011, IEEE TAES 47(1); figure computed",
        build=partial(wind, ("gps_x", "gps_y", "pitot"), ("acceleration",)),
        dimension=5,
    ),
    Case(
        name="wind: GPS and pitot, both inputs unknown",
        source="model of Cho, Kim, Lee & Kee 2011, IEEE TAES 47(1), who use these two sensors; figure computed",
        build=partial(wind, ("gps_x", "gps_y", "pitot"), ("acceleration", "turn")),
        dimension=5,
    ),
    Case(
        name="wind: GPS, both inputs unknown",
        source="computed, relative degrees 1 and 1",
        build=partial(wind, ("gps_x", "gps_y"), ("acceleration", "turn")),
        dimension=2,
        observable_states=(),
    ),
    Case(
        name="wind: GPS, turn rate unknown",
        source="computed; hidden: the pitot scale, which is not measured",
        build=partial(wind, ("gps_x", "gps_y"), ("turn",)),
        dimension=4,
        observable_states=("airspeed", "heading", "wind_x", "wind_y"),
    ),
)
