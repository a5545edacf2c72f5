"""The hidden directions in words: few terms, groups that move together, and no more claimed than is known."""

import re
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

import obsdesign as od
from obsdesign.analysis.sparse_directions import spanning_directions

LANDMARKS = 10
NAMES = ("x", "y", "heading", *(f"{axis}{i}" for i in range(1, LANDMARKS + 1) for axis in ("landmark_x", "landmark_y")))
FIRST, SECOND = ([NAMES[k], *NAMES[k + 3 :: 2]] for k in (0, 1))


def slam(*, ranges: bool, speed_known: bool) -> od.ControlAffineSystem:
    """A robot that steers among ten landmarks nobody has surveyed, all of them in the state."""
    state = ca.SX.sym("state", len(NAMES))
    away = [(state[3 + 2 * i] - state[0], state[4 + 2 * i] - state[1]) for i in range(LANDMARKS)]
    outputs = {f"bearing{i}": ca.atan2(north, east) - state[2] for i, (east, north) in enumerate(away)}
    if ranges:
        outputs |= {f"range{i}": ca.sqrt(east**2 + north**2) for i, (east, north) in enumerate(away)}
    still = ca.SX.zeros(len(NAMES) - 3)
    forward, turn = ca.vertcat(ca.cos(state[2]), ca.sin(state[2]), 0, still), ca.vertcat(0, 0, 1, still)
    known, unknown = {"turn": turn}, {"speed": forward}
    return od.ControlAffineSystem(
        state, NAMES, known=known | unknown if speed_known else known, unknown={} if speed_known else unknown, outputs=outputs
    )


def listed(sentence: str, before: str, after: str) -> list[str]:
    start = sentence.index(before) + len(before)
    return sentence[start : sentence.index(after, start)].split(", ")


def test_a_map_without_a_frame_is_hidden_by_shifts_rotation_and_scale():
    # bearings know neither where the map is, nor how it is turned, nor, at unknown speed, how large it is: 19 of 23
    found = od.observability(slam(ranges=False, speed_known=False))
    assert (found.dimension, found.decided) == (19, True)
    first, second, third, fourth = found.hidden.split("; ")
    assert listed(first, "a common shift of ", ":") == FIRST
    assert listed(second, "a common shift of ", ":") == SECOND
    assert listed(third, "rotation of everything about the origin: ", " turn together") == list(NAMES)
    assert listed(fourth, "scale of everything about the origin: ", " grow together") == [name for name in NAMES if name != "heading"]


@pytest.mark.parametrize("at", [None, np.linspace(-3, 5, len(NAMES)) ** 3 % 7.3, [0, 0, 0.5, *np.arange(20) ** 2 % 11.5]])
def test_ranges_and_a_known_speed_take_the_scale_away(at):
    found = od.observability(slam(ranges=True, speed_known=True), at=at)
    assert (found.dimension, found.decided) == (20, True)
    kinds = [sentence.split(" of ")[0] for sentence in found.hidden.split("; ")]
    assert kinds == ["a common shift", "a common shift", "rotation"]


def test_points_in_space_are_hidden_by_three_shifts_three_rotations_and_a_scale():
    # ratios of the distances between four points: similarities of space, 7 of them, move no output: 5 of 12
    state = ca.SX.sym("state", 12)
    points = [state[3 * i : 3 * i + 3] for i in range(4)]
    lengths = [ca.norm_2(points[i] - points[j]) for i in range(4) for j in range(i)]
    names = tuple(f"{axis}{i}" for i in range(4) for axis in "xyz")
    outputs = {f"ratio{k}": length / lengths[0] for k, length in enumerate(lengths[1:])}
    found = od.observability(od.ControlAffineSystem(state, names, outputs=outputs))
    assert (found.dimension, found.decided) == (5, True)
    kinds = [sentence.split(" of ")[0] for sentence in found.hidden.split("; ")]
    assert sorted(kinds) == ["a common shift"] * 3 + ["rotation"] * 3 + ["scale"]


