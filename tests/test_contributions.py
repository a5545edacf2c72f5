"""What a record of information tells: bounds, the end of the path, paths in a row, who says what; and what an empirical one is worth."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest
from by_hand import BEACON, SCALE, SENSORS, SLOW, START, STEP, Swinging, assert_close, correlated_prior, derivative, flown, part, stepped
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.information.contribution_shares import shortest_bulk
from obsdesign.information.perturbation_check import TOLERANCE

few = settings(deadline=None, max_examples=8, database=None, derandomize=True)

SWINGING = od.System(Swinging(), SENSORS)
DUBINS = od.System(od.Dubins(15.0, wind="constant"), SENSORS)
DUBINS_SLOW = od.System(od.Dubins(15.0, wind="constant"), SLOW)
EACH_SYSTEM = pytest.mark.parametrize("system", [SWINGING, DUBINS, DUBINS_SLOW], ids=["swinging", "dubins", "dubins, slow sensors"])


def along(system: od.System, seed: int = 3) -> od.Information:
    return od.variational_gramian(system, flown(system, seed=seed))


def straight_line() -> tuple[od.System, od.Information]:
    """GPS on a straight line to the east: heading and cross wind are hidden from each other."""
    system = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0), od.GPS(5.0)))
    return system, od.variational_gramian(system, od.simulate(system, np.zeros(5), np.zeros(24), STEP))


# ---------------------------------------------------------------- the bound, and the end of the path


@EACH_SYSTEM
def test_the_bound_of_a_record_is_the_root_of_the_diagonal_of_the_inverse(system: od.System):
    information = along(system)
    np.testing.assert_allclose(information.std, np.sqrt(np.diag(np.linalg.inv(information.total))), rtol=1e-7)


def test_what_is_hidden_has_no_bound():
    assert np.isinf(straight_line()[1].std).tolist() == [False, False, True, False, True]


def test_what_is_known_at_the_end_is_the_recursion_without_prior():
    """J+ = F^-T (J + C'R^-1 C) F^-1 from J = 0, each F by hand."""
    path = flown(SWINGING)
    local = od.sliding_information(SWINGING, path, 1).sum(axis=1)
    J = np.zeros((4, 4))
    for k in range(path.steps):
        back = np.linalg.inv(derivative(lambda x, k=k: stepped(x, path.u[k, 0], np.zeros(2), STEP), path.x[k]))
        J = back.T @ (J + local[k]) @ back
    assert_close(od.variational_gramian(SWINGING, path).final, J, 1e-9)


@EACH_SYSTEM
def test_what_is_known_at_the_end_is_what_samples_add_to_any_prior(system: od.System):
    """J_N = Phi^-T (P^-1 + W) Phi^-1, with Phi by central differences of the simulation."""
    path = flown(system)
    n, eps = path.x.shape[1], 1e-5
    ends = [[od.simulate(system, path.x[0] + side * eps * unit, path.u, STEP).x[-1] for side in (1, -1)] for unit in np.eye(n)]
    Phi = np.column_stack([(plus - minus) / (2 * eps) for plus, minus in ends])
    information, prior = od.variational_gramian(system, path), correlated_prior(n)
    np.testing.assert_allclose(information.transition, Phi, rtol=1e-6, atol=1e-6)
    J, back = od.posterior_information(system, path, prior)[-1], np.linalg.inv(information.transition)
    assert_close(information.final, J - back.T @ prior.information @ back, 1e-9, J)


@pytest.mark.parametrize("kind", ["variational, integral", "empirical", "empirical, integral", "one sensor"])
def test_every_record_of_a_path_knows_how_it_ends(kind: str):
    path = flown(SWINGING)
    expected = od.variational_gramian(SWINGING, path).transition
    found = {
        "variational, integral": lambda: od.variational_gramian(SWINGING, path, weighted=False),
        "empirical": lambda: od.empirical_gramian(SWINGING, path),
        "empirical, integral": lambda: od.empirical_gramian(SWINGING, path, weighted=False),
        "one sensor": lambda: od.variational_gramian(SWINGING, path).only("gps"),
    }[kind]()
    np.testing.assert_allclose(found.transition, expected, rtol=1e-12)


# ---------------------------------------------------------------- one path after the other


@EACH_SYSTEM
@pytest.mark.parametrize("cut", [8, 16])
def test_the_information_of_two_paths_in_a_row_is_that_of_the_whole(system: od.System, cut: int):
    """Where the cut falls on a sample of every sensor, as each path begins with one."""
    path = flown(system)
    whole, first, second = (od.variational_gramian(system, piece) for piece in (path, part(path, 0, cut), part(path, cut, path.steps)))
    joined = first.then(second)
    assert joined.names == whole.names
    assert_close(joined.blocks, whole.blocks, 1e-11, whole.total)
    np.testing.assert_allclose(joined.transition, whole.transition, rtol=1e-9, atol=1e-9)
    assert_close(joined.final, whole.final, 1e-7)


@few
@given(first=st.integers(1, 22), second=st.integers(1, 22))
def test_it_does_not_matter_which_two_of_three_paths_are_joined_first(first: int, second: int):
    a, b = sorted((first, second + (second >= first)))
    path = flown(SWINGING)
    one, two, three = (od.variational_gramian(SWINGING, part(path, *ends)) for ends in ((0, a), (a, b), (b, 24)))
    left, right = one.then(two).then(three), one.then(two.then(three))
    assert_close(left.blocks, right.blocks, 1e-11, right.total)
    assert_close(left.blocks, od.variational_gramian(SWINGING, path).blocks, 1e-11, right.total)


def test_of_a_record_without_an_end_nothing_can_follow():
    known = along(DUBINS)
    open_ended = od.Information(known.blocks, known.names)
    for what in (lambda: open_ended.final, lambda: open_ended.then(known)):
        with pytest.raises(od.InputError, match=r"the transition dx\(t_N\)/dx\(t_0\) is not known"):
            what()
    last = known.then(open_ended)
    assert last.transition is None
    np.testing.assert_array_equal(last.blocks, known.then(known).blocks)


def test_records_of_other_sensors_or_states_do_not_follow():
    known = along(DUBINS)
    for other in (known.only("gps"), along(SWINGING)):
        with pytest.raises(od.InputError, match="does not follow that of gps, magnetometer, range, bearing: another system"):
            known.then(other)


# ---------------------------------------------------------------- who says what


def by_weights(blocks: np.ndarray, value: object, k: int, s: int) -> float:
    """d log value / d weight of one block at weight 1, by central differences over four points."""
    W, eps = blocks.sum(axis=(0, 1)), 1e-3
    near, far = (np.log(value(W + reach * eps * blocks[k, s])) - np.log(value(W - reach * eps * blocks[k, s])) for reach in (1, 2))
    return float((8 * near - far) / (12 * eps))


@EACH_SYSTEM
@pytest.mark.parametrize("segments", [1, 3, None])
def test_shares_are_parts_of_what_is_known_of_each_state(system: od.System, segments: int | None):
    information = along(system)
    found = od.contributions(system, information, segments)
    count, n = segments or 24, len(system.model.states)
    assert found.shares.shape == (n, count, 4)
    assert (found.shares >= 0).all()
    np.testing.assert_allclose(found.shares.sum(axis=(1, 2)), 1.0, rtol=1e-9)
    inverse, blocks = np.linalg.inv(information.total), information.by_segment(count)
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(inverse)), rtol=1e-7)
    for i in range(n):
        v = inverse[i] / inverse[i, i]
        brought = np.einsum("i,ksij,j->ks", v, blocks, v)
        assert brought.sum() == pytest.approx(1 / inverse[i, i], rel=1e-7)
        np.testing.assert_allclose(found.shares[i] / found.std[i] ** 2, brought, rtol=1e-6, atol=1e-9 / inverse[i, i])


