"""Why a direction is hidden: symmetries that are planted are named, and what is named changes no output, however far one goes."""

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign as od
from obsdesign.analysis.symmetry import SymmetryKind

BEACON = (30.0, 40.0)
DUBINS = od.Dubins(speed=15.0, wind="constant")


def column(*entries):
    return ca.SX(ca.vertcat(*entries))


def outputs_along(system, x0, inputs, steps=40, dt=0.02):
    """Outputs of the system from x0 under inputs (steps, m + p) that are held over a step."""
    model = system.model
    rate = ca.Function("rate", [model.x, model.u, model.w], [model.drift + model.B @ model.u + model.G @ model.w])
    h = ca.Function("h", [model.x], [model.h])
    m, x, rows = model.u.numel(), np.array(x0, dtype=float), []
    for values in inputs[:steps]:
        u, w = values[:m], values[m:]
        rows.append(np.array(h(x)).ravel())
        k1 = np.array(rate(x, u, w)).ravel()
        k2 = np.array(rate(x + dt / 2 * k1, u, w)).ravel()
        k3 = np.array(rate(x + dt / 2 * k2, u, w)).ravel()
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + np.array(rate(x + dt * k3, u, w)).ravel())
    return np.array(rows)


def moved(symmetry, x, distance):
    """The state at the end of an affine field's flow: exp of the bordered matrix."""
    n = len(x)
    bordered = np.zeros((n + 1, n + 1))
    bordered[:n, :n], bordered[:n, n] = symmetry.A, symmetry.b
    return (expm(distance * bordered) @ [*x, 1.0])[:n]


def assert_changes_nothing(system, symmetry, x, inputs, distance=0.3):
    reference, others = outputs_along(system, x, inputs), outputs_along(system, moved(symmetry, x, distance), inputs)
    # some planted systems leave every bound within these steps
    is_bounded = np.cumprod((np.abs(reference) < 1e6 * (1 + np.abs(reference[0]))).all(axis=1)).astype(bool)
    assert np.allclose(others[is_bounded], reference[is_bounded], rtol=1e-6, atol=1e-6)


# ---------------------------------------------------------------- planted


def invariant_polynomial(generator, invariants):
    """A random polynomial of invariants."""
    weights = generator.integers(-2, 3, (2, len(invariants)))
    first, second = (sum(int(w) * value for w, value in zip(row, invariants, strict=True)) for row in weights)
    return first + first * second / 4 + invariants[int(generator.integers(len(invariants)))]


