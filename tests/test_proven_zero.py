"""Zero is what is proven zero: terms far below any precision, saturated functions, rank that is constant along the flow.

Right values follow from the construction: chains of derivatives solved for the states by hand, or a rational system of known dimension
of which the states, or the outputs, were changed by invertible functions.
"""

import random
import sys
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import casadi as ca
import flint
import pytest

import obsdesign as od
from obsdesign.analysis.evaluation_point import random_residues
from obsdesign.analysis.model_equations import equations_of
from obsdesign.analysis.modular_points import random_modular_point
from obsdesign.rank.taylor import FlowArguments


def column(entries):
    return ca.vertcat(*[ca.SX(entry) for entry in entries])


def affine(names, rates, outputs, known=(), unknown=(), *, state):
    """A system from expressions of `state`."""
    return od.ControlAffineSystem(
        state=state,
        names=tuple(names),
        drift=column(rates),
        known={f"u{i}": column(field) for i, field in enumerate(known)},
        unknown={f"w{i}": column(field) for i, field in enumerate(unknown)},
        outputs={f"y{i}": ca.SX(h) for i, h in enumerate(outputs)},
    )


def symbols(n):
    x = ca.SX.sym("x", n)
    return x, ca.vertsplit(x)


def found(verdict):
    return verdict.dimension, verdict.decided


def stirred_tank(activation):
    """C' = 1 - C - r, T' = 350 - T + H r - 2 T + 2 u, r = k0 exp(-activation / T) C, y = T.

    T' gives z = H k0 e(T) C; ln z differentiates to -1 + 1/C - k0 e(T) + (activation / T^2) T': so 1/C - k0 e(T) is known, its
    derivative is another equation for C and k0, and z then gives H: 4 of 4 for every activation but 0.
    """
    x, (C, T, k0, H) = symbols(4)
    r = k0 * ca.exp(-activation / T) * C
    return affine(("C", "T", "k0", "H"), [1 - C - r, 350 - T + H * r - 2 * T, 0, 0], [T], known=[[0, 2, 0, 0]], state=x)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("activation", [10, 75, 500, 8750, 1e6])
def test_rates_that_are_tiny_at_most_states_are_no_zeros(activation, seed):
    assert found(od.observability(stirred_tank(activation), seed=seed)) == (4, True)


@pytest.mark.parametrize("options", [{"known_inputs": "smooth"}, {"method": "jets"}, {"held": {"u0": 0.5}}])
def test_the_stirred_tank_however_it_is_asked_about(options):
    assert found(od.observability(stirred_tank(8750), **options)) == (4, True)


@pytest.mark.parametrize("at", [(0.5, 350, 7.2e10, 209), (0.5, 5, 7.2e10, 209)])
def test_the_stirred_tank_at_a_point(at):
    """At 5 K the rate is 1e-750, and pivots are its square: seen with precision enough."""
    assert found(od.observability(stirred_tank(8750), at=at)) == (4, True)


def test_where_no_precision_is_enough_nothing_is_claimed():
    """At 0.01 K the rate is exp(-875000) = 1e-380008."""
    verdict = od.observability(stirred_tank(8750), at=(0.5, 0.01, 7.2e10, 209))
    assert (verdict.dimension < 4 and not verdict.decided) or found(verdict) == (4, True)


SATURATED = {
    "tanh": lambda a: ca.tanh(1000 * a),
    "erf": lambda a: ca.erf(300 * a),
    "logistic": lambda a: 1 / (1 + ca.exp(-2000 * a)),
    "gaussian": lambda a: ca.exp(-1000 * a**2),
    "power": lambda a: ca.fabs(a) ** 900,
    "arrhenius": lambda a: ca.exp(-5000 / a),
}


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("at", [None, (0.75, 1.0)])
@pytest.mark.parametrize("name", SATURATED)
def test_functions_that_fade_are_not_constant(name, at, seed):
    """y = f(a) + b, a' = 1, b' = 0: y' = f'(a) gives a where f'' is not 0, and y then b: 2 of 2."""
    x, (a, b) = symbols(2)
    assert found(od.observability(affine("ab", [1, 0], [SATURATED[name](a) + b], state=x), at, seed=seed)) == (2, True)