@EACH_SYSTEM
def test_a_share_is_how_fast_the_knowledge_of_a_state_grows_with_the_weight_of_the_block(system: od.System):
    information = along(system)
    found, blocks = od.contributions(system, information, 4), information.by_segment(4)
    for i in range(len(system.model.states)):
        for k, s in np.ndindex(4, 4):
            grown = by_weights(blocks, lambda W, i=i: 1 / np.linalg.inv(W)[i, i], k, s)
            assert found.shares[i, k, s] == pytest.approx(grown, abs=1e-6)


@EACH_SYSTEM
def test_a_share_of_the_weakest_direction_is_how_fast_the_smallest_eigenvalue_grows(system: od.System):
    information = along(system)
    n = len(system.model.states)
    found, blocks = od.contributions(system, information, 4, SCALE[:n]), information.by_segment(4)
    S = np.diag(SCALE[:n])
    values, vectors = np.linalg.eigh(S @ information.total @ S)
    assert found.weakest_value == pytest.approx(values[0], rel=1e-7)
    assert abs(found.weakest @ vectors[:, 0]) == pytest.approx(1.0, rel=1e-9)
    assert found.weakest_shares.sum() == pytest.approx(1.0, rel=1e-9)
    assert (found.weakest_shares >= 0).all()
    for k, s in np.ndindex(4, 4):
        grown = by_weights(blocks, lambda W: np.linalg.eigvalsh(S @ W @ S)[0], k, s)
        assert found.weakest_shares[k, s] == pytest.approx(grown, abs=1e-6)


