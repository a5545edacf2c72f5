"""Samples at their own times: on a grid the same as ever, between its nodes the limit of dense grids, in any order and number."""

import numpy as np
import pytest

import obsdesign as od
from obsdesign.logs.events import events_of
from obsdesign.logs.log import shift_text

SYSTEM = od.System(
    od.Dubins(15.0, wind="constant"),
    (od.GPS(2.0), od.Range((500.0, 200.0), 1.0), od.Bearing((300.0, -100.0), 0.05)),
)
NAMES = SYSTEM.model.sensor_names
START = np.array([0.0, 0.0, 0.3, 3.0, -2.0])
PRIOR, PSD = od.Prior(START, std=(50.0, 50.0, 0.1, 5.0, 5.0)), (0.1, 0.1, 0.001, 0.01, 0.01)
TURN = 0.2 * np.sin(np.arange(24) / 5)[:, None]
PATH = od.simulate(SYSTEM, START, TURN, 0.5)


def log_of(times, sensors, sigma=None):
    """A log with samples of these sensors at these times; information does not ask for their values."""
    y = np.where(np.array(sensors)[:, None] == 0, [[1.0, 2.0]], [[1.0, np.nan]])
    inputs = od.LogInputs(("turn_rate",), PATH.t[:-1], TURN)
    return od.Log(inputs, od.LogSamples(NAMES, times, sensors, y, sigma))


def information(path, log=None, **options):
    extra = {} if log is None else {"samples": log}
    return (
        od.variational_gramian(SYSTEM, path, **extra).blocks,
        od.posterior_information(SYSTEM, path, PRIOR, options.get("psd", PSD), **extra),
        od.sliding_information(SYSTEM, path, 6, **extra),
        od.contributions(SYSTEM, od.variational_gramian(SYSTEM, path, **extra), 6).shares,
    )


def close(found, expected, tolerance):
    for a, b in zip(found, expected, strict=True):
        assert a == pytest.approx(b, rel=1e3 * tolerance, abs=tolerance * np.abs(b).max())


def test_a_sample_of_each_sensor_at_each_node_is_what_rates_promise():
    every = log_of(np.repeat(PATH.t[:-1], 3), np.tile([0, 1, 2], 24))
    close(information(PATH, every), information(PATH), 1e-12)
    some = np.random.default_rng(0).random((24, 3)) < 0.4
    k, s = np.nonzero(some)
    J = od.posterior_information(SYSTEM, PATH, PRIOR, PSD, samples=log_of(PATH.t[k], s))
    assert pytest.approx(od.posterior_information(SYSTEM, PATH, PRIOR, PSD, active=some), rel=1e-9, abs=1e-12) == J


def test_samples_between_nodes_are_those_of_a_dense_grid():
    """64 steps a second have a node at every sample; coarse steps of 0.5 s see the same, but for what RK4 leaves of them."""
    random = np.random.default_rng(1)
    k, s = random.choice(768, 60, replace=False), random.integers(0, 3, 60)
    dense = od.simulate(SYSTEM, START, np.repeat(TURN, 32, axis=0), 1 / 64)
    coarse = od.Trajectory(PATH.t, dense.x[::32], TURN)
    active = np.zeros((768, 3), dtype=bool)
    active[k, s] = True
    log = log_of(dense.t[k], s)
    W = od.variational_gramian(SYSTEM, coarse, samples=log)
    blocks = od.variational_gramian(SYSTEM, dense).blocks * active[:, :, None, None]
    expected = blocks.reshape(24, 32, 3, 5, 5).sum(axis=1)
    assert W.blocks == pytest.approx(expected, rel=1e-6, abs=1e-8 * expected.max())
    J = od.posterior_information(SYSTEM, coarse, PRIOR, samples=log)
    assert pytest.approx(od.posterior_information(SYSTEM, dense, PRIOR, active=active)[::32][:25], rel=1e-5, abs=1e-7) == J


def test_with_process_noise_dense_grids_tend_to_the_event_times():
    """Noise enters at the ends of steps: the error is of their length, and half of it with half of them."""
    random = np.random.default_rng(2)
    times, s = np.sort(random.uniform(0.0, 12.0, 40)), random.integers(0, 3, 40)
    log, errors = log_of(times, s), []
    fine = od.posterior_information(SYSTEM, od.simulate(SYSTEM, START, np.repeat(TURN, 64, axis=0), 1 / 128), PRIOR, PSD, samples=log)[-1]
    for parts in (4, 8, 16):
        J = od.posterior_information(
            SYSTEM, od.simulate(SYSTEM, START, np.repeat(TURN, parts, axis=0), 0.5 / parts), PRIOR, PSD, samples=log
        )
        errors.append(np.abs(np.sqrt(np.diag(np.linalg.inv(J[-1]))) / np.sqrt(np.diag(np.linalg.inv(fine))) - 1).max())
    assert errors[0] < 0.02
    assert errors[1] < 0.7 * errors[0] and errors[2] < 0.7 * errors[1]


def test_order_does_not_matter_and_several_samples_at_one_time_add_up():
    times, s = np.array([1.0, 1.0, 1.0, 2.3, 2.3, 7.7]), np.array([0, 0, 1, 2, 2, 1])
    order = np.array([5, 2, 0, 4, 1, 3])
    close(information(PATH, log_of(times[order], s[order]))[:3], information(PATH, log_of(times, s))[:3], 1e-13)
    single = [information(PATH, log_of(times[[i]], s[[i]]))[0] for i in range(6)]
    assert information(PATH, log_of(times, s))[0] == pytest.approx(sum(single), rel=1e-9, abs=1e-15)
    # two equal samples tell what one of half the variance tells, at the same instant
    twice = information(PATH, log_of(np.array([2.3, 2.3]), np.array([1, 1])))
    better = information(PATH, log_of(np.array([2.3]), np.array([1]), [1.0 / np.sqrt(2)]))
    close(twice[:3], better[:3], 1e-11)


