"""The systems of the papers that this project is built on, and small ones that show where shortcuts go wrong."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import chain, combinations

import casadi as ca

import obsdesign as od

from .case import Case, column, symbols

# ---------------------------------------------------------------- unicycle with one unknown input, polar state

_SIAM = "Martinelli 2015, SIAM CT15, section"


def polar_unicycle(output: str, known: Sequence[str]) -> od.ControlAffineSystem:
    """The unicycle at distance r and azimuth phi; v and omega known or not."""
    x, (r, phi, theta) = symbols("r", "phi", "theta")
    fields = {"v": column(ca.cos(theta - phi), ca.sin(theta - phi) / r, 0), "omega": column(0, 0, 1)}
    return od.ControlAffineSystem(
        state=x,
        names=("r", "phi", "theta"),
        known={name: field for name, field in fields.items() if name in known},
        unknown={name: field for name, field in fields.items() if name not in known},
        outputs={"y": {"range": r, "bearing": theta - phi, "azimuth": phi}[output]},
    )


_POLAR = {
    # output, known input -> section, dimension for any known inputs, for one smooth known input
    ("range", "omega"): ("4.1", 2, 1),
    ("range", "v"): ("4.2", 2, 2),
    ("bearing", "omega"): ("4.3", 1, 1),
    ("bearing", "v"): ("4.4", 2, 1),
    ("azimuth", "omega"): ("4.5", 2, 1),
    ("azimuth", "v"): ("4.6", 3, 2),
}


def _polar_cases() -> list[Case]:
    cases = []
    for (output, known), (section, any_inputs, smooth) in _POLAR.items():
        build = partial(polar_unicycle, output, (known,))
        cases.append(Case(f"polar unicycle {section}", f"{_SIAM} {section}", build, any_inputs))
        cases.append(Case(f"polar unicycle {section}, smooth input", "computed", build, smooth, known_inputs="smooth"))
    for output, known, unknown in (("range", 2, 1), ("bearing", 2, 1), ("azimuth", 3, 1)):
        cases.append(Case(f"polar unicycle, {output}, all known", f"{_SIAM} 4", partial(polar_unicycle, output, ("v", "omega")), known))
        cases.append(Case(f"polar unicycle, {output}, all unknown", "computed", partial(polar_unicycle, output, ()), unknown))
    return cases


# ---------------------------------------------------------------- stopping too early


def switched() -> od.ControlAffineSystem:
    """x1' = u, x2' = x1 w, y = x2: Omega_1 = Omega_0 and tau = 0, yet Omega_2 is larger."""
    x, (x1, x2) = symbols("x1", "x2")
    return od.ControlAffineSystem(state=x, names=("x1", "x2"), known={"u": column(1, 0)}, unknown={"w": column(0, x1)}, outputs={"y": x2})


def stalling() -> od.ControlAffineSystem:
    """Ranks 1, 1, 3."""
    x, (x0, x1, x2) = symbols("x0", "x1", "x2")
    known = {"u1": column(3, -3 * x1, 2 * x0), "u2": column(-2 * x2**2, 2, -x0 * x2)}
    unknown = {"w": column(-2 * x0**2, -3 * x0, 0)}
    return od.ControlAffineSystem(x, ("x0", "x1", "x2"), column(0, 0, 2 * x0 * x1), known, unknown, {"y": x1})


def late() -> od.ControlAffineSystem:
    """Ranks 1, 1, 1, 1, 1, 2, 3, 4, 5: more than n + 2 steps."""
    x, (y, rate, a, b, c) = symbols("y", "l", "a", "b", "c")
    known, unknown = {"u": column(0, 0, 0, 0, rate)}, {"w": column(rate, rate**2 * a, rate * b, rate * c, 0)}
    return od.ControlAffineSystem(state=x, names=("y", "l", "a", "b", "c"), known=known, unknown=unknown, outputs={"h": y})


def not_canonic() -> od.ControlAffineSystem:
    """M has rank 1 of 2, yet x3 = y2' / y1'."""
    x, (x1, x2, x3) = symbols("x1", "x2", "x3")
    unknown = {"w1": column(1, x3, 0), "w2": column(0, 0, 1)}
    return od.ControlAffineSystem(state=x, names=("x1", "x2", "x3"), unknown=unknown, outputs={"y1": x1, "y2": x2})


def half_canonic() -> od.ControlAffineSystem:
    """One more input can be reconstructed: x4 (d x2/dt - x5) is observable."""
    x, (x1, x2, x3, x4, x5) = symbols("x1", "x2", "x3", "x4", "x5")
    unknown = {"w1": column(0, 1, x4, 0, 0), "w2": column(0, 1, x4, x4, x5)}
    names = ("x1", "x2", "x3", "x4", "x5")
    return od.ControlAffineSystem(x, names, column(x3, x5, 0, 0, 0), {}, unknown, {"y1": x1, "y2": x2})


def folded() -> od.ControlAffineSystem:
    """A constant M^-1 = 1/3, folded into a double, would give 3."""
    x, (x0, x1, x2) = symbols("x0", "x1", "x2")
    drift = column(0, 2 * x0**2 - 2 * x2**2, -3)
    return od.ControlAffineSystem(x, ("x0", "x1", "x2"), drift, {}, {"w": column(1, 2, 0)}, {"y": x0 + x1 + 1})


def clock() -> od.ControlAffineSystem:
    """x' = 1, y = x^2: at 0 only the second derivative tells."""
    x, (x1,) = symbols("x")
    return od.ControlAffineSystem(state=x, names=("x",), drift=column(1), outputs={"y": x1**2})