def test_one_beacon_and_an_unknown_speed_hide_rotation_and_scale_about_it():
    # a bearing alone, speed a state: all may be farther away and faster
    state = ca.SX.sym("state", 4)
    system = od.System(od.Dubins(speed=10.0), (od.Bearing((30.0, 40.0), sigma=0.1),))
    assert od.observability(system).hidden.startswith("rotation of everything about the beacon at (30, 40) m: x, y, heading turn together")
    rate = ca.vertcat(state[3] * ca.cos(state[2]), state[3] * ca.sin(state[2]), 0, 0)
    turn = ca.SX([0, 0, 1, 0])
    bearing = ca.atan2(-state[1], -state[0]) - state[2]
    general = od.ControlAffineSystem(state, ("x", "y", "heading", "speed"), rate, {"turn": turn}, outputs={"bearing": bearing})
    for at in (None, [3, 4, 1, 2], [0, -4, 1, 2]):
        assert od.observability(general, at=at).hidden == (
            "rotation of everything about the origin: x, y, heading turn together; "
            "scale of everything about the origin: x, y, speed grow together in proportion"
        )


def test_at_a_singular_point_nothing_is_hidden_but_to_first_order():
    # r^2 = x^2 + y^2, x' = -1: r^2 and its rate tell x and y^2; at (3, 0) y shows in neither to first order, but it does change r^2
    state = ca.SX.sym("state", 2)
    system = od.ControlAffineSystem(state, ("x", "y"), drift=ca.SX([-1, 0]), outputs={"square": state[0] ** 2 + state[1] ** 2})
    found = od.observability(system, at=[3, 0])
    assert (found.dimension, found.decided) == (1, True)
    assert found.generic is not None
    assert found.generic.dimension == 2
    assert found.hidden == "y is not seen at all (to first order, at x = 3, y = 0)"
    assert od.observability(system, at=[3, 1]).hidden == "nothing is hidden"


def test_what_is_hidden_around_a_point_too_is_hidden_altogether():
    state = ca.SX.sym("state", 2)
    system = od.ControlAffineSystem(state, ("x", "y"), drift=ca.SX([-1, 0]), outputs={"square": state[0] ** 2})
    assert od.observability(system, at=[3, 0]).hidden == od.observability(system).hidden == "y is not seen at all"


def test_proportions_are_given_where_they_hold_alone():
    # x + y^3 is left unchanged by (3 y^2, -1), which is not affine: at (3, 1) known, at a state that nobody named no number
    state = ca.SX.sym("state", 2)
    system = od.ControlAffineSystem(state, ("x", "y"), outputs={"cubic": state[0] + state[1] ** 3})
    assert od.observability(system, at=[3, 1]).hidden == (
        "x cannot be told from y: +1 of x with -0.333 of y changes no output (to first order, at x = 3, y = 1)"
    )
    for seed in range(5):
        generic = od.observability(system, seed=seed).hidden
        assert generic.startswith("x cannot be told from y: ")
        assert not any(letter.isdigit() for letter in generic)
    parabola = od.ControlAffineSystem(state, ("x", "y"), outputs={"parabola": state[0] + state[1] ** 2})
    # along (-2 y, 1) x + y^2 changes by -2 y + 2 y: affine, so that it is told for all states
    assert (
        od.observability(parabola, at=[3, 1]).hidden
        == "x cannot be told from y: they change together along (-2 y, 1), and no output changes"
    )
    everywhere = od.ControlAffineSystem(state, ("x", "y"), outputs={"sum": state[0] + 4 * state[1]})
    assert od.observability(everywhere).hidden == "x cannot be told from y: +1 of x with -0.25 of y changes no output, only x + 4 y shows"


# ---------------------------------------------------------------- the basis itself


@pytest.mark.parametrize("seed", range(40))
def test_the_basis_spans_the_space_with_as_few_terms_as_it_was_made_of(seed):
    # a space made of vectors of 1 to 3 terms, mixed and with rows of very different size
    generator = np.random.default_rng(seed)
    n, d = int(generator.integers(4, 12)), int(generator.integers(1, 4))
    planted = np.zeros((n, d))
    for k in range(d):
        planted[generator.choice(n, int(generator.integers(1, 4)), replace=False), k] = generator.normal(size=1) + 3
        planted[:, k] *= generator.uniform(0.5, 2, n)
    if np.linalg.matrix_rank(planted) < d:
        return
    planted *= 10.0 ** generator.integers(-3, 4, n)[:, None]
    null_space = planted @ (generator.integers(-2, 3, (d, d)) + 7 * np.eye(d))
    found = spanning_directions(null_space)
    widths = np.maximum(np.abs(planted).max(axis=1, keepdims=True), 1e-300)
    vectors = np.array(found).T / widths
    vectors /= np.linalg.norm(vectors, axis=0)
    assert vectors.shape == (n, d)
    assert np.linalg.matrix_rank(vectors, tol=1e-9) == d
    assert np.linalg.matrix_rank(np.hstack([vectors, planted / widths]), tol=1e-9) == d
    assert sum(np.count_nonzero(vector) for vector in found) <= np.count_nonzero(planted)