def planted_rotation(generator, x, angle):
    """Points of the plane that turn about a point, with an angle: rates that turn along, outputs that do not notice."""
    centre = generator.integers(-3, 4, 2)
    points = [x[2 * i : 2 * i + 2] - ca.DM(centre) for i in range(x.numel() // 2)]
    turned = [column(-p[1], p[0]) for p in points]
    heading = column(ca.cos(angle), ca.sin(angle))
    invariants = [p.T @ q for p in points for q in [*points, heading]] + [q.T @ heading for q in turned]
    rate = [
        0.1 * p + int(generator.integers(1, 3)) * q + heading * invariant_polynomial(generator, invariants) / 50
        for p, q in zip(points, turned, strict=True)
    ]
    field = np.zeros((x.numel() + 1, x.numel() + 2))
    for i in range(len(points)):
        field[2 * i, 2 * i + 1], field[2 * i + 1, 2 * i] = -1, 1
        field[2 * i, -1], field[2 * i + 1, -1] = centre[1], -centre[0]
    field[-1, -1] = 1
    return ca.vertcat(*rate, 0.3), invariants, field


def planted_powers(generator, x):
    """States that are multiplied by powers of one number: their rates are themselves times invariants."""
    powers = generator.choice([-2, -1, 1, 2, 3], x.numel())
    invariants = [x[i] ** int(powers[j]) / x[j] ** int(powers[i]) for i in range(x.numel()) for j in range(i)]
    rate = ca.vertcat(*(x[i] * (0.2 + 0.05 * invariants[int(generator.integers(len(invariants)))]) for i in range(x.numel())))
    return rate, invariants, np.hstack([np.diag(powers), np.zeros((x.numel(), 1))])


def planted_shift(generator, x):
    """States that are shifted along a vector: rates and outputs are functions of forms that vanish on it."""
    n = x.numel()
    vector = generator.choice([-3, -2, -1, 1, 2, 3], n)
    forms = [int(vector[j]) * x[i] - int(vector[i]) * x[j] for i in range(n) for j in range(i)]
    rate = ca.vertcat(*(ca.sin(0.1 * invariant_polynomial(generator, forms)) for _ in range(n)))
    return rate, forms, np.hstack([np.zeros((n, n)), vector[:, None]])


def planted(seed):
    """A system with one planted symmetry, its field [A b], under names that tell nothing."""
    generator = np.random.default_rng(seed)
    kind = ("rotation", "powers", "shift")[seed % 3]
    if kind == "rotation":
        n = 2 * int(generator.integers(1, 3))
        x, angle = ca.SX.sym("x", n), ca.SX.sym("angle")
        rate, invariants, field = planted_rotation(generator, x, angle)
        state = ca.vertcat(x, angle)
    else:
        state = ca.SX.sym("x", int(generator.integers(2, 5)))
        rate, invariants, field = (planted_powers if kind == "powers" else planted_shift)(generator, state)
    order = generator.permutation(state.numel())
    rows = [int(i) for i in order]
    names = tuple(f"s{k}" for k in range(len(rows)))
    outputs = {f"y{k}": value for k in range(3) if not (value := ca.SX(invariant_polynomial(generator, invariants))).is_zero()}
    system = od.ControlAffineSystem(state[rows], names, rate[rows], outputs=outputs)
    return system, np.hstack([field[:, :-1][np.ix_(rows, rows)], field[rows, -1:]])


def check_planted(seed):
    system, field = planted(seed)
    verdict = od.observability(system, seed=seed)
    n = field.shape[0]
    assert verdict.dimension < n
    assert len(verdict.symmetries) == n - verdict.dimension
    rows = np.array([symmetry.vector for symmetry in verdict.symmetries])
    vector = field[:, :-1] @ verdict.at + field[:, -1]
    assert np.linalg.norm(vector - np.linalg.lstsq(rows.T, vector, rcond=None)[0] @ rows) < 1e-9 * np.linalg.norm(vector)
    assert "to first order" not in verdict.hidden
    for symmetry in verdict.symmetries:
        if symmetry.A is not None:
            assert_changes_nothing(system, symmetry, verdict.at, np.zeros((40, 0)), 0.1)


@pytest.mark.parametrize("seed", range(9))
def test_a_planted_symmetry_is_named(seed):
    check_planted(seed)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(9, 609, 100))
def test_planted_symmetries_are_named(first):
    for seed in range(first, first + 100):
        check_planted(seed)


# ---------------------------------------------------------------- what they are


def test_one_beacon_hides_a_rotation_about_it_whatever_the_names():
    # Brace and Morgansen, states under other names: the field is (-(p2 - b2), p1 - b1, 1, -c2, c1)
    state = ca.SX.sym("state", 5)
    a, b, c, d, e = ca.vertsplit(state)
    drift = column(d + 15 * ca.cos(c), e + 15 * ca.sin(c), 0, 0, 0)
    distance = ca.sqrt((a - BEACON[0]) ** 2 + (b - BEACON[1]) ** 2)
    system = od.ControlAffineSystem(state, tuple("abcde"), drift, {"u": column(0, 0, 1, 0, 0)}, outputs={"distance": distance})
    verdict = od.observability(system, at=[1, 2, 0.3, 4, 5])
    (symmetry,) = verdict.symmetries
    assert (symmetry.kind, symmetry.states) == (SymmetryKind.ROTATION, tuple("abcde"))
    assert np.allclose(symmetry.vector / symmetry.vector[2], [38, -29, 1, -5, 4])
    inputs = np.random.default_rng(0).normal(size=(40, 1))
    assert_changes_nothing(system, symmetry, verdict.at, inputs)


@pytest.mark.parametrize(("unit", "output"), [("rad", "z - atan2(y, x)"), ("m", "z/pitch - atan2(y, x)")])
def test_a_length_that_changes_with_a_rotation_makes_it_a_screw(unit, output):
    # a change of the direction atan2(y, x) by s, and of z by s (pitch s): moves neither the distance nor the second output
    rest = {"x": "0*x/T", "y": "0*y/T", "z": "0*z/T"}
    states, parameters = {"x": "m", "y": "m", "z": unit}, {"pitch": "2 m", "T": "1 s"}
    text = {"states": states, "parameters": parameters, "rates": rest, "outputs": {"square": "x^2 + y^2", "phase": output}}
    (symmetry,) = od.observability(od.system_from_text(text), at=[3.0, 4.0, 0.5]).symmetries
    assert symmetry.kind is (SymmetryKind.ROTATION if unit == "rad" else SymmetryKind.LINEAR)
    assert np.allclose(symmetry.vector / symmetry.vector[0] * -4, [-4, 3, 1 if unit == "rad" else 2])


def test_irrational_landmarks_are_turned_about():
    # Belo's landmark (-1, sqrt 3): the centre is no short fraction, but it is the place of a landmark
    beacon = (-1.0, float(np.sqrt(3)))
    verdict = od.observability(od.System(DUBINS, (od.Range(beacon=beacon, sigma=1.0),)))
    (symmetry,) = verdict.symmetries
    assert symmetry.kind is SymmetryKind.ROTATION
    assert symmetry.centre == pytest.approx(beacon)
    assert verdict.hidden == "rotation of everything about the beacon at (-1, 1.73205) m: x, y, heading, wind_x, wind_y turn together"


def test_the_yaw_about_a_wind_of_unknown_strength():
    # Martinelli, IROS 2017, section III: (-y, x, 0, -q_z/2, -q_y/2, q_x/2, q_t/2) with states (x, y, z, q_t, q_x, q_y, q_z)
    state = ca.SX.sym("state", 7)
    x, y, z, t, i, j, k = ca.vertsplit(state)
    q = column(t, i, j, k)
    air = {"v": column(t**2 + i**2 - j**2 - k**2, 2 * (t * k + i * j), 2 * (i * k - t * j), 0, 0, 0, 0)}
    turns = {"roll": (-i, t, k, -j), "pitch": (-j, -k, t, i), "yaw": (-k, j, -i, t)}
    known = air | {name: ca.vertcat(0, 0, 0, 0.5 * column(*rate)) for name, rate in turns.items()}
    rotation = column(
        (t**2 + i**2 - j**2 - k**2) * x + 2 * (i * j + t * k) * y + 2 * (i * k - t * j) * z,
        2 * (i * j - t * k) * x + (t**2 - i**2 + j**2 - k**2) * y + 2 * (j * k + t * i) * z,
        2 * (i * k + t * j) * x + 2 * (j * k - t * i) * y + (t**2 - i**2 - j**2 + k**2) * z,
    )
    outputs = {"image_u": rotation[0] / rotation[2], "image_v": rotation[1] / rotation[2], "norm": q.T @ q}
    wind = {"wind": column(0, 0, 1, 0, 0, 0, 0)}
    system = od.ControlAffineSystem(state, (*"xyz", "qt", "qx", "qy", "qz"), known=known, unknown=wind, outputs=outputs)
    verdict = od.observability(system, at=[0.5, 0.7, 0.4, 0.9, 0.1, -0.3, 0.2])
    assert verdict.dimension == 6
    (symmetry,) = verdict.symmetries
    assert symmetry.kind is SymmetryKind.ROTATION
    assert np.allclose(symmetry.vector / symmetry.vector[1] * 0.5, [-0.7, 0.5, 0, -0.1, 0.15, 0.05, 0.45])


@pytest.mark.parametrize(
    ("outputs", "kind", "words"),
    [
        (lambda a, b: a + b, SymmetryKind.SUM, "only a + b shows"),
        (lambda a, b: (a - 2 * b) ** 3, SymmetryKind.SUM, "only a - 2 b shows"),
        (lambda a, b: ca.exp(a * b), SymmetryKind.PRODUCT, "only a * b shows"),
        (lambda a, b: a / b, SymmetryKind.PRODUCT, "only a / b shows"),
        (lambda a, b: a * b**2, SymmetryKind.PRODUCT, "only a * b^2 shows"),
    ],
)
def test_two_constants_that_occur_together(outputs, kind, words):
    state = ca.SX.sym("state", 2)
    verdict = od.observability(od.ControlAffineSystem(state, ("a", "b"), outputs={"y": outputs(*ca.vertsplit(state))}))
    assert [symmetry.kind for symmetry in verdict.symmetries] == [kind]
    assert verdict.hidden.endswith(words)


def test_a_straight_flight_with_gps_hides_the_heading_behind_the_wind():
    # TRUTHS E: the null vector is (0, 0, 1, v sin theta, -v cos theta)
    system = od.System(DUBINS, (od.GPS(sigma=2.0),))
    verdict = od.observability(system, at=[1, 2, 0.5, 3, -1], held={"turn_rate": 0.0})
    (symmetry,) = verdict.symmetries
    assert symmetry.kind is SymmetryKind.FORCING
    assert np.allclose(symmetry.vector, [0, 0, 1, 15 * np.sin(0.5), -15 * np.cos(0.5)])
    turning = od.observability(system, at=[1, 2, 0.5, 3, -1])
    assert turning.symmetries == ()


def test_what_only_an_energy_shows_moves_on_along_the_motion():
    # a Duffing oscillator: q' = p, p' = -q^3, only the energy is measured, which does not change
    state = ca.SX.sym("state", 2)
    energy = state[1] ** 2 / 2 + state[0] ** 4 / 4
    system = od.ControlAffineSystem(state, ("q", "p"), column(state[1], -(state[0] ** 3)), outputs={"energy": energy})
    verdict = od.observability(system, at=[1, 2])
    (symmetry,) = verdict.symmetries
    assert (symmetry.kind, symmetry.motion) == (SymmetryKind.MOTION, "drift")
    assert np.allclose(symmetry.vector, [2, -1])


def test_a_singular_point_has_no_symmetry():
    # y = x^2 at 0: hidden to first order, by no symmetry
    state = ca.SX.sym("state", 1)
    verdict = od.observability(od.ControlAffineSystem(state, ("x",), outputs={"square": state**2}), at=[0.0])
    assert (verdict.dimension, verdict.symmetries) == (0, ())


def test_at_a_turned_heading_symmetries_are_those_of_all_states():
    # headings at multiples of pi / 12 are taken apart in exact arithmetic: the fields are those of the state as it was given
    system = od.System(DUBINS, (od.Bearing(beacon=BEACON, sigma=0.1),))
    at = np.array([1.0, 2.0, 3 * np.pi / 4, 4.0, 5.0])
    (symmetry,) = od.observability(system, at=at).symmetries
    assert np.allclose(symmetry.vector / symmetry.vector[2], [38, -29, 1, -5, 4])


def test_a_map_from_sample_to_sample_has_symmetries_too():
    # x+ = x + g u, y = x: only the sum or the product of states shows, as in continuous time
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    step = column(x[0] + x[1] * x[2] * u, x[1], x[2])
    verdict = od.observability(od.DiscreteSystem(x, ("x", "g", "k"), next_state=step, period=1.0, inputs={"u": u}, outputs={"y": x[0]}))
    assert verdict.hidden == "g cannot be told from k: g times k with k times k^(-1) changes no output, only g * k shows"


def test_unknown_inputs_that_rates_do_not_contain_linearly():
    # a heading w that nobody knows steers x and y: their common factor is the speed, of which nothing shows but with the range
    x, w = ca.SX.sym("x", 4), ca.SX.sym("w")
    rates = column(x[2] * x[3] * ca.cos(w), x[2] * x[3] * ca.sin(w), 0, 0)
    outputs = {"east": x[0], "north": x[1]}
    verdict = od.observability(od.GeneralSystem(x, ("x", "y", "a", "b"), rates=rates, unknown={"w": w}, outputs=outputs))
    assert (verdict.dimension, verdict.hidden) == (
        3,
        "a cannot be told from b: a times k with b times k^(-1) changes no output, only a * b shows",
    )


def test_what_is_known_at_the_start_does_not_change():
    # one beacon: without a heading at the start everything turns about it, with it nothing does
    system = od.System(DUBINS, (od.Range(beacon=BEACON, sigma=1.0),))
    assert [each.kind for each in od.observability(system).symmetries] == [SymmetryKind.ROTATION]
    verdict = od.observability(system, known_at_start=("heading",))
    assert (verdict.observable, verdict.symmetries) == (True, ())


# ---------------------------------------------------------------- what the words claim


def words_of(names, outputs):
    """What is hidden of constant states, outputs a function of their symbols."""
    states = [ca.SX.sym(name) for name in names]
    system = od.ControlAffineSystem(
        state=column(*states), names=tuple(names), drift=ca.SX.zeros(len(names)), known={}, unknown={}, outputs=outputs(*states)
    )
    return od.observability(system).hidden


def test_a_centre_that_is_not_the_origin_is_told_of_states_of_any_name():
    # (a - 1)^2 + (b - 2)^2 is turned about (1, 2); ratios of distances from (1, 2, 3) are scaled about it
    assert "rotation of everything about the point a = 1, b = 2:" in words_of("ab", lambda a, b: {"o": (a - 1) ** 2 + (b - 2) ** 2})
    ratios = words_of("abc", lambda a, b, c: {"o1": (a - 1) / (b - 2), "o2": (c - 3) / (b - 2)})
    assert "scale of everything about the point a = 1, b = 2, c = 3:" in ratios
    # one thing about (0, 0), the other about (5, 4), by the same angle: their scalar product stays
    both = words_of("xypq", lambda x, y, p, q: {"o1": x**2 + y**2, "o2": (p - 5) ** 2 + (q - 4) ** 2, "o3": x * (p - 5) + y * (q - 4)})
    assert "about the point x = 0, y = 0, p = 5, q = 4:" in both
    # p and q are measured: x and y are turned about them, not about the origin
    about_others = words_of("xypq", lambda x, y, p, q: {"o1": (x - p) ** 2 + (y - q) ** 2, "o2": p, "o3": q})
    assert about_others == "rotation of everything about the point x = p, y = q: x, y turn together"


def test_what_shows_of_long_proportions_is_told_exactly():
    # 1234 a + 4567 b = 1234 (a + 4567/1234 b), a fraction in lowest terms; a b^1001 is itself
    assert words_of("ab", lambda a, b: {"o": 1234 * a + 4567 * b}).endswith("only a + 4567/1234 b shows")
    assert words_of("ab", lambda a, b: {"o": a * b**1001}).endswith("only a * b^1001 shows")
