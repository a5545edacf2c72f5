"""What a log holds: inputs over steps of any length, samples in any order, truth with gaps."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od

TIMES = st.lists(st.floats(0.0, 100.0, allow_subnormal=False), min_size=3, max_size=12, unique=True).map(sorted)


def small_log(**changes):
    inputs = od.LogInputs(("speed", "turn_rate"), [0.0, 1.0, 3.0], [[1.0, 0.1], [2.0, np.nan], [4.0, 0.3]])
    samples = od.LogSamples(("a", "b"), [2.0, 0.5, 2.0, 4.0], [0, 1, 1, 0], [10.0, 20.0, 30.0, 40.0])
    truth = od.LogTruth(("x", "heading"), [0.0, 2.0, 4.0], [[0.0, 3.0], [np.nan, -3.0], [8.0, -2.8]])
    return od.Log(**{"inputs": inputs, "samples": samples, "truth": truth, **changes})


@settings(max_examples=30, deadline=None)
@given(TIMES, TIMES, st.randoms(use_true_random=False))
def test_held_and_added_inputs_keep_their_integral(readings, steps, random):
    """The mean over steps times their lengths is the integral, by Riemann sums on the union of both grids, whatever the steps are."""
    t, times = np.array(readings), np.array(steps)
    if min(np.diff(t).min(), np.diff(times).min()) < 1e-6:
        return
    u = np.array([random.uniform(-1, 1) for _ in t])
    union = np.unique(np.concatenate([t, times]))
    union = union[(union >= times[0]) & (union <= times[-1])]
    held = u[np.clip(np.searchsorted(t, union[:-1], side="right") - 1, 0, len(t) - 1)]
    mean = od.LogInputs(("a",), t, u[:, None]).over(times)[:, 0]
    whole = np.array(
        [sum(held[k] * (union[k + 1] - union[k]) for k in range(len(held)) if low <= union[k] < high) for low, high in pairwise(times)]
    )
    assert mean * np.diff(times) == pytest.approx(whole, abs=1e-9)
    # the same motion told by increments: what came together since the reading before
    added = np.concatenate([[u[0] * (t[1] - t[0])], u[:-1] * np.diff(t)])
    inside = (times >= t[0]) & (times <= t[-1])
    if inside.sum() > 1:
        by_increments = od.LogInputs(("a",), t, added[:, None], increments=("a",)).over(times[inside])[:, 0]
        assert by_increments == pytest.approx(od.LogInputs(("a",), t, u[:, None]).over(times[inside])[:, 0], abs=1e-6)


def test_a_column_without_a_reading_goes_on_as_it_was():
    mean = small_log().inputs.over(np.array([0.0, 1.0, 2.0, 4.0]))
    assert mean == pytest.approx(np.array([[1.0, 0.1], [2.0, 0.1], [3.0, 0.2]]))


def test_samples_come_in_any_order_and_several_at_one_time():
    log = small_log()
    assert log.samples.t.tolist() == [0.5, 2.0, 2.0, 4.0]
    assert log.samples.y[:, 0].tolist() == [20.0, 10.0, 30.0, 40.0]
    assert log.samples.counts == {"a": 2, "b": 2}
    assert log.samples.only(["b"]).t.tolist() == [0.5, 2.0]


def test_the_first_share_is_of_the_time():
    half = small_log().first(0.5)
    assert half.samples.t.tolist() == [0.5, 2.0, 2.0]
    assert half.inputs.t.tolist() == [0.0, 1.0]
    assert half.truth.t.tolist() == [0.0, 2.0]
    later = small_log().stretch(1.5, 4.0)
    # what is held at the beginning of a stretch was read before it
    assert later.inputs.over(np.array([1.5, 3.0])) == pytest.approx(np.array([[2.0, 0.1]]))


@settings(max_examples=30, deadline=None)
@given(TIMES, st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.randoms(use_true_random=False))
def test_a_stretch_keeps_the_integrals_within_it(readings, a, b, random):
    t = np.array(readings)
    if np.diff(t).min() < 1e-3 or abs(a - b) < 1e-3:
        return
    first, last = sorted(t[0] + share * (t[-1] - t[0]) for share in (a, b))
    u = np.array([[random.uniform(-1, 1) if random.random() < 0.7 else np.nan for _ in range(2)] for _ in t])
    u[:2] = 0.5
    inputs = od.LogInputs(("added", "held"), t, u, ("added",))
    times = np.linspace(first, last, 5)
    part = inputs.stretch(first, last)
    assert part.integrals(times) == pytest.approx(inputs.integrals(times), abs=1e-9)
    assert first <= part.t[0] and part.t[-1] <= last  # the log of the stretch begins with it, and so does the prior of a filter


def test_truth_is_interpolated_where_it_is_known_and_angles_take_the_short_way():
    truth = small_log().truth
    values = truth.at(np.array([-1.0, 1.0, 3.0, 5.0]), angles=("heading",))
    assert np.isnan(values[[0, 3]]).all()
    assert values[1:3, 0] == pytest.approx([2.0, 6.0])
    assert np.cos(values[1, 1]) == pytest.approx(-1.0)
    assert np.isnan(truth.at(np.array([1.0]), max_gap=3.0)[0, 0])
    assert truth.at(np.array([4.0]), max_gap=1.0)[0, 0] == 8.0


WRONG = {
    "times that go backwards": (lambda: od.LogInputs(("a",), [0.0, 2.0, 1.0], [[0.0]] * 3), r"t\[2\] is 1 after 2: times must increase"),
    "a truth twice": (lambda: od.LogTruth(("x", "x"), [0.0], [[0.0, 0.0]]), "'x' twice"),
    "a range that is no number": (lambda: od.LogSamples(("a",), [0, 1], [0, 0], [1, np.nan]), r"y\[1\] \(a\) is \[nan\]: must be finite"),
    "an unknown place": (lambda: od.LogSamples(("a",), [0.0], [1], [1.0]), r"sensor\[0\] is 1: must be a place in"),
    "a sigma of zero": (lambda: od.LogSamples(("a",), [0.0], [0], [1.0], [0.0]), r"sigma\[0\] \(a\) is 0.0: must be above 0"),
    "no samples": (lambda: small_log(samples=od.LogSamples(("a",), [], [], [])), "there are no samples"),
    "no share": (lambda: small_log().first(0.0), "share is 0.0: must be"),
    "an increment alone": (lambda: od.LogInputs(("a",), [1.0], [[0.1]], ("a",)).over(np.array([0.0, 1.0])), "have one reading"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_a_log_is_refused_by_name(case):
    make, message = WRONG[case]
    with pytest.raises(od.InputError, match=message):
        make()
