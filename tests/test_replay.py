"""A log, replayed: the filter and the posterior as they are, the same however the log is written, and what does not fit is named."""

import numpy as np
import pytest

import obsdesign as od

BEACONS = ((60.0, 0.0), (0.0, 50.0), (-40.0, -30.0), (30.0, 70.0))
NAMES = tuple(f"beacon_{i}" for i in range(4))
PRIOR, PSD = od.Prior([0.0, 0.0, 0.3], std=(1.0, 1.0, 0.2)), (0.02, 0.02, 0.002)
SENSORS = tuple(od.Range(place, 0.5, name=name) for place, name in zip(BEACONS, NAMES, strict=True))
SYSTEM = od.System(od.Unicycle(), SENSORS)


def drive(seed=0, steps=400, dt=0.25, moved=None, epoch=0.0):
    """A drive with process noise; ranges now and then, at times of their own; truth at the steps."""
    random = np.random.default_rng(seed)
    u = np.column_stack([2.0 + np.sin(np.arange(steps) / 9), 0.3 * np.cos(np.arange(steps) / 17)])
    x = np.array([0.0, 0.0, 0.3])
    states = [x]
    for row in u:
        middle = x[2] + 0.5 * dt * row[1]
        x = x + dt * np.array([row[0] * np.cos(middle), row[0] * np.sin(middle), row[1]])
        x = x + random.standard_normal(3) * np.sqrt(np.array(PSD) * dt)
        states.append(x)
    states, t = np.array(states), dt * np.arange(steps + 1)
    count = 500 * steps // 400
    times, sensor = np.sort(random.uniform(0.0, t[-1], count)), random.integers(0, 4, count)
    at = np.column_stack([np.interp(times, t, states[:, i]) for i in range(2)])
    places = np.array(BEACONS)
    if moved is not None:
        places[moved] += [6.0, -5.0]
    y = np.linalg.norm(at - places[sensor], axis=1) + 0.5 * random.standard_normal(count)
    inputs = od.LogInputs(("speed", "turn_rate"), t[:-1] + epoch, u)
    return od.Log(inputs, od.LogSamples(NAMES, times + epoch, sensor, y), od.LogTruth(("x", "y", "heading"), t + epoch, states))


def test_on_an_even_grid_it_is_the_filter_and_the_posterior():
    random = np.random.default_rng(1)
    u = np.column_stack([np.full(80, 2.0), 0.3 * np.cos(np.arange(80) / 7)])
    truth = od.simulate(SYSTEM, PRIOR.mean, u, 0.25)
    y = np.array([np.linalg.norm(truth.x[:-1, :2] - place, axis=1) for place in BEACONS]).T + 0.3 * random.standard_normal((80, 4))
    active = random.random((80, 4)) < 0.4
    k, s = np.nonzero(active)
    log = od.Log(
        od.LogInputs(("speed", "turn_rate"), truth.t[:-1], u),
        od.LogSamples(NAMES, truth.t[k], s, y[k, s]),
        od.LogTruth(("x", "y", "heading"), truth.t, truth.x),
    )
    # the last instant of the truth: one more reading than steps, so that the bound is along all of it
    found = od.replay(SYSTEM, log, PRIOR, disturbance_psd=PSD, along="truth", gate=None, window=5.0)
    even = od.estimate_states(SYSTEM, PRIOR, u, y, 0.25, active=active, disturbance_psd=PSD)
    J = od.posterior_information(SYSTEM, truth, PRIOR, PSD, active=active)
    assert found.t == pytest.approx(truth.t, abs=1e-12)
    assert found.estimate == pytest.approx(even.mean, rel=1e-12, abs=1e-12)
    assert found.covariance == pytest.approx(even.covariance, rel=1e-12, abs=1e-13)
    assert found.bound == pytest.approx(od.standard_deviations(J), rel=1e-12)
    assert found.error == pytest.approx(even.mean - truth.x, abs=1e-12)
    along = od.replay(SYSTEM, log, PRIOR, disturbance_psd=PSD, gate=None)
    path = od.path_of_estimate(SYSTEM, log, along.run)
    J = od.posterior_information(SYSTEM, path, PRIOR, PSD, samples=log)
    assert along.bound == pytest.approx(od.standard_deviations(J), rel=1e-12)
    sizes = np.sqrt((found.bound[:20, :2] ** 2).sum(axis=1))  # the first five seconds
    assert found.windows[0].predicted == pytest.approx(np.sqrt(np.mean(sizes**2)), rel=1e-9)
    assert [window.samples.sum() for window in found.windows] == [active[i : i + 20].sum() for i in range(0, 80, 20)]


