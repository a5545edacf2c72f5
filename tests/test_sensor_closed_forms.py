"""What each kind of sensor measures, and its derivatives, beside closed forms in 40 digits: scales of 1e-6 to 1e6, angles of many turns."""

from __future__ import annotations

import casadi as ca
import mpmath as mp
import numpy as np
import pytest

import obsdesign as od

KINDS = {
    "range": (od.Range, ("beacon", "height", "lever_arm")),
    "bearing": (od.Bearing, ("beacon", "height", "lever_arm", "mounting_angle")),
    "range_bearing": (od.RangeBearing, ("beacon", "height", "lever_arm", "mounting_angle")),
    "time_difference": (od.TimeDifference, ("beacon", "height", "lever_arm", "reference", "reference_height")),
    "doppler": (od.Doppler, ("beacon", "height", "lever_arm")),
    "velocity_log": (od.VelocityLog, ("mounting_angle",)),
    "speed_over_ground": (od.SpeedOverGround, ()),
    "course": (od.Course, ()),
    "airspeed": (od.Airspeed, ()),
}
ROLLING, DIVING = od.SecondOrderUnicycle(wind="constant"), od.Submersible(wind="constant")


def turned(angle, v):
    return mp.cos(angle) * v[0] - mp.sin(angle) * v[1], mp.sin(angle) * v[0] + mp.cos(angle) * v[1]


def to_beacon(p, s, dives, place="beacon", height="height"):
    """East, north, up or down, and the lever arm."""
    arm = turned(s[2], p["lever_arm"])
    return p[place][0] - s[0] - arm[0], p[place][1] - s[1] - arm[1], p[height] + (s[3] if dives else 0), arm


def closed_forms(kind, p, s, u, dives):
    """Outputs by hand; s: x, y, heading, speed or depth, wind; u: acceleration or speed, turn rate, dive rate."""
    speed = u[0] if dives else s[3]
    over_ground = speed * mp.cos(s[2]) + s[4], speed * mp.sin(s[2]) + s[5]
    if kind == "velocity_log":
        return turned(-s[2] - p["mounting_angle"], over_ground)
    if kind in ("speed_over_ground", "course", "airspeed"):
        return ({"speed_over_ground": mp.hypot(*over_ground), "course": mp.atan2(*over_ground[::-1]), "airspeed": abs(speed)}[kind],)
    east, north, up, arm = to_beacon(p, s, dives)
    r = mp.sqrt(east**2 + north**2 + up**2)
    if kind == "time_difference":
        return (r - mp.sqrt(sum(d**2 for d in to_beacon(p, s, dives, "reference", "reference_height")[:3])),)
    if kind == "doppler":
        v_east, v_north = over_ground[0] - u[1] * arm[1], over_ground[1] + u[1] * arm[0]
        return ((up * (u[2] if dives else 0) - east * v_east - north * v_north) / r,)
    bearing = () if kind == "range" else (mp.atan2(north, east) - s[2] - p["mounting_angle"],)
    return bearing if kind == "bearing" else (r, *bearing)


def drawn(random, fields, length):
    p = {"beacon": (0.0, 0.0)}
    for field in fields:
        if field in ("beacon", "reference", "lever_arm"):
            size = length * (10 ** random.uniform(-3, 0) if field == "lever_arm" else 1.0)
            p[field] = tuple((size * random.uniform(-1, 1, 2)).tolist())
        else:
            p[field] = float(random.choice([0.0, random.uniform(-7, 7) if field == "mounting_angle" else length * random.uniform(-1, 1)]))
    return {field: p[field] for field in fields}


def slopes(f, s, units):
    """Derivatives (6,) by central differences in 40 digits."""
    found = []
    for i, unit in enumerate(units):
        ahead, behind = list(s), list(s)
        ahead[i], behind[i] = s[i] + unit * mp.mpf("1e-13"), s[i] - unit * mp.mpf("1e-13")
        change = f(ahead) - f(behind)
        found.append(
            float((change - 2 * mp.pi * mp.nint(change / (2 * mp.pi)) if abs(change) > 3 else change) / (2 * unit * mp.mpf("1e-13")))
        )
    return np.array(found)


@pytest.mark.parametrize("dives", [False, True], ids=["rolls", "dives"])
@pytest.mark.parametrize("kind", KINDS)
@mp.workdps(40)
def test_values_and_derivatives_are_those_of_the_closed_form(kind, dives):
    random, (make, fields) = np.random.default_rng(17), KINDS[kind]
    for _ in range(6):
        length, fast = float(10 ** random.uniform(-6, 6)), float(10 ** random.uniform(-3, 3))
        p = drawn(random, fields, length)
        errors = {"bearing_sigma": 1.0} if kind == "range_bearing" else {}
        system = od.System(DIVING if dives else ROLLING, (make(sigma=1.0, **p, **errors),))
        model = system.model
        s = np.array([*(length * random.uniform(-1, 1, 2)), random.uniform(-40, 40), 0.0, *(fast * random.uniform(-0.5, 0.5, 2))])
        s[3] = random.uniform(0.1, 1) * (length if dives else fast)
        u = np.array([fast * random.uniform(0.1, 1), *random.uniform(-2, 2, 2)])[: len(model.inputs)]
        assert model.input_names[:2] == (("speed", "turn_rate") if dives else ("acceleration", "turn_rate"))
        h, H = (np.array(value) for value in ca.Function("h", [model.x, model.u], [model.h, ca.jacobian(model.h, model.x)])(s, u))
        exact = {key: tuple(map(mp.mpf, value)) if isinstance(value, tuple) else mp.mpf(value) for key, value in p.items()}
        state, inputs = [mp.mpf(value) for value in s.tolist()], [mp.mpf(value) for value in u.tolist()]
        expected = closed_forms(kind, exact, state, inputs, dives)
        units = np.array([length, length, 1.0, length if dives else fast, fast, fast])
        for i, value in enumerate(expected):
            off = mp.mpf(float(h[i, 0])) - value
            if model.outputs[i].is_angle:
                assert abs(off - 2 * mp.pi * mp.nint(off / (2 * mp.pi))) < 1e-13
            else:
                assert abs(off) < 1e-13 * max(abs(value), length if "beacon" in p and kind != "doppler" else fast)
            J = slopes(lambda x, i=i: closed_forms(kind, exact, x, inputs, dives)[i], state, units.tolist()) * units  # noqa: B023
            np.testing.assert_allclose(H[i] * units, J, rtol=0, atol=1e-12 * max(np.abs(J).max(), fast if kind == "airspeed" else 0.0))
