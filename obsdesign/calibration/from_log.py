"""The calibration of a system by a log."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.calibration.calibration_record import CalibratedNumber, Calibration
from obsdesign.calibration.likelihood import FilterRows, LogLikelihood
from obsdesign.calibration.maximum import Maximum, Told, maximum, most_likely, reach_of, told_of, without_what_is_not_there
from obsdesign.calibration.parameters import Parameter, Quantity, Values, motion_parameters, sensor_parameters
from obsdesign.calibration.truth_residuals import told_by_residuals, told_of_size
from obsdesign.calibration.truth_sensors import TruthSensors, log_of_truth
from obsdesign.dynamics.calibrated_system import CalibratedSystem, OutputFit, SensorFit
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.simulation import readings
from obsdesign.estimation.filter_run import require_prior
from obsdesign.estimation.log_run import sample_weights
from obsdesign.logs.events import events_of
from obsdesign.logs.inputs import LogInputs
from obsdesign.logs.log import Log
from obsdesign.prior import Prior

_TRUTH_SPACING = 10.0  # s: over less, errors of inputs that last look smaller than they are
_LEAST_TRUTHS = 8  # stretches of truth; innovations tell of shorter logs
_TRUTH_STEP, _SAMPLE_STEP = 0.2, 0.1  # s, over which inputs that are read more often are averaged, between truths and between samples
_MOST_UPDATES = 2.5e6  # outputs that all runs of a likelihood take in together; of a longer log its beginning
_NO_NOISE = 1e-5  # of the psd that is looked for at first: less has no sensor that measures an input
_TRUTH_SIGMA = 0.1  # of the prior's standard deviations: how well truth is known, to begin with


@dataclass(frozen=True, eq=False)
class _Source:
    """What was told, and by what."""

    told: tuple[Told, ...]
    source: str
    note: str = ""


@validate_arguments
def calibrate(system: AbstractSystem, log: Log, prior: Prior) -> Calibration:
    """Find standard deviations, biases and scales of sensors and inputs, and process noise, with which a log is most likely.

    Where the truth tells the states that a sensor reads, a line through its residuals and their median absolute deviation; the correlation
    of successive residuals becomes its inflation. Inputs and process noise: by maximum likelihood of the true states ten seconds apart
    given those before. What truth does not tell, and in logs below 80 s: by maximum likelihood of the innovations of an EKF, of a very
    long log those of its beginning. Biases and scales are taken where their 95 % interval does not hold none,
    Student's where noise is estimated from little.

    Arguments:
        system: vehicle and sensors; sigmas as far as they are known, to begin with.
        log: the recorded run, or its part that may be looked at, `log.first(0.5)`.
        prior: what is known of the state at the log's beginning.
    Raises InputError for a log that is not of this system. Source of the likelihood: Schweppe (1965), IEEE Trans. Inf. Theory 11, 61-70.
    """
    require_prior(system, prior)
    system = _without_inflation(system, log)
    events = events_of(system, log)
    lengths = np.maximum(events.lengths, 1e-12)
    duration = float(events.lengths.sum())
    sizes = np.sqrt(np.sum(events.increments**2 / lengths[:, None], axis=0) / duration)
    of_sensors = tuple(_parameters_of_sensors(system, log, prior))
    of_motion = tuple(motion_parameters(system.model, sizes, prior.std, duration))
    by_truth = [
        _Source(told_by_residuals(system, log, of_sensors), "truth"),
        _Source(_told_by_truth(system, log, prior, of_motion), "truth"),
    ]
    parameters = (*of_sensors, *of_motion)
    return _calibration(system, parameters, (*by_truth, _told_by_innovations(system, log, prior, parameters, by_truth)), log, prior)


def _without_inflation(system: AbstractSystem, log: Log) -> AbstractSystem:
    """Return the system whose sensors with samples have no inflation as long as the data do not say so."""
    counts, outputs_of = log.samples.counts, system.model.outputs_of
    sensors = tuple(
        SensorFit(channel.name, (OutputFit(),) * len(outputs_of[channel.name]), 1 / channel.noise.inflation)
        for channel in system.model.channels
        if channel.noise.inflation != 1 and channel.noise.is_white and counts.get(channel.name, 0)
    )
    return CalibratedSystem(system, sensors) if sensors else system


def _parameters_of_sensors(system: AbstractSystem, log: Log, prior: Prior) -> Iterable[Parameter]:
    counts, model = log.samples.counts, system.model
    at_start = readings(system, prior.mean[None, None])
    spreads, own_sigmas = {}, {}
    for name, outputs in model.outputs_of.items():
        if counts.get(name, 0):
            spreads[name] = at_start.spread[0, 0, list(outputs)]
            own = log.samples.sigma
            chosen = log.samples.sensor == log.samples.names.index(name)
            own_sigmas[name] = own is not None and bool(np.isfinite(own[chosen]).any())
    return sensor_parameters(model, spreads, own_sigmas, counts)


def _told_by_truth(system: AbstractSystem, log: Log, prior: Prior, parameters: tuple[Parameter, ...]) -> tuple[Told, ...]:
    """Return what true states some time apart tell of inputs and process noise."""
    first, last = log.span
    truth = log_of_truth(system.model, log, _TRUTH_SPACING) if last - first >= _LEAST_TRUTHS * _TRUTH_SPACING else None
    while truth is not None and parameters:
        told = _told_by_samples_of_truth(system, truth, prior, parameters)
        copies = _copies(system.model, told)
        if not copies & set(truth.samples.names):
            return told
        truth = _without(truth, copies)
    return ()


def _told_by_samples_of_truth(system: AbstractSystem, truth: Log, prior: Prior, parameters: tuple[Parameter, ...]) -> tuple[Told, ...]:
    names = tuple(name.removeprefix("truth of ") for name in truth.samples.names)
    stated = tuple(_TRUTH_SIGMA * float(prior.std[system.model.state_names.index(name)]) for name in names)
    watched, truth = TruthSensors(system, names, stated), _with_coarse_inputs(truth, _TRUTH_STEP)
    sigmas = tuple(Parameter(Quantity.SIGMA, f"the truth of {name}", (j,), 1.0, 2.3) for j, name in enumerate(names))
    events = events_of(watched, truth)
    recording = FilterRows(events.rows, events.y, sample_weights(watched, events))
    told, *_ = _fit(LogLikelihood(watched, recording, prior, (*parameters, *sigmas), Values((), np.zeros(0))), may_have_outliers=False)
    return tuple(fact for fact in told if fact.is_told and fact.parameter in parameters)


def _with_coarse_inputs(log: Log, step: float) -> Log:
    """Return the log with the means of inputs over steps of that length [s], where they were read more than twice as often."""
    if log.inputs is None or len(log.inputs.t) < 2 or np.median(np.diff(log.inputs.t)) > step / 2:
        return log
    times = np.arange(log.inputs.t[0], log.inputs.t[-1] + step, step)
    return Log(LogInputs(log.inputs.names, times[:-1], log.inputs.over(times)), log.samples, log.truth)


def _copies(model: Model, told: tuple[Told, ...]) -> set[str]:
    """Return the true states that an input moves without any noise: they were made of its readings, and tell nothing of these."""
    import casadi as ca

    moved: set[str] = set()
    for fact in told:
        if fact.parameter.quantity is Quantity.INPUT_PSD and fact.value < _NO_NOISE * fact.parameter.start:
            column = ca.sparsify(model.B[:, fact.parameter.places[0]])
            moved |= {f"truth of {model.state_names[i]}" for i in column.sparsity().row()}
    return moved


def _without(truth: Log, names: set[str]) -> Log | None:
    samples = truth.samples.only([name for name in truth.samples.names if name not in names])
    return Log(truth.inputs, samples) if len(samples.t) else None


def _told_by_innovations(
    system: AbstractSystem, log: Log, prior: Prior, parameters: tuple[Parameter, ...], earlier: list[_Source]
) -> _Source:
    """Return what is told of the parameters that nothing has told of yet; of a long log its beginning is listened to."""
    facts = [fact for source in earlier for fact in source.told]
    free = tuple(p for p in parameters if p not in [fact.parameter for fact in facts])
    events = events_of(system, _with_coarse_inputs(log, _SAMPLE_STEP))
    steps = max(1, int(_MOST_UPDATES / ((len(free) + 1) * events.y.shape[1])))
    recording = FilterRows(events.rows[:steps], events.y[:steps], sample_weights(system, events)[:steps])
    if not free or not recording.weights.any():
        return _Source((), "innovations")
    note = f"innovations are those of the first {events.t[steps] - events.t[0]:.0f} s" if steps < len(events.y) else ""
    fixed = Values(tuple(fact.parameter for fact in facts), np.array([fact.value for fact in facts]))
    told, likelihood, peak = _fit(LogLikelihood(system, recording, prior, free, fixed))
    return _Source((*told, *_lasting_innovations(likelihood, peak.z)), "innovations", note)


def _lasting_innovations(likelihood: LogLikelihood, z: np.ndarray) -> Iterable[Told]:
    """Yield the inflation of sensors whose innovations are correlated from sample to sample by more than chance."""
    innovations = likelihood.innovations_at(z)
    for parameter in likelihood.free:
        if parameter.quantity is Quantity.SIGMA:
            rests = [innovations[np.isfinite(innovations[:, j]), j] for j in parameter.places]
            yield from told_of_size(parameter, rests)[1:]


def _fit(likelihood: LogLikelihood, may_have_outliers: bool = True) -> tuple[tuple[Told, ...], LogLikelihood, Maximum]:
    """Return what is told of the free parameters, biases and scales left out that are not there, and the maximum of the others.

    Intervals are those of all parameters at once: which biases and scales are there is told by the same data.
    """
    trimmed, peak = most_likely(likelihood, may_have_outliers)
    reach = reach_of(trimmed, peak)
    wide = told_of(trimmed, peak, reach)
    stays = without_what_is_not_there(likelihood.free, peak, reach)
    if stays.all():
        return wide, trimmed, peak
    narrow = trimmed.only(stays)
    peak = maximum(narrow, peak.z[stays])
    again = iter(told_of(narrow, peak, reach[stays]))
    told = tuple(fact.at(next(again)) if is_there else fact.without_effect for fact, is_there in zip(wide, stays, strict=True))
    return told, narrow, peak


def _calibration(
    system: AbstractSystem, parameters: tuple[Parameter, ...], sources: tuple[_Source, ...], log: Log, prior: Prior
) -> Calibration:
    model = system.model
    told = {fact.parameter: (fact, source.source) for source in sources for fact in source.told if fact.is_told}
    every = (*parameters, *(parameter for parameter in told if parameter not in parameters))
    used = [(p, told[p][0].value) for p in every if p in told]
    values = Values(tuple(p for p, _ in used), np.array([value for _, value in used]))
    disturbance_psd, input_psd = values.psds(model)
    spreads = readings(system, prior.mean[None, None]).spread[0, 0]
    numbers = tuple(_number(p, told.get(p), spreads, model.outputs) for p in every)
    notes = (*_notes(system, log, numbers), *(source.note for source in sources if source.note))
    return Calibration(values.system(system), tuple(disturbance_psd.tolist()), input_psd, numbers, notes)


def _number(parameter: Parameter, told: tuple[Told, str] | None, spreads: np.ndarray, outputs: tuple) -> CalibratedNumber:
    """Return a number; a sigma in the unit of its output, at the prior's mean."""
    is_sigma = parameter.quantity is Quantity.SIGMA
    unit = outputs[parameter.places[0]].unit if is_sigma else parameter.unit
    factor = float(spreads[parameter.places[0]]) if is_sigma else 1.0
    if told is None:
        is_psd = parameter.quantity in (Quantity.STATE_PSD, Quantity.INPUT_PSD)
        low = 0.0 if parameter.quantity.is_positive else -np.inf
        return CalibratedNumber(parameter.name, 0.0 if is_psd else factor * parameter.start, low, np.inf, unit, "stated")
    fact, source = told
    return CalibratedNumber(parameter.name, factor * fact.value, factor * fact.low, factor * fact.high, unit, source)


def _notes(system: AbstractSystem, log: Log, numbers: tuple[CalibratedNumber, ...]) -> Iterable[str]:
    counts = log.samples.counts
    silent = [name for name in system.model.sensor_names if not counts.get(name, 0)]
    if silent:
        yield f"{', '.join(silent)}: no sample, so that the log tells nothing of it"
    untold = [entry.name for entry in numbers if not entry.is_told]
    if untold:
        yield f"the data do not tell {', '.join(untold)}: what was stated stays, and psd is 0"
    lasting = [channel.name for channel in system.model.channels if not channel.noise.is_white]
    if lasting:
        yield f"{', '.join(lasting)}: errors that last stay as stated"