def test_the_order_of_rows_and_the_beginning_of_time_change_nothing():
    log = drive(steps=120)
    order = np.random.default_rng(2).permutation(150)
    samples = log.samples
    shuffled = od.LogSamples(NAMES, samples.t[order], samples.sensor[order], samples.y[order])
    options = {"disturbance_psd": PSD, "along": "truth", "restarts": 2, "window": 5.0}
    first = od.replay(SYSTEM, log, PRIOR, **options)
    again = od.replay(SYSTEM, od.Log(log.inputs, shuffled, log.truth), PRIOR, **options)
    later = od.replay(SYSTEM, drive(steps=120, epoch=1.7e9), PRIOR, **options)
    for other, tolerance in ((again, 1e-12), (later, 1e-4)):  # Unix times have 1e-7 s to their last digit
        assert other.estimate == pytest.approx(first.estimate, rel=tolerance, abs=tolerance)
        assert other.bound == pytest.approx(first.bound, rel=tolerance)
        assert other.rank_correlation.value == pytest.approx(first.rank_correlation.value, abs=1e-9 if other is again else 0.2)


def test_a_log_in_ned_says_the_same():
    """x north, y east, angles clockwise: the mirror image, in which the same equations hold for the same vehicle and sensors."""
    log, samples, truth = drive(steps=80), drive(steps=80).samples, drive(steps=80).truth
    bearings = [np.arctan2(*(np.array(BEACONS[0]) - truth.x[k, :2])[::-1]) - truth.x[k, 2] for k in range(0, 80, 9)]
    t = np.concatenate([samples.t[samples.t <= 20.0], truth.t[:80:9]])
    sensor = np.concatenate([samples.sensor[samples.t <= 20.0], np.full(len(bearings), 4)])
    y, is_angle = np.concatenate([samples.y[samples.t <= 20.0, 0], bearings]), sensor == 4

    def replay(is_ned):
        """Of the drive, as it is written east-north or north-east."""
        beacons = [place[::-1] if is_ned else place for place in BEACONS]
        ranges = [od.Range(place, 0.5, name=name) for place, name in zip(beacons, NAMES, strict=True)]
        system = od.System(od.Unicycle(), (*ranges, od.Bearing(beacons[0], 0.05, name="camera")))
        mirror = (lambda x: np.column_stack([x[:, 1], x[:, 0], np.pi / 2 - x[:, 2]])) if is_ned else np.asarray
        sign, std = (-1.0 if is_ned else 1.0), np.array([1.0, 2.0, 0.2])[[1, 0, 2] if is_ned else [0, 1, 2]]
        written = od.Log(
            od.LogInputs(("speed", "turn_rate"), log.inputs.t, log.inputs.u * [1.0, sign]),
            od.LogSamples((*NAMES, "camera"), t, sensor, np.where(is_angle, sign * y, y)),
            od.LogTruth(truth.names, truth.t, mirror(truth.x)),
        )
        prior = od.Prior(mirror(PRIOR.mean[None])[0], std=std)
        return od.replay(system, written, prior, disturbance_psd=PSD, input_psd={"turn_rate": 1e-4}, window=5.0, restarts=0), mirror

    (ned, mirror), (enu, _) = replay(True), replay(False)
    np.testing.assert_allclose(mirror(ned.estimate), enu.estimate, rtol=0, atol=1e-5)  # steps are right to 1e-6 of 40 m
    np.testing.assert_allclose(ned.bound[:, [1, 0, 2]], enu.bound, rtol=1e-5)
    np.testing.assert_allclose(np.abs(ned.error[:, [1, 0, 2]]), np.abs(enu.error), rtol=0, atol=1e-5)
    np.testing.assert_allclose(ned.run.nis, enu.run.nis, rtol=1e-3, atol=1e-6)
    assert [window.growth for window in ned.windows] == [pytest.approx(window.growth, rel=1e-5) for window in enu.windows]
    assert ned.rmse == pytest.approx(enu.rmse, rel=1e-5)


def test_a_file_in_degrees_clockwise_from_north_says_the_same(tmp_path):
    log = drive(steps=60)
    rows = ["t [s],signal,value"]
    rows += [
        f"{t!r},speed,{u[0]!r}\n{t!r},turn_rate [deg/s],{float(np.degrees(u[1]))!r}"
        for t, u in zip(log.inputs.t.tolist(), log.inputs.u.tolist(), strict=True)
    ]
    rows += [
        f"{t!r},{NAMES[s]} [mm],{1000 * y!r}"
        for t, s, y in zip(log.samples.t.tolist(), log.samples.sensor.tolist(), log.samples.y[:, 0].tolist(), strict=True)
        if t <= 15.0
    ]
    (tmp_path / "drive.csv").write_text("\n".join(rows) + "\n")
    read = od.read_log(tmp_path / "drive.csv", SYSTEM)
    bare = od.Log(log.inputs, log.samples.where(log.samples.t <= 15.0))
    found, expected = (od.replay(SYSTEM, each, PRIOR, disturbance_psd=PSD) for each in (read, bare))
    assert found.estimate == pytest.approx(expected.estimate, rel=1e-9, abs=1e-9)
    assert found.bound == pytest.approx(expected.bound, rel=1e-9)
    assert np.isnan(found.rmse) and any("there is no truth" in note for note in found.notes)


