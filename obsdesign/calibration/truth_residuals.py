"""What sensors say beside the truth: biases, scales, standard deviations, and how long their errors last."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.calculus import wrap_columns
from obsdesign.calibration.maximum import NORMAL_QUANTILE, UNTOLD, Maximum, Told, without_what_is_not_there
from obsdesign.calibration.parameters import Parameter, Quantity
from obsdesign.dynamics.channel import Channel
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.simulation import readings
from obsdesign.logs.log import Log
from obsdesign.logs.truth import LogTruth

_MAD = 1.4826022185056018  # a standard deviation over a median absolute deviation
_MAD_NOISE = 1.166  # standard deviation of the logarithm of that, times the root of the number of samples
_LEAST = 8  # samples from which something is told
_ROBUST = 1.345  # standard deviations beyond which a residual counts linearly
_OUTLIER = 4.0  # standard deviations of a residual that counts no more
_CHANCE = 3.0  # over the root of their number: a correlation that is more than chance
_MOST = 0.999  # what a correlation may be
_LONGEST_GAP = 2.0  # s, over which truth is interpolated, or twice its own step


@dataclass(frozen=True, eq=False)
class Residuals:
    """Samples of one output beside what it would be at the truth (K,), and the stated standard deviation of each."""

    expected: np.ndarray
    residual: np.ndarray
    spread: np.ndarray


def residuals_of(system: AbstractSystem, log: Log) -> dict[int, Residuals]:
    """Return for each output of sensors whose states the truth tells what its samples are beside it."""
    return {j: values for channel in system.model.channels for j, values in _residuals_of_sensor(system, log, channel)}


def _residuals_of_sensor(system: AbstractSystem, log: Log, channel: Channel) -> Iterator[tuple[int, Residuals]]:
    model = system.model
    if log.truth is None or channel.name not in log.samples.names:
        return
    needed = states_of(model, channel)
    chosen = log.samples.sensor == log.samples.names.index(channel.name)
    t, y = log.samples.t[chosen], log.samples.y[chosen]
    x = _truth_at(model, log.truth, t)
    is_known = np.isfinite(x[:, [model.state_names.index(name) for name in needed]]).all(axis=1)
    if is_known.sum() < _LEAST:
        return
    at_truth = readings(system, np.nan_to_num(x[None, is_known]))
    own = np.full(len(t), np.nan) if log.samples.sigma is None else log.samples.sigma[chosen]
    for i, (j, signal) in enumerate(zip(model.outputs_of[channel.name], channel.outputs, strict=True)):
        expected, spread = at_truth.y[0, :, j], at_truth.spread[0, :, j]
        residual = wrap_columns((y[is_known, i] - expected)[:, None], np.array([signal.is_angle]))[:, 0]
        yield j, Residuals(expected, residual, np.where(np.isfinite(own[is_known]), own[is_known], spread))


def states_of(model: Model, channel: Channel) -> tuple[str, ...]:
    """Return the states that a sensor's outputs and their noise depend on."""
    depends = ca.which_depends(ca.vertcat(channel.h, channel.noise.spread), model.x, 1, False)
    return tuple(name for name, does in zip(model.state_names, depends, strict=True) if does)


def told_by_residuals(system: AbstractSystem, log: Log, parameters: tuple[Parameter, ...]) -> tuple[Told, ...]:
    """Return what residuals tell of sensors: lines by robust least squares, sigma by the median absolute deviation of what is left.

    K samples count as K (1 - rho) / (1 + rho), rho the correlation of successive residuals; where it is more than chance, inflation is
    ((1 + rho) / (1 - rho))^1/2, with which white errors weigh what these do.
    """
    residuals = residuals_of(system, log)
    tellable = tuple(p for p in parameters if set(p.places) <= set(residuals))
    rests, told = {j: values.residual / values.spread for j, values in residuals.items()}, []
    for places in dict.fromkeys(p.places for p in tellable if p.quantity.is_correction):
        lines = tuple(p for p in tellable if p.places == places and p.quantity.is_correction)
        of_lines, left = _fit_lines([residuals[j] for j in places], lines)
        told += of_lines
        rests.update(zip(places, left, strict=True))
    for parameter in tellable:
        if not parameter.quantity.is_correction:
            told += told_of_size(parameter, [rests[j] for j in parameter.places])
    return tuple(told)


def told_of_size(parameter: Parameter, rests: list[np.ndarray]) -> list[Told]:
    """Return what errors (K,) of outputs, over stated standard deviations, tell of how large they are, and of the sensor's inflation."""
    errors, rho = _without_outliers(np.concatenate(rests)), _mean_correlation(rests)
    value, count = _mad(errors), len(errors)
    std = _MAD_NOISE / np.sqrt(count * (1 - rho**2) / (1 + rho**2))
    low, high = (value * float(np.exp(sign * NORMAL_QUANTILE * std)) for sign in (-1, 1))
    told = [Told(parameter, value, low, high, is_told=True)]
    return told if rho < _CHANCE / np.sqrt(count) else [*told, inflation_of(parameter, rho, count)]


