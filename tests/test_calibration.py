"""A log tells what made it: coverage of intervals over seeded logs, with truth and without, and what no log can tell."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

import obsdesign as od
from obsdesign.calibration import from_log
from obsdesign.calibration.likelihood import FilterRows, LogLikelihood
from obsdesign.calibration.maximum import most_likely, reach_of
from obsdesign.calibration.parameters import Parameter, Quantity, Values, driven_states, sensor_parameters
from obsdesign.calibration.truth_residuals import correlation_of, told_of_size
from obsdesign.logs.events import events_of

BEACONS = {"a": (0.0, 0.0), "b": (40.0, 5.0), "c": (15.0, 35.0)}
TRUE = {
    "sigma of a": 0.2,
    "sigma of b": 0.4,
    "sigma of c": 0.3,
    "bias of a": 0.6,
    "bias of b": 0.0,
    "bias of c": 0.0,
    "scale of a": 1.0,
    "scale of b": 1.0,
    "scale of c": 1.05,
    "bias of the input of speed": 0.2,
    "scale of the input of speed": 1.0,
    "bias of the input of turn_rate": -0.02,
    "scale of the input of turn_rate": 1.0,
    "input_psd of speed": 0.02,
    "input_psd of turn_rate": 4e-4,
}


KNOWN = (
    (Parameter(Quantity.SIGMA, "a", (0,), 1.0, 1.0), 0.2 / 0.7),
    (Parameter(Quantity.SIGMA, "b", (1,), 1.0, 1.0), 0.4 / 0.7),
    (Parameter(Quantity.SIGMA, "c", (2,), 1.0, 1.0), 0.3 / 0.7),
    (Parameter(Quantity.BIAS, "a", (0,), 0.0, 1.0), 0.6),
    (Parameter(Quantity.SCALE, "c", (2,), 1.0, 1.0), 1.05),
    (Parameter(Quantity.INPUT_BIAS, "speed", (0,), 0.0, 1.0), 0.2),
    (Parameter(Quantity.INPUT_BIAS, "turn_rate", (1,), 0.0, 1.0), -0.02),
)


def stated(sigma: float = 0.7) -> od.System:
    return od.System(od.Unicycle(), tuple(od.Range(place, sigma, name=name) for name, place in BEACONS.items()))


@dataclass(frozen=True)
class Drive:
    """A recorded run whose every number is known, and a prior of its start."""

    log: od.Log
    prior: od.Prior


def drive(seed: int, seconds: float = 240.0, correlation: float = 0.0, bias: float = 0.6, scale: float = 1.05) -> Drive:
    """Twenty metres about (20, 15) at 2 m/s, turning this way and that; ranges at odd times; truth at each step."""
    random, dt = np.random.default_rng(seed), 0.4
    steps = round(seconds / dt)
    t = np.arange(steps + 1) * dt
    u = np.column_stack([2.0 + 0.8 * np.sin(0.21 * t[:-1]), 0.25 + 0.35 * np.sin(0.13 * t[:-1])])
    noise = random.standard_normal((steps, 2)) * np.sqrt(np.array([0.02, 4e-4]) / dt)
    path = od.simulate(stated(), [12.0, 10.0, 0.0], u + noise, dt)
    read = u + np.array([0.2, -0.02])
    times = np.sort(random.uniform(0.0, seconds, steps))
    sensor = np.arange(steps) % 3
    places = np.array(list(BEACONS.values()))[sensor]
    x = np.column_stack([np.interp(times, t, path.x[:, i]) for i in (0, 1)])
    white = random.standard_normal(steps)
    for k in range(3, steps):  # errors of successive samples of a sensor
        white[k] = correlation * white[k - 3] + np.sqrt(1 - correlation**2) * white[k]
    errors = np.array([0.2, 0.4, 0.3])[sensor] * white
    y = np.array([1.0, 1.0, scale])[sensor] * np.hypot(*(x - places).T) + np.array([bias, 0.0, 0.0])[sensor] + errors
    truth = od.LogTruth(("x", "y", "heading"), t, path.x + random.standard_normal(path.x.shape) * np.array([0.02, 0.02, 0.002]))
    log = od.Log(od.LogInputs(("speed", "turn_rate"), t[:-1], read), od.LogSamples(tuple(BEACONS), times, sensor, y), truth)
    start = path.x[0] + random.standard_normal(3) * np.array([0.5, 0.5, 0.05])
    return Drive(log, od.Prior(start, std=(0.5, 0.5, 0.05)))


def without_truth(log: od.Log) -> od.Log:
    return od.Log(log.inputs, log.samples)


@pytest.mark.parametrize("has_truth", [True, False], ids=["truth", "innovations"])
def test_intervals_hold_what_made_the_log(has_truth: bool):
    """95 % intervals of 15 numbers in 3 logs: of 45, 38 and more are held in all but one of 300 experiments (binomial)."""
    held = []
    for seed in range(3):
        run = drive(seed)
        fit = od.calibrate(stated(), run.log if has_truth else without_truth(run.log), run.prior)
        held += [fit.number(name).low <= value <= fit.number(name).high for name, value in TRUE.items()]
        assert {fit.number(name).source for name in TRUE} == {"truth" if has_truth else "innovations"}
        assert fit.number("scale of c").value == pytest.approx(1.05, abs=0.01)
        assert (fit.number("input_psd of speed").unit, fit.number("disturbance_psd of x and y").unit) == ("(m/s)^2 s", "m^2/s")
    assert sum(held) >= 38


def test_a_filter_with_what_was_found_is_as_good_as_one_that_knows():
    run = drive(7)
    fit = od.calibrate(stated(), without_truth(run.log), run.prior)
    knowing = Values(tuple(p for p, _ in KNOWN), np.array([value for _, value in KNOWN])).system(stated())
    knows = rms_error(run, knowing, input_psd={"speed": 0.02, "turn_rate": 4e-4})
    assert rms_error(run, fit.system, **psds_of(fit)) < 1.1 * knows
    assert rms_error(run, stated(), disturbance_psd=(0.1, 0.1, 0.01)) > 1.5 * knows


def with_outliers(run: Drive, share: float, seed: int) -> Drive:
    """The drive with some ranges off by 10 to 100 standard deviations."""
    random, samples = np.random.default_rng(1000 + seed), run.log.samples
    jumps = np.array([0.2, 0.4, 0.3])[samples.sensor] * random.uniform(10, 100, len(samples.t)) * random.choice([-1, 1], len(samples.t))
    y = samples.y + np.where(random.random(len(samples.t)) < share, jumps, 0.0)[:, None]
    return Drive(od.Log(run.log.inputs, od.LogSamples(samples.names, samples.t, samples.sensor, y), run.log.truth), run.prior)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "has_truth"), [(0.0, False), (0.05, False), (0.1, False), (0.05, True)])
def test_intervals_hold_95_percent_with_outliers_as_without(share: float, has_truth: bool):
    """15 numbers of 60 short logs, which tell of each barely: 95 %, less what psds of ten stretches lack to be normal."""
    held = []
    for seed in range(60):
        run = with_outliers(drive(seed, seconds=100.0), share, seed)
        fit = od.calibrate(stated(), run.log if has_truth else without_truth(run.log), run.prior)
        held += [fit.number(name).low <= value <= fit.number(name).high for name, value in TRUE.items()]
    assert np.mean(held) >= 0.9


def test_an_outlier_is_no_error_like_any():
    """One range in 50 s is 30 m off: the filter with what was found is as good as the one with what is found without that range."""
    run = drive(2, seconds=50.0, bias=0.0, scale=1.0)
    samples, y = run.log.samples, run.log.samples.y.copy()
    y[60] += 30.0
    spoilt = od.Log(run.log.inputs, od.LogSamples(samples.names, samples.t, samples.sensor, y))
    rest = od.Log(run.log.inputs, samples.where(np.arange(len(y)) != 60))
    fit, expected = (od.calibrate(stated(), log, run.prior) for log in (spoilt, rest))
    assert fit.number("sigma of a, b, c").value == pytest.approx(expected.number("sigma of a, b, c").value, rel=1e-2)
    gated = od.ExtendedKalmanFilter(gate=od.Gate())
    whole = od.Log(spoilt.inputs, spoilt.samples, run.log.truth)
    assert rms_error(Drive(whole, run.prior), fit.system, estimator=gated, **psds_of(fit)) < 1.0


def test_a_tenth_of_outliers_makes_no_standard_deviation_larger():
    random = np.random.default_rng(3)
    errors = 0.5 * random.standard_normal(20_000)
    errors[:2000] += random.uniform(10, 100, 2000)
    told = told_of_size(Parameter(Quantity.SIGMA, "a", (0,), 1.0, 1.0), [errors])[0]
    assert told.low < 0.5 < told.high


def psds_of(fit: od.Calibration) -> dict[str, object]:
    return {"disturbance_psd": fit.disturbance_psd, "input_psd": fit.input_psd}


def rms_error(run: Drive, system: object, **psds: object) -> float:
    """Root mean square position error of a filter over the second half [m]."""
    estimate = od.estimate_log(system, run.log, run.prior, **psds)  # pyright: ignore
    assert run.log.truth is not None
    error = estimate.mean[:, :2] - run.log.truth.at(estimate.t)[:, :2]
    return float(np.sqrt(np.nanmean(np.sum(error[len(error) // 2 :] ** 2, axis=1))))


@pytest.mark.parametrize("has_truth", [True, False], ids=["truth", "innovations"])
def test_errors_that_last_become_inflation(has_truth: bool):
    # white errors weigh as much at frequency 0 with (1 + phi) / (1 - phi) times the variance
    run = drive(1, correlation=0.8)
    fit = od.calibrate(stated(), run.log if has_truth else without_truth(run.log), run.prior)
    inflation = fit.number("inflation of a") if has_truth else fit.number("inflation of b")
    assert 1.5 < inflation.value < 1.5 * np.sqrt(1.8 / 0.2)
    if has_truth:
        assert inflation.value == pytest.approx(3.0, rel=0.3)


def test_the_correlation_is_that_of_the_errors_whatever_outliers_say():
    random, x = np.random.default_rng(0), np.zeros(4000)
    for k in range(1, 4000):
        x[k] = 0.7 * x[k - 1] + random.standard_normal()
    x[::100] += 50.0
    assert correlation_of(x) == pytest.approx(0.7, abs=0.05)


def test_sensors_with_few_samples_are_one_where_they_are_of_one_kind():
    run = drive(2, seconds=50.0, bias=0.0, scale=1.0)
    fit = od.calibrate(stated(), run.log, run.prior)
    assert fit.number("sigma of a, b, c").value == pytest.approx(0.3, rel=0.4)


def test_of_a_long_log_the_beginning_is_listened_to(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(from_log, "_MOST_UPDATES", 15 * 3 * 120)
    run = drive(6)
    fit = od.calibrate(stated(), without_truth(run.log), run.prior)
    assert any(note.startswith("innovations are those of the first") for note in fit.notes)
    assert fit.number("sigma of a").low <= 0.2 <= fit.number("sigma of a").high


def test_inputs_that_are_read_often_are_averaged_and_keep_their_integrals():
    t = np.arange(2000) * 0.01
    inputs = od.LogInputs(("speed", "turn_rate"), t, np.column_stack([np.sin(t), np.cos(3 * t)]))
    log = od.Log(inputs, od.LogSamples(tuple(BEACONS), np.array([1.0, 7.3]), np.array([0, 1]), np.array([3.0, 4.0])))
    coarse = from_log._with_coarse_inputs(log, 0.2)
    assert coarse.inputs is not None and len(coarse.inputs.t) <= 101
    nodes = np.append(coarse.inputs.t[:90:7], coarse.inputs.t[95])
    np.testing.assert_allclose(coarse.inputs.integrals(nodes), inputs.integrals(nodes), rtol=1e-9, atol=1e-12)


def test_landmarks_that_are_many_are_one():
    system = od.System(od.Unicycle(), tuple(od.Range((5.0 * i, 40.0), 0.5, name=f"tree_{i}") for i in range(9)))
    counts = {f"tree_{i}": 500 for i in range(9)}
    spreads = {name: np.array([0.5]) for name in counts}
    names = [p.name for p in sensor_parameters(system.model, spreads, dict.fromkeys(counts, False), counts)]
    assert names == [f"{what} of tree_0 and 8 of its kind" for what in ("bias", "scale", "sigma")]


def test_what_the_data_do_not_tell_is_said():
    run, extra = drive(3, seconds=90.0), od.Range((90.0, 90.0), 0.7, name="d")
    compass = od.System(od.Unicycle(), (od.Magnetometer(0.1), extra))
    t = np.arange(0.0, 80.0, 0.5)
    heading = np.interp(t, run.log.truth.t, np.unwrap(run.log.truth.x[:, 2]))  # pyright: ignore
    log = od.Log(run.log.inputs, od.LogSamples(("magnetometer", "d"), t, np.zeros(len(t)), heading))
    fit = od.calibrate(compass, log, run.prior)
    for name in ("scale of the input of speed", "bias of the input of speed"):
        assert not fit.number(name).is_told and fit.number(name).high == np.inf
    assert fit.number("input_psd of turn_rate").is_told
    assert any("d: no sample" in note for note in fit.notes)
    assert any("do not tell" in note and "scale of the input of speed" in note for note in fit.notes)
    assert "input_psd of turn_rate" in repr(fit)
    with pytest.raises(od.InputError, match="sigma of magnetometer"):
        fit.number("sigma of magnetomter")


def test_one_sample_tells_of_no_standard_deviation():
    run = drive(5, seconds=20.0)
    fit = od.calibrate(stated(), od.Log(run.log.inputs, run.log.samples.where(np.arange(50) == 7)), run.prior)
    assert not any(number.is_told for number in fit.numbers if number.name.startswith(("sigma", "scale", "input_psd", "disturbance_psd")))
    assert fit.disturbance_psd == (0.0, 0.0, 0.0) and not fit.input_psd


def test_landmarks_in_range_and_bearing_tell_of_each_output():
    """With true states nothing is left to the innovations but scales that turn out to be none."""
    random, u = np.random.default_rng(0), np.tile([1.0, 0.1], (300, 1))
    places = np.array([(20.0, 5.0), (-5.0, 15.0)])
    sensors = tuple(od.RangeBearing((x, y), 0.5, bearing_sigma=0.1, name=f"tree_{i}") for i, (x, y) in enumerate(places.tolist()))
    path = od.simulate(od.System(od.Unicycle(), sensors), [0.0, 0.0, 0.0], u + random.standard_normal((300, 2)) * [0.1, 0.02], 0.5)
    sensor = np.arange(300) % 2
    offset = places[sensor] - path.x[:-1, :2]
    distance = 1.02 * np.hypot(*offset.T) + random.standard_normal(300) * 0.2
    angle = np.arctan2(offset[:, 1], offset[:, 0]) - path.x[:-1, 2] + 0.05 + random.standard_normal(300) * 0.03
    samples = od.LogSamples(("tree_0", "tree_1"), path.t[:-1], sensor, np.column_stack([distance, np.angle(np.exp(1j * angle))]))
    log = od.Log(od.LogInputs(("speed", "turn_rate"), path.t[:-1], u), samples, od.LogTruth(("x", "y", "heading"), path.t, path.x))
    fit = od.calibrate(od.System(od.Unicycle(), sensors), log, od.Prior(path.x[0], std=(1.0, 1.0, 0.1)))
    for i in (0, 1):
        assert fit.number(f"scale of tree_{i}_distance").value == pytest.approx(1.02, abs=0.01)
        assert fit.number(f"bias of tree_{i}_angle").value == pytest.approx(0.05, abs=0.01)
        assert fit.number(f"sigma of tree_{i}_distance").value == pytest.approx(0.2, rel=0.3)
        assert fit.number(f"sigma of tree_{i}_angle").value == pytest.approx(0.03, rel=0.3)


def test_truth_that_was_made_of_the_readings_tells_nothing_of_them():
    run = drive(4)
    assert run.log.truth is not None and run.log.inputs is not None
    t = run.log.truth.t
    turned = np.append(0.0, np.cumsum(run.log.inputs.over(t)[:, 1] * np.diff(t)))
    copied = od.LogTruth(run.log.truth.names, t, np.column_stack([run.log.truth.x[:, :2], turned]))
    fit = od.calibrate(stated(), od.Log(run.log.inputs, run.log.samples, copied), run.prior)
    turn = fit.number("input_psd of turn_rate")  # of the true positions
    assert turn.low <= 4e-4 <= turn.high


# ---------------------------------------------------------------- the likelihood


def linear_likelihood() -> tuple[LogLikelihood, od.ControlAffineSystem, np.ndarray]:
    """Four steps of a cart with three samples of its place, one of its speed."""
    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(
        state=x,
        names=("p", "v"),
        drift=ca.vertcat(x[1], 0),
        known={"u": ca.SX([0.0, 1.0])},
        unknown={},
        outputs={"place": x[0], "rate": x[1]},
        sigmas={"place": 0.5, "rate": 0.2},
    )
    lengths, u = np.array([0.5, 0.2, 0.7, 0.4]), np.array([0.3, -0.2, 0.5, 0.1])
    y = np.random.default_rng(0).standard_normal((4, 2))
    weights = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 0.0], [1.0, 0.0]])
    recording = FilterRows(np.column_stack([lengths, lengths * u]), y, weights)
    free = (
        Parameter(Quantity.SIGMA, "place", (0,), 1.0, 1.0),
        Parameter(Quantity.BIAS, "place", (0,), 0.0, 1.0),
        Parameter(Quantity.SCALE, "place", (0,), 1.0, 0.5),
        Parameter(Quantity.INPUT_BIAS, "u", (0,), 0.0, 1.0),
        Parameter(Quantity.INPUT_SCALE, "u", (0,), 1.0, 0.5),
        Parameter(Quantity.INPUT_PSD, "u", (0,), 0.3, 1.0),
    )
    prior = od.Prior([0.2, 0.5], std=(1.0, 0.4))
    return LogLikelihood(system, recording, prior, free, Values((), np.zeros(0))), system, lengths


def joint_density(likelihood: LogLikelihood, z: np.ndarray) -> float:
    """-log p of all samples at once: y = A (x_0, noises) + errors, by hand."""
    from scipy.stats import multivariate_normal

    values = {p.quantity: float(p.value(value)) for p, value in zip(likelihood.free, z, strict=True)}
    rows = likelihood.recording
    mean, columns = np.array([0.2, 0.5]), np.diag([1.0, 0.4])
    means, maps, variances, samples = [], [], [], []
    for k in range(4):
        for j, (scale, bias, sigma) in enumerate(
            [(values[Quantity.SCALE], values[Quantity.BIAS], 0.5 * values[Quantity.SIGMA]), (1.0, 0.0, 0.2)]
        ):
            if rows.weights[k, j]:
                means.append(scale * mean[j] + bias)
                maps.append(scale * columns[j])
                variances.append(sigma**2)
                samples.append(rows.y[k, j])
        dt, integral = rows.rows[k]
        F, b = np.array([[1.0, dt], [0.0, 1.0]]), np.array([dt / 2, 1.0])
        mean = F @ mean + b * (integral - values[Quantity.INPUT_BIAS] * dt) / values[Quantity.INPUT_SCALE]
        columns = np.column_stack([F @ columns, b * np.sqrt(values[Quantity.INPUT_PSD] * dt)])
    A = np.zeros((len(maps), columns.shape[1]))
    for i, row in enumerate(maps):
        A[i, : len(row)] = row
    density = multivariate_normal(np.array(means), A @ A.T + np.diag(variances)).logpdf(np.array(samples))
    return float(-density - 0.5 * len(samples) * np.log(2 * np.pi) + 0.5 * z @ z)


def test_the_likelihood_of_innovations_is_that_of_all_samples_at_once():
    likelihood, _, _ = linear_likelihood()
    for z in (np.zeros(6), np.array([0.3, -0.4, 0.2, 0.5, -0.3, 0.6])):
        point = likelihood.at(z)
        assert point.value == pytest.approx(joint_density(likelihood, z), rel=1e-9)
        steps = 1e-5 * np.eye(6)
        slope = [(joint_density(likelihood, z + step) - joint_density(likelihood, z - step)) / 2e-5 for step in steps]
        np.testing.assert_allclose(point.slope, slope, rtol=2e-3, atol=2e-3)


@pytest.mark.parametrize("corrections", [(), (Quantity.BIAS,), (Quantity.BIAS, Quantity.SCALE)])
def test_what_biases_explain_by_chance_is_not_taken_for_smaller_errors(corrections: tuple[Quantity, ...]):
    """Of a line of p numbers through N points: sigma^2 is the squares of what is left over N - p, log sigma has 2 (N - p).

    The numbers lie within Student's quantiles with N - p degrees of freedom.
    """
    from scipy.stats import t

    x = ca.SX.sym("x", 1)
    system = od.ControlAffineSystem(
        state=x, names=("p",), drift=ca.SX([1.0]), known={}, unknown={}, outputs={"place": x[0]}, sigmas={"place": 0.5}
    )
    y = np.arange(12.0)[:, None] - 5.5 + 0.3 + np.random.default_rng(0).standard_normal((12, 1))
    free = (*(Parameter(quantity, "place", (0,), float(quantity is Quantity.SCALE), 1e3) for quantity in corrections),)
    free = (Parameter(Quantity.SIGMA, "place", (0,), 1.0, 5.0), *free)  # nothing is known beforehand
    recording, prior = FilterRows(np.ones((12, 1)), y, np.ones((12, 1))), od.Prior([-5.5], std=(1e-9,))
    likelihood, peak = most_likely(LogLikelihood(system, recording, prior, free, Values((), np.zeros(0))))
    A = np.column_stack([np.ones(12), np.arange(12.0) - 5.5])[:, : len(corrections)]
    target = y[:, 0] - (np.arange(12.0) - 5.5)
    rest, count = target - A @ np.linalg.lstsq(A, target, rcond=None)[0], 12 - len(corrections)
    assert 0.5 * free[0].value(peak.z[0]) == pytest.approx(np.sqrt(rest @ rest / count), rel=2e-3)
    assert peak.std[0] * 5 == pytest.approx(1 / np.sqrt(2 * count), rel=2e-3)
    assert reach_of(likelihood, peak)[1:] == pytest.approx(t.ppf(0.975, count), rel=2e-3)


def test_the_system_with_values_reads_and_moves_as_the_likelihood_takes_it():
    """The filter of that system on the raw log has the innovations that the likelihood has."""
    run = drive(5, seconds=20.0)
    base = stated()
    free = (
        Parameter(Quantity.SIGMA, "a", (0,), 1.0, 1.0),
        Parameter(Quantity.BIAS, "b", (1,), 0.0, 1.0),
        Parameter(Quantity.SCALE, "c", (2,), 1.0, 1.0),
        Parameter(Quantity.INPUT_BIAS, "speed", (0,), 0.0, 1.0),
        Parameter(Quantity.INPUT_SCALE, "turn_rate", (1,), 1.0, 1.0),
        Parameter(Quantity.INPUT_PSD, "speed", (0,), 0.02, 1.0),
        Parameter(Quantity.STATE_PSD, "x and y", (0, 1), 0.01, 1.0),
    )
    z = np.array([-0.5, 0.3, 0.04, 0.1, 0.05, 0.2, -0.3])
    events = events_of(base, run.log)
    recording = FilterRows(events.rows, events.y, events.arrived.astype(float))
    likelihood = LogLikelihood(base, recording, run.prior, free, Values((), np.zeros(0)))
    values = Values(free, np.array([float(p.value(value)) for p, value in zip(free, z, strict=True)]))
    disturbance_psd, input_psd = values.psds(base.model)
    system = values.system(base)
    estimate = od.estimate_log(system, run.log, run.prior, disturbance_psd=disturbance_psd, input_psd=input_psd)
    np.testing.assert_allclose(
        estimate.innovations / estimate.innovation_std, likelihood.innovations_at(z), rtol=0, atol=1e-4
    )  # steps are right to 1e-6 of 40 m
    verdict = od.observability(system)  # it is a system like any
    assert verdict.observable


# ---------------------------------------------------------------- which noise there may be


def test_states_have_noise_where_nothing_moves_them_or_no_noise_would_come():
    names = lambda system: {tuple(system.model.state_names[i] for i in group) for group in driven_states(system.model)}  # noqa: E731
    gps = (od.GPS(1.0),)
    assert names(od.System(od.Unicycle(), gps)) == {("x", "y")}
    assert names(od.System(od.Dubins(5.0, wind="constant"), gps)) == {("wind_x",), ("wind_y",), ("x", "y")}
    x = ca.SX.sym("x", 2)
    cart = {"state": x, "names": ("p", "v"), "unknown": {}, "outputs": {"p": x[0]}, "sigmas": {"p": 1.0}}
    driven = od.ControlAffineSystem(drift=ca.vertcat(x[1], 0), known={"u": ca.SX([0.0, 1.0])}, **cart)  # pyright: ignore
    free = od.ControlAffineSystem(drift=ca.vertcat(x[1], -x[1]), known={}, **cart)  # pyright: ignore
    assert names(driven) == set()
    assert len(names(free)) >= 1  # at least what reaches both


def test_biases_and_scales_that_are_states_are_left_to_the_filter():
    ranges = (od.Range((0.0, 0.0), 0.7, name="a", bias="offset"), od.Range((40.0, 5.0), 0.7, name="b", scale="stretch"))
    system = od.System(od.Unicycle(), ranges)
    counts = {"a": 90, "b": 90}
    parameters = sensor_parameters(system.model, {name: np.array([0.7]) for name in counts}, dict.fromkeys(counts, False), counts)
    assert {p.name for p in parameters} == {"scale of a", "sigma of a", "bias of b", "sigma of b"}


def test_a_prior_of_other_states_is_refused():
    run = drive(0, seconds=8.0)
    with pytest.raises(od.InputError, match="prior has 2 states"):
        od.calibrate(stated(), run.log, od.Prior([0.0, 0.0], std=(1.0, 1.0)))