# ---------------------------------------------------------------- vehicle in wind of known direction


def vehicle_in_wind(disturbed: bool) -> od.ControlAffineSystem:
    """A camera sees the origin; airspeed and turn rates in the body frame known; wind along z."""
    x, (_, _, _, qt, qx, qy, qz) = symbols("x", "y", "z", "qt", "qx", "qy", "qz")
    rotation = ca.vertcat(
        ca.horzcat(qt**2 + qx**2 - qy**2 - qz**2, 2 * qx * qy - 2 * qt * qz, 2 * qx * qz + 2 * qt * qy),
        ca.horzcat(2 * qt * qz + 2 * qx * qy, qt**2 - qx**2 + qy**2 - qz**2, 2 * qy * qz - 2 * qt * qx),
        ca.horzcat(2 * qx * qz - 2 * qt * qy, 2 * qt * qx + 2 * qy * qz, qt**2 - qx**2 - qy**2 + qz**2),
    )
    turns = {"omega_x": (-qx, qt, qz, -qy), "omega_y": (-qy, -qz, qt, qx), "omega_z": (-qz, qy, -qx, qt)}
    known = {name: column(0, 0, 0, *(entry / 2 for entry in rates)) for name, rates in turns.items()}
    known |= {name: ca.vertcat(rotation[:, i], ca.SX.zeros(4)) for i, name in enumerate(("v_x", "v_y", "v_z"))}
    feature = -rotation.T @ x[:3]
    return od.ControlAffineSystem(
        state=x,
        names=("x", "y", "z", "qt", "qx", "qy", "qz"),
        known=known,
        unknown={"w": column(0, 0, 1, 0, 0, 0, 0)} if disturbed else {},
        outputs={"h_u": feature[0] / feature[2], "h_v": feature[1] / feature[2], "h_const": ca.sumsqr(x[3:])},
    )


# ---------------------------------------------------------------- three landmarks