# ---------------------------------------------------------------- sentences are true


def null_vectors(rows, columns):
    """A basis of the vectors that whole-number rows annihilate and that vanish but in the columns, by elimination of fractions."""
    matrix, pivots = [[Fraction(row[j]) for j in columns] for row in rows], []
    for j in range(len(columns)):
        i = next((i for i in range(len(pivots), len(matrix)) if matrix[i][j]), None)
        if i is None:
            continue
        k = len(pivots)
        matrix[k], matrix[i] = matrix[i], matrix[k]
        matrix[k] = [entry / matrix[k][j] for entry in matrix[k]]
        matrix = [row if i == k else [a - row[j] * b for a, b in zip(row, matrix[k], strict=True)] for i, row in enumerate(matrix)]
        pivots.append(j)
    free = [j for j in range(len(columns)) if j not in pivots]
    solved = [{pivot: -row[j] for pivot, row in zip(pivots, matrix, strict=False)} | {j: Fraction(1)} for j in free]
    return [[vector.get(j, Fraction(0)) for j in range(len(columns))] for vector in solved]


def stated(sentence, names):
    """The states that a sentence says change together, and by how much, where it says so."""
    if " not seen at all" in sentence:
        return [], {}
    if sentence.startswith("a common shift of "):
        moved = listed(sentence, "a common shift of ", ":")
        return moved, dict.fromkeys(moved, 1.0)
    first, rest = sentence.split(" cannot be told from ")
    others, amounts = rest.split(": ")
    pairs = re.findall(r"([+-]\S+) of (\w+)", amounts)
    assert first in names
    return [first, *others.split(", ")], {name: float(value) for value, name in pairs}


def untrue(seed):
    """Sentences about constant states of sizes 1e-12 to 1e12 that fractions contradict: outputs are A diag(1 / size) x."""
    generator = np.random.default_rng(seed)
    n, m = int(generator.integers(3, 8)), int(generator.integers(1, 4))
    A = generator.integers(-3, 4, (m, n)) * (generator.random((m, n)) < 0.6)
    A[np.arange(m), generator.integers(0, n, m)] = 1
    sizes = [Fraction(10) ** int(k) for k in generator.integers(-12, 13, n)]
    rows = [[Fraction(int(entry)) / size for entry, size in zip(row, sizes, strict=True)] for row in A]
    x, names = ca.SX.sym("x", n), [f"s{i}" for i in range(n)]
    outputs = {f"y{i}": sum(float(entry) * x[j] for j, entry in enumerate(row)) for i, row in enumerate(rows)}
    found = od.observability(od.ControlAffineSystem(x, names, outputs=outputs))
    hidden = len(null_vectors(rows, range(n)))
    assert (found.dimension, found.decided) == (n - hidden, True)
    wrong, count = [], 0
    for sentence in found.hidden.split("; ") if hidden else ():
        if " not seen at all" in sentence:
            alone = re.split(r" (?:is|are) not", sentence)[0].split(", ")
            wrong += [sentence for name in alone if any(row[names.index(name)] for row in rows)]
            count += len(alone)
            continue
        moved, amounts = stated(sentence, names)
        vectors = null_vectors(rows, [names.index(name) for name in moved])
        ratios = [[float(entry / vector[0]) for entry in vector] for vector in vectors if vector[0]]
        right = len(vectors) == 1 and ratios and all(ratios[0])
        if amounts:  # without: proportions that are no short fractions
            right = right and [amounts[name] / amounts[moved[0]] for name in moved] == pytest.approx(ratios[0], rel=6e-3)
        wrong += [] if right else [sentence]
        count += 1
    return wrong or ([] if count == hidden else [found.hidden])


@pytest.mark.parametrize("first", [0, pytest.param(100, marks=pytest.mark.slow)])
def test_sentences_about_states_of_very_different_size_are_true(first):
    for seed in range(first, first + 60 if first == 0 else 1100):
        assert untrue(seed) == [], seed