@pytest.mark.parametrize("name", SATURATED)
def test_what_is_hidden_behind_a_function_that_fades_stays_hidden(name):
    """y = f(a) + b with a' = a, b' = 0, c' = c and z = a c': c is a multiple of a seen through a c alone: scaling c is hidden."""
    x, (a, b, c, d) = symbols(4)
    system = affine("abcd", [a, 0, c * d, 0], [SATURATED[name](a) + b], state=x)
    assert found(od.observability(system)) == (2, True)


def test_a_constant_below_every_double_is_no_zero():
    x, (a, b) = symbols(2)
    assert found(od.observability(affine("ab", [0, 0], [a, a + 1e-300 * b], state=x))) == (2, True)
    assert found(od.observability(affine("ab", [0, 0], [ca.exp(a), a + 1e-300 * b], state=x))) == (2, True)


def test_identities_among_functions_are_zeros():
    """By an identity every output is a function of s alone: 1 of 2."""
    x, (s, t) = symbols(2)
    for outputs in (
        [ca.exp(s), ca.exp(s + t) * ca.exp(-t) + s],
        [ca.sin(s), ca.sin(s + t) * ca.cos(t) - ca.cos(s + t) * ca.sin(t)],
        [s, ca.log(t**2 + 1) - ca.log((t**2 + 1) * ca.exp(s))],
        [s, ca.cosh(t) ** 2 - ca.sinh(t) ** 2 + ca.cos(2 * t) + 2 * ca.sin(t) ** 2],
        [s, ca.sin(ca.atan2(t, s + 2)) * ca.hypot(t, s + 2) - t],
        [s, ca.sqrt(t**2 + 1) * ca.sqrt(t**2 + 4) - ca.sqrt((t**2 + 1) * (t**2 + 4)) + s],
        [s, (t**2 + 1) ** (s + 1) / (t**2 + 1) ** s - t**2],
    ):
        assert found(od.observability(affine("st", [0, 0], outputs, state=x))) == (1, True), outputs


def test_irrational_constants_of_derivatives_stay_exact():
    """CasADi writes 4 / pi^(1/2) into second derivatives of erf: exact too. s' = -s, t' = s t, y = erf(s) + t: s and t, 2 of 2."""
    x, (s, t) = symbols(2)
    system = affine("st", [-s, s * t], [ca.erf(s) + t], known=[[0, ca.erf(t)]], state=x)
    assert found(od.observability(system)) == (2, True)
    gradient = ca.gradient(ca.gradient(ca.erf(s), s), s)
    assert found(od.observability(affine("st", [s, t], [gradient + t], state=x))) == (2, True)


# ---------------------------------------------------------------- along the flow


@pytest.mark.parametrize("power", [1, 2, 3, 16, 17, 40, 100, 300])
def test_rank_is_constant_along_the_flow(power):
    """S' = 1 + a S^p, y = S: at S = 0 only derivative p + 1 tells a, at any S that is reached y' does: 2."""
    x, (s, a) = symbols(2)
    assert found(od.observability(affine("Sa", [1 + a * s**power, 0], [s], state=x), at=[0, 1])) == (2, True)


@pytest.mark.parametrize("power", [20, 60])
def test_what_is_carried_back_names_what_is_hidden(power):
    """S' = 1 + a S^p, y = S, and d of which nothing tells: 2 of 3, d is hidden."""
    x, (s, a, d) = symbols(3)
    verdict = od.observability(affine("Sad", [1 + a * s**power, 0, -d], [s], state=x), at=[0, 1, 2])
    assert found(verdict) == (2, True)
    assert verdict.observable_states == ("S", "a")
    assert verdict.hidden == "d is not seen at all"


def test_pendulum_at_rest():
    """th' = om, om' = sin th - d om upright at rest: the linearised system has no d: th, om are seen. Nearby d is, too."""
    x, (th, om, d) = symbols(3)
    pendulum = affine(("th", "om", "d"), [om, ca.sin(th) - d * om, 0], [th], state=x)
    verdict = od.observability(pendulum, at=[0, 0, 0.3])
    assert found(verdict) == (2, True)
    assert verdict.unobservable_states == ("d",)
    assert verdict.generic is not None
    assert verdict.generic.dimension == 3


def test_a_state_that_no_input_moves_off_a_line_stays_on_it():
    """x' = v cos h, y' = v sin h, v' = u, h' = 0, r = |(x - 3, y)| with y = h = 0: along the line r gives x and v, and no more."""
    x, (px, py, h, v) = symbols(4)
    rates = [v * ca.cos(h), v * ca.sin(h), 0, 0]
    system = affine(("x", "y", "h", "v"), rates, [ca.sqrt((px - 3) ** 2 + py**2)], known=[[0, 0, 0, 1]], state=x)
    verdict = od.observability(system, at=[0, 0, 0, 1.5])
    assert found(verdict) == (2, True)
    assert verdict.observable_states == ("x", "v")