def test_shares_of_longer_segments_are_sums_and_units_do_not_matter():
    information = along(DUBINS)
    each, grouped = (od.contributions(DUBINS, information, segments) for segments in (None, 4))
    np.testing.assert_allclose(each.shares.reshape(5, 4, 6, 4).sum(axis=2), grouped.shares, rtol=1e-7, atol=1e-12)
    D = np.array([1e3, 1e-3, 180 / np.pi, 3.6, 1.9])
    other = od.contributions(DUBINS, od.Information(information.blocks * np.outer(D, D), information.names), 4, SCALE)
    np.testing.assert_allclose(other.shares, grouped.shares, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(other.std * D, grouped.std, rtol=1e-7)


def test_only_visible_states_have_shares_and_theirs_are_as_if_the_hidden_were_known():
    """On the line W sees four directions; two GPS of 2 m and 5 m share what they see as 25 to 4, whatever the state."""
    system, information = straight_line()
    found = od.contributions(system, information, 4)
    hidden = np.array([False, False, True, False, True])
    assert np.isnan(found.shares[hidden]).all()
    assert found.std.tolist() == pytest.approx(information.std.tolist())
    np.testing.assert_allclose(found.shares[~hidden].sum(axis=(1, 2)), 1.0, rtol=1e-9)
    np.testing.assert_allclose(found.shares[~hidden].sum(axis=1), np.tile([25 / 29, 4 / 29], (3, 1)), rtol=1e-6)
    # the east: position and head wind from samples at k dt, two unknowns
    times = STEP * np.arange(24)
    rows = np.column_stack([np.ones(24), times])
    inverse = np.linalg.inv(rows.T @ rows)
    for state, column in ((0, 0), (3, 1)):
        v = inverse[column] / inverse[column, column]
        by_segment = ((rows @ v) ** 2).reshape(4, 6).sum(axis=1)
        np.testing.assert_allclose(found.shares[state].sum(axis=1), by_segment / by_segment.sum(), rtol=1e-6)


def test_of_a_direction_that_nobody_sees_nobody_has_a_share():
    system, information = straight_line()
    found = od.contributions(system, information, 4)
    assert found.weakest_value == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(found.weakest_shares).all()


@settings(few, max_examples=60)
@given(shares=st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=12))
def test_the_stretch_that_is_named_is_the_shortest_with_most_of_the_share_of_the_best_sensor(shares: list[tuple[int, int, int]]):
    counts = np.array(shares, dtype=float)
    if not counts.any():
        return
    sensor, first, last = shortest_bulk(counts / counts.sum())
    assert counts[:, sensor].sum() == counts.sum(axis=0).max()
    column, wanted = counts[:, sensor], 0.7 * counts[:, sensor].sum() - 1e-9
    enough = [
        (end - begin, begin) for begin in range(len(column)) for end in range(begin, len(column)) if column[begin : end + 1].sum() >= wanted
    ]
    assert last - first == min(enough)[0]
    assert column[first : last + 1].sum() >= wanted