@pytest.mark.parametrize("moved", [0, 2])
def test_a_beacon_that_was_moved_is_named(moved):
    said = od.replay(SYSTEM, drive(moved=moved), PRIOR, disturbance_psd=PSD).notes
    assert [note.partition(" ")[0] for note in said if "does not fit the others" in note] == [NAMES[moved]]
    assert not any("does not fit" in note for note in od.replay(SYSTEM, drive(), PRIOR, disturbance_psd=PSD).notes)


def test_restarted_filters_err_as_the_bound_says_and_a_linear_one_exactly():
    """Of a filter that is right errors are chi-square about what is predicted: 10 windows of 40 runs."""
    found = od.replay(SYSTEM, drive(steps=400), PRIOR, disturbance_psd=PSD, along="truth", restarts=40)
    assert found.ratio == pytest.approx(1.0, abs=0.25)
    assert found.rank_correlation.low <= found.rank_correlation.value <= found.rank_correlation.high


def test_growth_is_what_leaving_a_sensor_out_does_to_the_posterior():
    log, wide = drive(steps=120), od.Prior(PRIOR.mean, std=(3.0, 3.0, 0.3))
    found = od.replay(SYSTEM, log, wide, disturbance_psd=PSD, along="truth", restarts=2)
    for s in (0, 3):
        window = found.windows[1]
        others = [name for name in NAMES if name != NAMES[s]]
        left_out = od.replay(SYSTEM, log, wide, disturbance_psd=PSD, along="truth", restarts=2, active=others)
        near = min(left_out.windows, key=lambda other: abs(other.first - window.first))
        assert near.first == pytest.approx(window.first, abs=0.2)
        assert window.growth[s] == pytest.approx(near.predicted / window.predicted, rel=0.1)
    assert all((window.growth >= 1 - 1e-9).all() for window in found.windows)


def test_what_is_hidden_is_told_with_the_samples_that_arrived():
    log = drive()
    is_late = log.samples.t >= 50.0
    one = od.Log(log.inputs, log.samples.where(is_late | (log.samples.sensor == 1)), log.truth)
    found = od.replay(SYSTEM, one, PRIOR, disturbance_psd=PSD, along="truth")
    assert [bool(window.hidden) for window in found.windows] == [True] * 5 + [False] * 5
    assert found.windows[0].hidden == "rotation of everything about the beacon at (0, 50) m: x, y, heading turn together"
    assert np.isinf(found.windows[0].plain) and np.isfinite(found.windows[-1].plain)
    silent = od.Log(log.inputs, log.samples.where(is_late), log.truth)
    assert found.hidden_windows and "no sample arrived" in od.replay(SYSTEM, silent, PRIOR, disturbance_psd=PSD).windows[0].hidden


def test_a_schedule_is_of_the_samples_that_arrived_and_replays():
    log = drive(steps=200)
    found = od.replay(SYSTEM, log, PRIOR, disturbance_psd=PSD, along="truth")
    schedule = found.schedule(segment=10.0, step=1.0)
    assert schedule.chosen.shape == (5, 4) and schedule.bound <= schedule.value * (1 + 1e-9)
    chosen = od.replay(SYSTEM, log, PRIOR, disturbance_psd=PSD, along="truth", active=schedule)
    assert len(chosen.question.log.samples.t) < len(log.samples.t) and chosen.rmse > found.rmse * 0.9
    by_name = od.replay(SYSTEM, log, PRIOR, disturbance_psd=PSD, active=NAMES[:2])
    by_mask = od.replay(SYSTEM, log, PRIOR, disturbance_psd=PSD, active=log.samples.sensor < 2)
    assert by_name.estimate == pytest.approx(by_mask.estimate, abs=1e-12)


def test_a_filter_that_is_locked_out_is_told_from_when_to_when():
    log = drive()
    wrong = od.Prior([8.0, -8.0, 0.3], std=(0.05, 0.05, 0.02))
    found = od.replay(SYSTEM, log, wrong, disturbance_psd=PSD)
    assert found.locked_out and all(0 <= stretch.first < stretch.last <= 100 for stretch in found.locked_out)
    assert found.rejections == found.run.rejected.sum() > 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": 0.0}, "window is 0.0: must be a finite number above 0"),
        ({"about": ("x", "wind_x")}, "about: the system has no 'wind_x'"),
        ({"about": ()}, "about is empty"),
        ({"restarts": -1}, "restarts is -1"),
        ({"along": "path"}, "along is 'path': must be one of 'truth', 'estimate'"),
        ({"active": np.ones(3)}, r"active has shape \(3,\)"),
        ({"active": ("beacon_9",)}, "active: the log's sensors has no 'beacon_9'"),
        ({"gate": 1.5}, "probability is 1.5"),
    ],
)
def test_what_cannot_be_meant_is_refused_by_name(options, message):
    with pytest.raises(od.InputError, match=message):
        od.replay(SYSTEM, drive(steps=20), PRIOR, disturbance_psd=PSD, **options)