# ---------------------------------------------------------------- inputs that decide nothing


def test_a_known_input_that_touches_nothing_seen_is_no_obstacle():
    """w1 moves a, the only output, at will: y is any function, and tells a alone."""
    x, (a, b, c, d) = symbols(4)
    for field in ([0, 0, 0, 1], [0, 0, 0, 0], [0, 0, 0, b * d]):
        system = affine("abcd", [0, 0, -b * c, 0], [a], known=[field], unknown=[[1, 0, 0, 0], [c, b, 0, 0]], state=x)
        assert found(od.observability(system)) == (1, True)
        for at in ([0.3, 0.7, 1.1, 0.2], [1, 0, 2, 3], [0, 0, 0, 0]):  # a = int w1 + c w2 is any function from every state
            assert found(od.observability(system, at)) == (1, True)


def padded(rates, outputs, known, unknown, state, generator):
    """The system with states behind it of which nothing is seen, and known inputs that move those alone."""
    n, extra = state.numel(), generator.randint(1, 2)
    more = ca.SX.sym("more", extra)
    every = ca.vertcat(state, more)

    def tail():
        return [generator.randint(-2, 2) * every[generator.randrange(n + extra)] ** generator.randint(0, 2) for _ in range(extra)]

    def behind(field):
        return [*field, *tail()]

    idle = [[0] * n + tail() for _ in range(generator.randint(1, 2))]
    names = [f"x{i}" for i in range(n + extra)]
    return affine(names, behind(rates), outputs, [*map(behind, known), *idle], [behind(field) for field in unknown], state=every)