def inflation_of(like: Parameter, rho: float, count: int) -> Told:
    """Return the inflation with which white errors weigh what errors of a correlation do: that of their spectrum at frequency 0."""
    std = np.sqrt(max(1 - rho**2, 1e-3) / count)
    value, low, high = (float(np.sqrt((1 + r) / (1 - r))) for r in np.clip([rho, rho - 2 * std, rho + 2 * std], 0.0, _MOST))
    return Told(Parameter(Quantity.INFLATION, like.owner, like.places, 1.0, 1.0), value, low, high, is_told=True)


def _fit_lines(outputs: list[Residuals], lines: tuple[Parameter, ...]) -> tuple[list[Told], list[np.ndarray]]:
    """Return what is told of bias and scale of some outputs together, and what is left of each, over stated standard deviations."""
    from scipy.optimize import least_squares

    columns, target = (np.concatenate(parts) for parts in zip(*(_equations(values, lines) for values in outputs), strict=True))
    ends = np.cumsum([len(values.residual) for values in outputs])[:-1]
    robust = least_squares(lambda z: columns @ z - target, np.zeros(len(lines)), loss="huber", f_scale=_ROBUST * _mad(target))
    rest = target - columns @ robust.x
    rho, sigma = _mean_correlation(np.split(rest, ends)), _mad(_without_outliers(rest))
    information = columns.T @ columns / sigma**2 * (1 - rho) / (1 + rho) + np.eye(len(lines))
    peak = Maximum(robust.x, information, has_converged=True)
    stays, is_inlier, z = without_what_is_not_there(lines, peak), np.abs(rest) < _OUTLIER * sigma, np.zeros(len(lines))
    z[stays] = np.linalg.lstsq(columns[np.ix_(is_inlier, stays)], target[is_inlier], rcond=None)[0]
    centres = np.where(stays, z, robust.x)
    told = [_told_of_line(*line) for line in zip(lines, centres, peak.std, stays, strict=True)]
    return told, np.split(target - columns @ z, ends)


def _equations(values: Residuals, lines: tuple[Parameter, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return columns (K, P) and residuals (K,), over stated standard deviations: residual = bias + (scale - 1) h + error."""
    units = [p.spread * (values.expected if p.quantity is Quantity.SCALE else np.ones_like(values.expected)) for p in lines]
    return np.stack(units, axis=1) / values.spread[:, None], values.residual / values.spread


def _told_of_line(parameter: Parameter, z: float, std: float, is_there: bool) -> Told:
    low, high = (float(parameter.value(z + sign * NORMAL_QUANTILE * std)) for sign in (-1, 1))
    told = Told(parameter, float(parameter.value(z)), low, high, bool(std < UNTOLD))
    return told if is_there else told.without_effect


def _mean_correlation(rests: list[np.ndarray]) -> float:
    """Return the correlation of successive errors, the mean over outputs by their numbers."""
    return float(np.average([correlation_of(rest) for rest in rests], weights=[len(rest) for rest in rests]))


def correlation_of(values: np.ndarray) -> float:
    """Return the correlation of successive values, of pairs without an outlier; within [0, 0.999]."""
    centred = values - np.median(values)
    centred = np.where(np.abs(centred) > _OUTLIER * _mad(values), np.nan, centred)
    products = centred[1:] * centred[:-1]
    size = float(np.nanmean(centred**2))
    return float(np.clip(np.nanmean(products) / size if size and np.isfinite(products).any() else 0.0, 0.0, _MOST))


def _without_outliers(values: np.ndarray) -> np.ndarray:
    return values[np.abs(values - np.median(values)) <= _OUTLIER * _mad(values)]


def _mad(values: np.ndarray) -> float:
    return float(_MAD * np.median(np.abs(values - np.median(values)))) or 1e-12


def _truth_at(model: Model, truth: LogTruth, t: np.ndarray) -> np.ndarray:
    """Return the true states (K, n), nan where they are not known."""
    angles = tuple(signal.name for signal in model.states if signal.is_angle)
    gap = max(_LONGEST_GAP, 2 * float(np.median(np.diff(truth.t)))) if len(truth.t) > 1 else _LONGEST_GAP
    values, x = truth.at(t, angles, max_gap=gap), np.full((len(t), len(model.states)), np.nan)
    for column, name in enumerate(truth.names):
        if name in model.state_names:
            x[:, model.state_names.index(name)] = values[:, column]
    return x