def three_landmarks(landmarks: Sequence[tuple[float, float]]) -> od.ControlAffineSystem:
    """Bearings of three landmarks from a vehicle whose velocities are unknown."""
    state, (x, z, theta) = symbols("x", "z", "theta")
    unknown = {
        "d_f": column(ca.cos(theta), ca.sin(theta), 0),
        "d_h": column(-ca.sin(theta), ca.cos(theta), 0),
        "d_omega": column(0, 0, 1),
    }
    outputs = {f"bearing_{i}": ca.atan2(b - z, a - x) - theta for i, (a, b) in enumerate(landmarks)}
    return od.ControlAffineSystem(state=state, names=("x", "z", "theta"), unknown=unknown, outputs=outputs)


CIRCLE = ((2.0, 0.0), (-2.0, 0.0), (0.0, -2.0))
"""Three points of the circle of radius 2 about the origin; so is the vehicle at (1.2, 1.6)."""


def _landmark_cases() -> list[Case]:
    build = partial(three_landmarks, CIRCLE)
    on = {
        "tangent, omega = v/2": ((-0.4, 0.3, 0.25), 5),
        "tangent, omega = -v/2": ((-0.4, 0.3, -0.25), 6),
        "tangent, omega = 0.3": ((-0.4, 0.3, 0.3), 6),
        "radial": ((0.3, 0.4, 0.3), 6),
        "turning on the spot": ((0.0, 0.0, 0.3), 5),
        "at rest": ((0.0, 0.0, 0.0), 4),
    }
    source = "Belo, Salaris and Bicchi 2010, section IV"
    cases = [
        Case("three landmarks", source, build, 6, disturbance=0),
        Case("three landmarks, off the circle", source, build, 6, at=(0.3, 0.4, 0.2, 0.5, 0.0, 0.1), disturbance=0),
    ]
    for name, (inputs, dimension) in on.items():
        at = (1.2, 1.6, 0.0, *inputs)
        cases.append(Case(f"three landmarks, on the circle, {name}", f"{source}; computed", build, dimension, at=at, disturbance=0))
    return cases


# ---------------------------------------------------------------- unicycle in constant wind

_BRACE = {
    "g": (5, 5, 4),
    "m": (1, 1, 1),
    "r": (4, 4, 3),
    "b": (4, 4, 3),
    "gm": (5, 5, 5),
    "gr": (5, 5, 4),
    "gb": (5, 5, 5),
    "mr": (5, 5, 4),
    "mb": (5, 5, 4),
    "rb": (4, 4, 4),
    "gmr": (5, 5, 5),
    "gmb": (5, 5, 5),
    "grb": (5, 5, 5),
    "mrb": (5, 5, 5),
    "gmrb": (5, 5, 5),
}


def wind_estimation(letters: str, unicycle: bool) -> od.ControlAffineSystem:
    """Unicycle or Dubins vehicle in constant wind; GPS, magnetometer, range, bearing."""
    state, (x, y, heading, wind_x, wind_y) = symbols("x", "y", "heading", "wind_x", "wind_y")
    forward, turn = column(ca.cos(heading), ca.sin(heading), 0, 0, 0), column(0, 0, 1, 0, 0)
    carried = column(wind_x, wind_y, 0, 0, 0)
    outputs = {
        "g": {"gps_x": x, "gps_y": y},
        "m": {"magnetometer": heading},
        "r": {"range": ca.hypot(x - 500, y - 200)},
        "b": {"bearing": ca.atan2(200 - y, 500 - x) - heading},
    }
    return od.ControlAffineSystem(
        state=state,
        names=("x", "y", "heading", "wind_x", "wind_y"),
        drift=carried if unicycle else carried + 20 * forward,
        known={"speed": forward, "turn_rate": turn} if unicycle else {"turn_rate": turn},
        outputs=dict(chain.from_iterable(outputs[letter].items() for letter in letters)),
    )


def _wind_cases() -> list[Case]:
    source = "Brace and Morgansen, Table I and section on observability"
    cases = []
    for letters in ("".join(subset) for size in range(1, 5) for subset in combinations("gmrb", size)):
        unicycle, turning, straight = _BRACE[letters]
        cases.append(Case(f"wind, {letters}, unicycle", source, partial(wind_estimation, letters, True), unicycle))
        cases.append(Case(f"wind, {letters}, turning", source, partial(wind_estimation, letters, False), turning))
        build = partial(wind_estimation, letters, False)
        cases.append(Case(f"wind, {letters}, straight", source, build, straight, held={"turn_rate": 0.0}))
    return cases