@EACH_SYSTEM
def test_a_sentence_for_each_state_says_what_the_numbers_say(system: od.System):
    found = od.contributions(system, along(system), 6)
    assert len(found.sentences) == len(found.states)
    for i, (state, sentence) in enumerate(zip(found.states, found.sentences, strict=True)):
        said = re.fullmatch(rf"{state.name} is known to (\S+) {state.unit}; (\d+) % .* from (\w+) in segments? (\d)(?:-(\d))?", sentence)
        assert said, sentence
        bound, percent, sensor, first, last = said.groups()
        assert float(bound) == pytest.approx(found.std[i], rel=5e-3)
        column = found.shares[i, int(first) - 1 : int(last or first), found.sensors.index(sensor)]
        assert int(percent) == pytest.approx(100 * column.sum(), abs=0.5 + 1e-9)


def test_a_sentence_says_what_stays_hidden():
    system, information = straight_line()
    sentences = od.contributions(system, information, 2).sentences
    assert [sentences[2], sentences[4]] == ["heading stays hidden", "wind_y stays hidden"]


def test_bad_input_of_contributions_is_refused():
    information = along(DUBINS)
    with pytest.raises(od.InputError, match="segments is 5: must divide the number of steps, 24"):
        od.contributions(DUBINS, information, 5)
    with pytest.raises(od.InputError, match=r"is not of this system: 4 sensors, 4 states"):
        od.contributions(SWINGING, information)
    with pytest.raises(od.InputError, match=r"is not of this system: 4 sensors, 5 states"):
        od.contributions(DUBINS, information.only("gps"))
    with pytest.raises(od.InputError, match=r"scale has shape \(4,\): must be \(5,\)"):
        od.contributions(DUBINS, information, scale=SCALE[:4])


@pytest.mark.parametrize("value", [0.0, -1.0])
def test_the_unit_of_a_state_is_positive(value: float):
    with pytest.raises(od.InputError, match=rf"scale of heading is {value}: must be a finite number above 0"):
        od.contributions(DUBINS, along(DUBINS), scale=(1.0, 1.0, value, 1.0, 1.0))


# ---------------------------------------------------------------- perturbations

FAR = np.array([4e5, 5e6, 0.0, 0.0, 0.0])  # metres from the origin of a map


def mapped(system: od.System) -> tuple[od.System, od.Trajectory]:
    """The same flight far from the origin, where a double has a billionth of a metre to spare."""
    place = (BEACON[0] + FAR[0], BEACON[1] + FAR[1])
    far = od.System(system.vehicle, (od.GPS(2.0), od.Magnetometer(0.21), od.Range(place, 1.0), od.Bearing(place, 0.087)))
    path = flown(system)
    return far, od.simulate(far, START + FAR, path.u, STEP)


def true_error(system: od.System, path: od.Trajectory, eps: float, weighted: bool = True) -> float:
    exact = od.variational_gramian(system, path, weighted).total
    size = np.sqrt(np.diag(exact))
    return float(np.abs((od.empirical_gramian(system, path, eps, weighted).total - exact) / np.outer(size, size)).max())


HERE = (DUBINS, flown(DUBINS))
CURVED = (SWINGING, flown(SWINGING))
MAPPED = mapped(DUBINS)