@pytest.mark.parametrize("seed", range(12))
def test_states_and_inputs_behind_the_system_change_nothing(seed):
    generator = random.Random(seed)
    x, entries = symbols(3)

    def random_term():
        return generator.randint(-2, 2) * generator.choice(entries) * generator.choice([*entries, 1])

    def random_field():
        return [random_term() for _ in range(3)]

    rates, outputs = random_field(), [entries[0]]
    known = [random_field()] if seed % 2 else []
    unknown = [random_field() for _ in range(1 + seed % 3 // 2)]
    plain = od.observability(affine("abc", rates, outputs, known, unknown, state=x))
    more = od.observability(padded(rates, outputs, known, unknown, x, generator))
    assert more.dimension == plain.dimension
    assert more.decided or not plain.decided


# ---------------------------------------------------------------- random systems of known dimension


CHANGES = (
    lambda z, k: ca.exp(z / k),
    lambda z, k: ca.log(z * z + k),
    lambda z, k: ca.tanh(k * z),
    lambda z, k: ca.sin(k * z) + 2 * k * z,
    lambda z, k: ca.atan(k * z),
    lambda z, k: ca.exp(-k / (z * z + 1)) + z,
    lambda z, k: ca.sqrt(z * z + k),
    lambda z, _: ca.erf(z),
)


def random_field(generator, entries):
    """A field of terms c s t, s and t states or 1."""
    terms = [*entries, ca.SX(1)]
    return [generator.randint(-3, 3) * generator.choice(terms) * generator.choice(terms) for _ in entries]


def disguised(generator, n):
    """A random rational system, and the same in other states (strictly triangular, with steep functions) and other outputs."""
    z, entries = symbols(n)
    rates, field = random_field(generator, entries), random_field(generator, entries)
    outputs = [generator.choice(entries) * generator.choice([*entries, 1])]
    plain = affine([f"z{i}" for i in range(n)], rates, outputs, [field] if generator.random() < 0.5 else [], state=z)
    x, others = symbols(n)
    back = []  # z_i = x_i + f(x_(i-1)): x_i = z_i - f(x_(i-1))
    for i, other in enumerate(others):
        shift = generator.choice(CHANGES)(others[i - 1], generator.choice([2, 8, 64, 1024])) if i and generator.random() < 0.7 else 0
        back.append(other + shift)
    z_of_x = ca.vertcat(*back)
    inverse = ca.solve(ca.jacobian(z_of_x, x), ca.SX.eye(n))

    def moved(expression):
        return ca.substitute(expression, z, z_of_x)

    change = generator.choice(CHANGES)
    k = generator.choice([2, 4, 32])  # powers of 2: CasADi rounds none of their products
    return plain, od.ControlAffineSystem(
        state=x,
        names=tuple(f"x{i}" for i in range(n)),
        drift=inverse @ moved(plain.drift),
        known={name: inverse @ moved(entry) for name, entry in plain.known.items()},
        outputs={name: change(moved(h), k) for name, h in plain.outputs.items()},
    )


def disagreement(seed):
    """What is wrong with the verdict on the disguised system of a seed, if it is decided."""
    generator = random.Random(seed)
    plain, other = disguised(generator, generator.randint(2, 4))
    right, verdict = od.observability(plain), od.observability(other, seed=seed)
    assert right.decided
    if verdict.decided:
        assert verdict.dimension == right.dimension, seed
    else:
        assert verdict.dimension <= right.dimension, seed
    return verdict.decided


def test_a_change_of_states_and_outputs_changes_no_dimension():
    decided = [disagreement(seed) for seed in range(30)]
    assert sum(decided) >= 29


@pytest.mark.slow
def test_a_change_of_states_and_outputs_changes_no_dimension_of_many():
    decided = [disagreement(seed) for seed in range(30, 1030)]
    assert sum(decided) >= 0.98 * len(decided)


# ---------------------------------------------------------------- threads


def verdicts_of_two_systems(k):
    """Verdicts whose precisions differ, as text."""
    at = None if k % 2 else (0.5, 5, 7.2e10, 209)
    first = od.observability(stirred_tank(8750), at=at, seed=k % 3)
    x, (a, b) = symbols(2)
    second = od.observability(affine("ab", [0, 0], [a + b, a + b + 1e-90 * b * ca.exp(a)], state=x), seed=k % 3)
    return first.proof, first.dimension, second.proof, second.dimension


def test_threads_do_not_change_a_verdict_nor_the_settings_of_the_process():
    before = flint.ctx.prec, flint.ctx.cap
    alone = [verdicts_of_two_systems(k) for k in range(6)]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            together = list(pool.map(verdicts_of_two_systems, list(range(6)) * 4))
    finally:
        sys.setswitchinterval(interval)
    assert together == alone * 4
    assert (flint.ctx.prec, flint.ctx.cap) == before


def test_settings_are_restored_after_an_error_and_do_not_matter():
    x, (a, b) = symbols(2)
    system = affine("ab", [1, 0], [ca.log(a) + b], state=x)
    right = od.observability(system)
    with flint.ctx.workprec(20):
        flint.ctx.cap = 3
        try:
            with pytest.raises(od.InputError, match="finite smooth value"):
                od.observability(system, at=[-1, 0])
            assert od.observability(system).proof == right.proof
            assert (flint.ctx.prec, flint.ctx.cap) == (20, 3)
        finally:
            flint.ctx.cap = 10


def test_fractions_of_a_place_are_exact():
    """Moved places are numbers of double precision: the point that a verdict names is the point that it is about."""
    verdict = od.observability(stirred_tank(8750), seed=1)
    again = od.observability(stirred_tank(8750), at=verdict.at)
    assert found(again) == (4, True)
    assert all(Fraction(float(value)) == Fraction(value) for value in verdict.at)


# ---------------------------------------------------------------- sensitivities, two ways


@pytest.mark.parametrize("seed", range(3))
def test_responses_to_inputs_are_the_sensitivities(seed):
    """By the state transition matrix and its inverse, and by the equations of the sensitivities: the same numbers modulo the prime."""
    generator = random.Random(seed)
    x, entries = symbols(4)
    fields = [[ca.sin(generator.choice(entries)) * generator.choice(entries) for _ in range(4)] for _ in range(4)]
    system = affine("abcd", fields[0], [entries[0], ca.exp(entries[1])], [fields[1]], fields[2:], state=x)
    equations = equations_of(system.model)
    place, orders = random_modular_point(equations, seed), 7
    number = place.arithmetic.number

    def inputs(count):
        return [[number(value) for value in random_residues(orders + 1, f"{count} {i}")] for i in range(count)]

    arguments = FlowArguments([number(value) for value in place.state], inputs(1), inputs(2), [number(value) for value in equations.values])
    first, second = (method(place.arithmetic, arguments, orders) for method in (equations.flow.sensitivities, equations.flow.responses))
    assert [each.tolist() for each in first] == [each.tolist() for each in second]