def test_sensors_with_constant_errors_count_at_event_times_too():
    biased = od.System(SYSTEM.vehicle, (od.GPS(2.0, bias_floor=1.0), *SYSTEM.sensors[1:]))
    some = np.random.default_rng(3).random((24, 3)) < 0.4
    k, s = np.nonzero(some)
    J = od.posterior_information(biased, PATH, PRIOR, PSD, samples=log_of(PATH.t[k], s))
    assert pytest.approx(od.posterior_information(biased, PATH, PRIOR, PSD, active=some), rel=1e-9, abs=1e-12) == J
    W = od.variational_gramian(biased, PATH, samples=log_of(PATH.t[k], s)).total
    np.testing.assert_allclose(W, od.variational_gramian(biased, PATH).under(some.astype(float)), rtol=1e-9, atol=1e-9 * np.abs(W).max())


def test_the_path_may_have_steps_of_any_length_and_sensors_rates_that_nobody_keeps():
    random = np.random.default_rng(4)
    rated = od.System(SYSTEM.vehicle, (od.GPS(2.0, rate=3.0), *SYSTEM.sensors[1:]))
    dt = random.uniform(0.1, 0.9, 24)
    path = od.simulate(rated, START, TURN, dt)
    times, s = random.uniform(0.0, path.t[-1], 50), random.integers(0, 3, 50)
    inner = np.unique(np.concatenate([path.t[:-1], times]))
    held = TURN[np.searchsorted(path.t, inner, side="right") - 1]
    dense = od.simulate(SYSTEM, START, held, np.diff(np.append(inner, path.t[-1])))
    active = np.zeros((len(inner), 3), dtype=bool)
    active[np.searchsorted(inner, times), s] = True
    expected = od.posterior_information(SYSTEM, dense, PRIOR, PSD, active=active)[-1]
    found = od.posterior_information(rated, path, PRIOR, PSD, samples=log_of(times, s))[-1]
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-8)


def test_events_keep_every_sample_and_every_integral():
    random = np.random.default_rng(5)
    times, s = random.uniform(0.0, 11.9, 80), random.integers(0, 3, 80)
    times[40:50] = times[:10]
    log = log_of(times, s)
    events = events_of(SYSTEM, log)
    k, sensor = np.nonzero(events.arrived)
    assert sorted(zip(events.t[k], sensor, strict=True)) == sorted(zip(times, s, strict=True))
    assert not events.shifts.any() and not shift_text(events.shifts)
    inside = events.t[:-1] < PATH.t[-1]
    assert events.rows[inside, 1].sum() == pytest.approx(
        0.5 * TURN.sum() - (PATH.t[-1] - events.t[:-1][inside][-1] - events.lengths[inside][-1]) * TURN[-1, 0]
    )
    grid = events_of(SYSTEM, log, step=0.5)
    assert grid.arrived.sum() == 80  # none is lost, though several fall on one node
    assert np.abs(grid.shifts).max() <= 0.25
    assert "80 of 80 samples were moved to the grid" in shift_text(grid.shifts)
    assert np.unique(np.round(grid.lengths, 9)).tolist() == [0.0, 0.5]


def test_samples_that_almost_coincide_stay_where_they_are_and_make_no_steps():
    """Of three a microsecond apart half of the steps are of that length: a second between them is not cut by it."""
    times = np.concatenate([np.arange(12.0) + late for late in (0.0, 1e-6, 2e-6)])
    assert len(events_of(SYSTEM, log_of(times, np.repeat([0, 1, 2], 12))).lengths) <= 2 * (36 + len(PATH.t))
    chain = np.array([1.0, 1.0 + 0.9e-9, 1.0 + 1.8e-9, 3.0])  # each no time at all after the one before
    assert np.abs(events_of(SYSTEM, log_of(chain, np.array([0, 1, 2, 0]))).shifts).max() < 2e-9


def test_a_log_moved_to_a_grid_says_by_how_much_and_counts_as_on_the_grid():
    random = np.random.default_rng(6)
    k, s = np.sort(random.choice(23, 15, replace=False)), random.integers(0, 3, 15)
    late = log_of(PATH.t[k] + 0.1, s)
    grid = late.on_grid(0.5)
    assert grid.notes == ("15 of 15 samples were moved to the grid, by 0.1 s (median), 0.1 s at most",)
    close(information(PATH, grid)[:3], information(PATH, log_of(PATH.t[k], s))[:3], 1e-11)
    with pytest.raises(od.InputError, match="step is 0: must be a finite number above 0"):
        late.on_grid(0)


WRONG = {
    "a sensor of another system": (lambda: od.Log(None, od.LogSamples(("rnge",), [1.0], [0], [1.0])), "has no 'rnge'"),
    "too few outputs": (
        lambda: od.Log(None, od.LogSamples(("gps",), [1.0], [0], [1.0])),
        r"sample of 'gps' at t = 1 s has 1 values: the sensor has 2",
    ),
    "another time": (lambda: log_of([1e9], [1]), "none is along it; both must count time from the same instant"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_log_that_does_not_fit_is_refused(case):
    make, message = WRONG[case]
    with pytest.raises(od.InputError, match=message):
        od.posterior_information(SYSTEM, PATH, PRIOR, samples=make())
