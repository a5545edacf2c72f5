"""What belongs to the whole process is left as it was found, whoever else uses it at the same time."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import matplotlib as mpl
import numpy as np
import pytest
import scipy.linalg  # noqa: F401  # with a BLAS of its own, which is counted from when it is loaded
from threadpoolctl import threadpool_info, threadpool_limits

import obsdesign as od
from obsdesign.blas_threads import one_thread
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.report.figures._drawing import inline_svg, styled_figure

SYSTEM = od.System(od.Dubins(5.0), (od.GPS(1.0), od.Range((50.0, 20.0), 1.0)))
PATH = od.simulate(SYSTEM, [0.0, 0.0, 0.1], np.full((8, 1), 0.1), 0.5)
PRIOR = od.Prior(PATH.x[0], std=(10.0, 10.0, 0.1))


@contextmanager
def hasty_threads() -> Iterator[None]:
    """Threads take turns as often as can be."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def blas_threads() -> list[int]:
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


def test_limits_of_blas_that_overlap_leave_what_they_found():
    """The first to come leaves before the second: restoring one by one would end with the limit that the first had set."""
    with threadpool_limits(2):
        before = blas_threads()
        first, second = one_thread(), one_thread()
        first.__enter__()
        assert blas_threads() == [1] * len(before)
        second.__enter__()
        first.__exit__(None, None, None)
        second.__exit__(None, None, None)
        assert blas_threads() == before


def test_a_selection_runs_on_one_thread_of_blas_and_gives_the_others_back():
    blocks, during = od.variational_gramian(SYSTEM, PATH).by_segment(4), []
    with threadpool_limits(2):
        before = blas_threads()
        od.select_sensors(blocks, progress=lambda _: during.append(blas_threads()))
        assert during and all(threads == [1] * len(before) for threads in during)
        assert blas_threads() == before


def gramian_of(i: int) -> object:
    # a new system each time: its model, graphs and loops are made while other threads make theirs
    system = od.System(od.Dubins(5.0 + i % 3), (od.GPS(1.0), od.Range((50.0, 20.0 + i % 2), 1.0)))
    path = od.simulate(system, [0.0, 0.0, 0.1], np.full((8, 1), 0.1), 0.5)
    return od.variational_gramian(system, path).total.tobytes(), od.posterior_information(system, path, PRIOR).tobytes()


def design_of(i: int) -> object:
    bounds = {"turn_rate": (-0.3, 0.3 + 0.01 * (i % 3))}
    problem = od.DesignProblem(system=SYSTEM, start=[0, 0, 0.1], duration=4.0, step=0.5, path=od.PiecewiseConstant(2), bounds=bounds)
    return od.design_trajectory(problem, starts=1).trajectory.x.tobytes()


def schedule_of(i: int) -> object:
    blocks = od.variational_gramian(SYSTEM, PATH).by_segment(4) * (1 + i % 3)
    found = od.select_sensors(blocks, method="direct" if i % 2 else "columns")
    return found.chosen.tobytes(), found.value


def picture_of(i: int) -> object:
    return inline_svg(styled_figure(2.0, lambda figure: figure.subplots().plot([0, 1, i])), "a", "a line")


@pytest.mark.parametrize("work", [gramian_of, design_of, schedule_of, picture_of], ids=lambda work: work.__name__)
def test_four_threads_find_what_one_finds(work: Callable[[int], object]):
    alone = [work(i) for i in range(4)]
    filters, style, limits = list(warnings.filters), dict(mpl.rcParams), blas_threads()  # now that all is loaded
    with hasty_threads(), ThreadPoolExecutor(4) as pool:
        assert list(pool.map(work, range(4))) == alone
    assert (list(warnings.filters), dict(mpl.rcParams), blas_threads()) == (filters, style, limits)


def test_a_reading_that_is_not_a_number_is_refused_where_it_counts_and_only_there():
    """A missing reading is often nan: one that is off changes nothing, one that is on would make every belief nan."""
    filter_ = FilterBank(SYSTEM, PATH.step, np.zeros((3, 3)))
    first = Belief(PATH.x[:1], PRIOR.covariance[None])
    y = np.stack([[PATH.x[k, 0], PATH.x[k, 1], np.hypot(PATH.x[k, 0] - 50.0, PATH.x[k, 1] - 20.0)] for k in range(8)])[:, None]
    active = np.ones((8, 3), dtype=bool)
    active[2, 1] = False
    missing = y.copy()
    missing[2, 0, 1] = np.nan
    np.testing.assert_array_equal(filter_.run(first, PATH.u, missing, active).mean, filter_.run(first, PATH.u, y, active).mean)
    with pytest.raises(od.InputError, match=r"y\[2, 0, 1\] \(gps_y\) is nan: what is active must be finite"):
        filter_.run(first, PATH.u, missing, np.ones((8, 3), dtype=bool))
    with pytest.raises(od.InputError, match=r"gps_y"):
        filter_.update(first, missing[2], np.ones(3, dtype=bool))


@pytest.mark.parametrize("wrong", [np.nan, 0.5, -1.0, np.inf])
def test_a_schedule_says_on_or_off(wrong: float):
    chosen = np.ones((4, 2))
    chosen[1, 1] = wrong
    with pytest.raises(od.InputError, match=rf"schedule\[1, 1\] is {wrong}: must be true or false"):
        od.validate(SYSTEM, PATH, chosen, prior=PRIOR, runs=2)
