"""The floor of an overconfident sensor: closed forms, brute force over the likelihood, simulation with a known one, what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od

often = settings(deadline=None, max_examples=60, database=None, derandomize=True)
SEGMENTS = st.lists(st.lists(st.floats(-5.0, 5.0), max_size=6), min_size=1, max_size=6).filter(any)
SIGMA = st.floats(0.05, 5.0)


def means(residuals: list[list[float]], sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Means m_j and their variances sigma^2 / n_j, of the segments that have residuals."""
    given_segments = [segment for segment in residuals if len(segment)]
    return np.array([np.mean(segment) for segment in given_segments]), np.array([sigma**2 / len(segment) for segment in given_segments])


def likelihood(m: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
    variance = v + np.asarray(tau)[..., None]
    return -0.5 * np.sum(np.log(variance) + m**2 / variance, axis=-1)


@often
@given(SEGMENTS, SIGMA)
def test_no_other_floor_is_more_likely(residuals: list[list[float]], sigma: float):
    """Against 40,000 floors from 0 to beyond every mean."""
    m, v = means(residuals, sigma)
    b = od.fit_floor(residuals, sigma)
    others = np.concatenate([np.linspace(0.0, 6.0, 20_001), np.geomspace(1e-6, 6.0, 20_000)]) ** 2
    assert b >= 0
    assert likelihood(m, v, np.array([b**2]))[0] >= likelihood(m, v, others).max() - 1e-9


@often
@given(st.integers(1, 8), st.integers(1, 30), SIGMA, st.integers(0, 10**6))
def test_segments_of_one_length_have_a_closed_form(segments: int, length: int, sigma: float, seed: int):
    """b^2 = mean(m^2) - sigma^2 / n, or 0: the moment estimator."""
    random = np.random.default_rng(seed)
    residuals = sigma * random.standard_normal((segments, length)) + random.standard_normal((segments, 1))
    expected = max(0.0, float(np.mean(residuals.mean(axis=1) ** 2)) - sigma**2 / length)
    assert od.fit_floor(list(residuals), sigma) ** 2 == pytest.approx(expected, rel=1e-9, abs=1e-12 * sigma**2)


@often
@given(SEGMENTS, SIGMA, st.floats(-12.0, 12.0))
def test_another_unit_scales_the_floor(residuals: list[list[float]], sigma: float, decades: float):
    unit = 10.0**decades
    scaled = od.fit_floor([unit * np.array(segment) for segment in residuals], unit * sigma)
    m, v = means(residuals, sigma)
    b = od.fit_floor(residuals, sigma)
    assert scaled == pytest.approx(unit * b, rel=1e-6, abs=1e-6 * unit * sigma) or likelihood(m, v, np.array([(scaled / unit) ** 2])) == (
        pytest.approx(likelihood(m, v, np.array([b**2])), abs=1e-9)  # two floors that are equally likely
    )


@often
@given(SEGMENTS, SIGMA, st.randoms())
def test_the_order_of_segments_and_empty_ones_change_nothing(residuals: list[list[float]], sigma: float, random):
    shuffled = [*residuals, [], []]
    random.shuffle(shuffled)
    assert od.fit_floor(shuffled, sigma) == pytest.approx(od.fit_floor(residuals, sigma), rel=1e-7, abs=1e-7)


def test_one_segment_and_equal_residuals_have_the_floor_that_is_left():
    assert od.fit_floor([[3.0]], 1.0) == pytest.approx(math.sqrt(8.0), rel=1e-12)
    assert od.fit_floor([[3.0, 1.0]], 2.0) == pytest.approx(math.sqrt(4.0 - 2.0), rel=1e-12)
    assert od.fit_floor([[2.0] * 4, [2.0] * 4], 2.0) == pytest.approx(math.sqrt(3.0), rel=1e-12)
    assert od.fit_floor([[0.5], [0.2, -0.3]], 1.0) == 0.0
    assert od.fit_floor([[0.0, 0.0], [0.0]], 1e-3) == 0.0


@pytest.mark.parametrize("size", [1e-200, 1e-9, 1e200])
def test_sizes_at_the_ends_of_doubles_do_no_harm(size: float):
    assert od.fit_floor([[3.0 * size], [-3.0 * size, -3.0 * size]], size) == pytest.approx(
        size * od.fit_floor([[3.0], [-3.0, -3.0]], 1.0), rel=1e-9
    )
    assert od.fit_floor([[size], [2 * size, 2 * size]], 1e-100 * size) == pytest.approx(size * math.sqrt(2.5), rel=1e-6)


@pytest.mark.parametrize("b", [0.0, 0.3, 1.0, 3.0])
def test_simulated_floors_come_out_within_their_standard_error(b: float):
    """Of 400 segments of unequal length: by the information 1/2 sum (v + tau)^-2 about tau, within 4 of its standard deviations."""
    for seed in range(20):
        random = np.random.default_rng([seed, int(10 * b)])
        lengths = random.choice([0, 1, 2, 5, 20, 100], 400)
        residuals = [b * random.standard_normal() + random.standard_normal(n) for n in lengths]
        v = 1 / lengths[lengths > 0]
        standard_error = (0.5 * np.sum((v + b**2) ** -2)) ** -0.5
        assert abs(od.fit_floor(residuals, 1.0) ** 2 - b**2) < 4 * standard_error


def test_it_errs_less_than_the_mean_of_squares_beyond_the_noise():
    """Over 300 sets of 12 segments of unequal length, with a small floor: less than half of its error."""
    errors = []
    for seed in range(300):
        random = np.random.default_rng(seed)
        residuals = [0.1 * random.standard_normal() + random.standard_normal(n) for n in random.choice([1, 2, 5, 20, 100], 12)]
        m, v = means([list(segment) for segment in residuals], 1.0)
        moment = math.sqrt(max(0.0, float(np.mean(m**2 - v))))
        errors.append((od.fit_floor(residuals, 1.0) - 0.1, moment - 0.1))
    most_likely, by_moments = np.sqrt(np.mean(np.square(errors), axis=0))
    assert most_likely < 0.5 * by_moments


@pytest.mark.parametrize(
    ("residuals", "sigma", "words"),
    [
        ([], 1.0, "residuals has 0 segments and no residual"),
        ([[], []], 1.0, "residuals has 2 segments and no residual: one at least is needed"),
        ([[1.0], [2.0, math.nan]], 1.0, r"residuals\[1\]\[1\] is nan: must be finite"),
        ([[math.inf]], 1.0, r"residuals\[0\]\[0\] is inf: must be finite"),
        ([1.0, 2.0], 1.0, r"residuals\[0\] has shape \(\): must be an array \(n,\)"),
        ([np.ones((2, 2))], 1.0, r"residuals\[0\] has shape \(2, 2\)"),
        ([["far"]], 1.0, r"residuals\[0\] is \['far'\]: must be an array of real numbers"),
        ([[1.0]], 0.0, "sigma is 0.0: must be a finite number above 0"),
        ([[1.0]], -1.0, "sigma is -1.0"),
        ([[1.0]], math.nan, "sigma is nan"),
        (1.0, 1.0, "residuals is 1.0"),
    ],
)
def test_what_is_no_residuals_is_refused(residuals: object, sigma: float, words: str):
    with pytest.raises(od.InputError, match=words):
        od.fit_floor(residuals, sigma)  # pyright: ignore[reportArgumentType]