@pytest.mark.parametrize(("system", "path"), [HERE, CURVED], ids=["dubins", "swinging"])
@pytest.mark.parametrize("weighted", [True, False], ids=["weighted", "integral"])
@pytest.mark.parametrize("eps", [1e-3, 1e-2, 0.1])
def test_the_curvature_of_a_perturbation_is_the_error_it_makes(system: od.System, path: od.Trajectory, weighted: bool, eps: float):
    found, error = od.perturbation(system, path, eps, weighted), true_error(system, path, eps, weighted)
    assert error / 3 < found.curvature < 3 * error
    assert found.rounding < 0.1 * found.curvature
    assert found.suitable == (found.curvature <= TOLERANCE)
    # between eps and eps / 2 lie three quarters of an error that grows as eps^2
    assert found.difference == pytest.approx(0.75 * error, rel=0.2 if eps < 0.1 else 0.6)


@pytest.mark.parametrize(
    ("system", "path", "eps"),
    [(*HERE, 1e-12), (*HERE, 1e-10), (*CURVED, 1e-11), (*MAPPED, 1e-8), (*MAPPED, 1e-6)],
    ids=["dubins 1e-12", "dubins 1e-10", "swinging 1e-11", "far from the origin 1e-8", "far from the origin 1e-6"],
)
def test_the_rounding_of_a_perturbation_is_the_error_it_makes(system: od.System, path: od.Trajectory, eps: float):
    """One draw of rounding errors stands for another: an order of magnitude is what can be promised."""
    found, error = od.perturbation(system, path, eps), true_error(system, path, eps)
    assert error / 10 < found.rounding < 10 * error
    assert found.curvature < 0.5 * found.rounding


def test_far_from_the_origin_a_billionth_of_a_metre_is_too_small_and_a_tenth_too_large_and_between_lies_what_is_suitable():
    small, good, large = (od.perturbation(*MAPPED, eps) for eps in (1e-9, 1e-3, 0.3))
    assert not small.suitable
    assert small.rounding > small.curvature
    assert small.sentence.endswith("take a larger eps")
    assert true_error(*MAPPED, 1e-9) > TOLERANCE
    assert good.suitable
    assert "this eps is good to" in good.sentence
    assert true_error(*MAPPED, 1e-3) < TOLERANCE
    assert not large.suitable
    assert large.curvature > large.rounding
    assert large.sentence.endswith("take a smaller eps")
    assert true_error(*MAPPED, 0.3) > TOLERANCE


@pytest.mark.parametrize(("system", "path"), [HERE, CURVED, MAPPED], ids=["dubins", "swinging", "far from the origin"])
def test_what_is_called_suitable_is_good_to_three_digits_and_what_is_not_is_not(system: od.System, path: od.Trajectory):
    """Wherever the error is not near the limit itself."""
    judged = 0
    for eps in 10.0 ** np.arange(-13.0, 1.0):
        error = true_error(system, path, eps)
        if not TOLERANCE / 10 < error < 10 * TOLERANCE:
            judged += 1
            assert od.perturbation(system, path, eps).suitable == (error < TOLERANCE)
    assert judged > 8


def test_on_a_linear_system_any_large_perturbation_is_suitable_and_each_state_may_have_its_own():
    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(x, ("a", "b"), ca.vertcat(x[1], -x[0]), outputs={"y": x[0]})
    path = od.simulate(system, (1.0, 2.0), np.zeros((20, 0)), 0.1)
    for eps in (1.0, 100.0, (1.0, 50.0)):
        found = od.perturbation(system, path, eps)
        assert found.suitable
        assert max(found.curvature, found.rounding, found.difference) < 1e-12
    narrow, wide = (od.perturbation(*HERE, (1e-4, 1e-4, heading, 1e-4, 1e-4)) for heading in (1e-4, 0.5))
    assert narrow.suitable
    assert not wide.suitable


def test_a_perturbation_that_makes_no_sense_is_refused():
    with pytest.raises(od.InputError, match=r"eps of heading is 0\.0: must be a finite number above 0"):
        od.perturbation(*HERE, (1e-4, 1e-4, 0.0, 1e-4, 1e-4))
    with pytest.raises(od.InputError, match=r"eps has shape \(2,\)"):
        od.perturbation(*HERE, (1e-4, 1e-4))
    with pytest.raises(od.InputError, match=r"eps is -1\.0: must be a finite number above 0"):
        od.perturbation(*HERE, -1.0)