# ---------------------------------------------------------------- unknown is not polynomial

HIV_POINT = (600.0, 30.0, 100000.0, 36.0, 0.108, 1000.0, 0.5, 3.0)


def hiv(unknown: bool) -> od.ControlAffineSystem:
    """Uninfected and infected cells, virus; infection rate eta = 1 or unknown."""
    x, (TU, TI, V, lam, rho, N, delta, c) = symbols("TU", "TI", "V", "lam", "rho", "N", "del", "c")
    infection = 0 if unknown else TU * V
    drift = column(lam - rho * TU - infection, infection - delta * TI, N * delta * TI - c * V, 0, 0, 0, 0, 0)
    eta = {"eta": column(-TU * V, TU * V, 0, 0, 0, 0, 0, 0)} if unknown else {}
    return od.ControlAffineSystem(x, ("TU", "TI", "V", "lam", "rho", "N", "del", "c"), drift, {}, eta, {"virus": V, "cells": TU + TI})


def toggle_switch() -> od.ControlAffineSystem:
    """Two genes that repress each other, Hill exponents unknown; inducers with unknown rates."""
    names = ("x1", "x2", "W1", "W2", "k01", "k1", "n1", "k02", "k2", "n2")
    x, (x1, x2, W1, W2, k01, k1, n1, k02, k2, n2) = symbols(*names)
    drift = column(k01 + k1 / (1 + (x2 / (1 + W1)) ** n1) - x1, k02 + k2 / (1 + (x1 / (1 + W2)) ** n2) - x2, *[0] * 8)
    unknown = {"w1": column(0, 0, 1, *[0] * 7), "w2": column(0, 0, 0, 1, *[0] * 6)}
    return od.ControlAffineSystem(x, names, drift, {}, unknown, {"y1": x1, "y2": x2})


def _polynomial_cases() -> list[Case]:
    source = "Martinelli, arXiv 2211.13507; computed"
    told = ("V", "lam", "rho", "c")
    cases = [
        Case("HIV, arbitrary eta", source, partial(hiv, True), 7, told),
        Case("HIV, arbitrary eta, at the published values", source, partial(hiv, True), 7, told, at=HIV_POINT),
        Case("HIV, eta = 1", source, partial(hiv, False), 8),
        Case("HIV, eta = 1, at the published values", source, partial(hiv, False), 8, at=HIV_POINT),
        Case("toggle switch, arbitrary", source, toggle_switch, 4, ("x1", "x2")),
    ]
    cases += [Case(f"HIV, eta of degree {k}", source, partial(hiv, True), 9 + k, disturbance=k) for k in (0, 1, 2, 3, 5)]
    cases += [Case(f"toggle switch, degree {k}", source, toggle_switch, 12 + 2 * k, disturbance=k) for k in (0, 1)]
    return cases


_IROS = "Martinelli 2017, IROS, section III"
CASES = (
    *_polar_cases(),
    Case("switched", "computed", switched, 2),
    Case("stalling", "computed", stalling, 3),
    Case("late", "computed", late, 5),
    Case("not canonic", "computed", not_canonic, 3),
    Case("half canonic", "computed", half_canonic, 4, ("x1", "x2", "x3")),
    Case("folded", "computed", folded, 1),
    Case("clock", "computed", clock, 1),
    Case("clock at 0", "computed", clock, 1, at=(0.0,)),
    Case("vehicle in calm air", f"{_IROS}-B", partial(vehicle_in_wind, False), 4),
    Case("vehicle in wind", f"{_IROS}-C", partial(vehicle_in_wind, True), 6),
    *_landmark_cases(),
    *_wind_cases(),
    *_polynomial_cases(),
)
