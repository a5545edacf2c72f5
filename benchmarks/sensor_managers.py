"""Stone Soup's sensor managers on a small flight: who ranges to which of four beacons, with the reward that obsdesign minimises.

A vehicle of nearly constant velocity flies straight past the beacons. Stone Soup predicts and updates by its own Kalman filter; the reward
of a decision is minus the sum, over the samples of the segment decided on, of the trace of the posterior position covariance.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from time import process_time

import numpy as np

from benchmarks.straight_flight import BEACONS, POSITION, PSD, SAMPLES, SIGMA, STEP, StraightFlight, transition_matrix

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from stonesoup.base import Property
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.sensor.sensor import Sensor
    from stonesoup.sensormanager import (
        BruteForceSensorManager,
        OptimizeBasinHoppingSensorManager,
        OptimizeBruteSensorManager,
    )
    from stonesoup.sensormanager.action import Action, ActionableProperty, RealNumberActionGenerator
    from stonesoup.sensormanager.tree_search import MCTSRolloutSensorManager
    from stonesoup.types.array import StateVector
    from stonesoup.types.detection import TrueDetection
    from stonesoup.types.groundtruth import GroundTruthState
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.prediction import GaussianStatePrediction
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.updater.kalman import ExtendedKalmanUpdater

_EPOCH = datetime(2026, 1, 1)


# ---------------------------------------------------------------- the model for Stone Soup


class _Range(NonLinearGaussianMeasurement):
    """Distance to a beacon, with its derivative."""

    beacon: np.ndarray = Property()

    @property
    def ndim_meas(self) -> int:
        return 1

    def function(self, state: object, noise: bool | np.ndarray = False, **_: object) -> StateVector:
        return StateVector([[float(np.linalg.norm(self._offset(state)))]])

    def jacobian(self, state: object, **_: object) -> np.ndarray:
        row, offset = np.zeros((1, 4)), self._offset(state)
        row[0, POSITION] = offset / np.linalg.norm(offset)
        return row

    def rvs(self, *_: object, **__: object) -> StateVector:
        raise NotImplementedError

    def pdf(self, *_: object, **__: object) -> float:
        raise NotImplementedError

    def _offset(self, state: object) -> np.ndarray:
        return np.array(state.state_vector, dtype=float)[POSITION, 0] - self.beacon  # pyright: ignore[reportAttributeAccessIssue]


class _Switch(Action):
    """Range to this beacon."""

    def act(self, current_time: datetime, timestamp: datetime, init_value: int, **_: object) -> int:
        return self.target_value


class _Switches(RealNumberActionGenerator):
    """All beacons, or the one nearest to a real number, round and round: an optimiser that strays does not get lost."""

    min, max, epsilon = 0, len(BEACONS) - 1, 1e-6

    @property
    def initial_value(self) -> int:
        return self.current_value

    @property
    def default_action(self) -> _Switch:
        return self._to(self.current_value)

    def __contains__(self, item: object) -> bool:
        return isinstance(item, _Switch)

    def __iter__(self) -> Iterator[_Switch]:
        return (self._to(i) for i in range(len(BEACONS)))

    def action_from_value(self, value: float) -> _Switch:
        return self._to(round(float(value)) % len(BEACONS))

    def _to(self, beacon: int) -> _Switch:
        return _Switch(generator=self, end_time=self.end_time, target_value=beacon)


class _Radio(Sensor):
    """A radio that ranges to one beacon at a time; order: which segment it serves, where there is a radio for each."""

    beacon: int = ActionableProperty(generator_cls=_Switches, default=0)
    order: int = Property(default=0)

    @property
    def measurement_model(self) -> _Range:
        return _Range(ndim_state=4, mapping=POSITION, noise_covar=np.array([[SIGMA**2]]), beacon=np.array(BEACONS[self.beacon]))

    def measure(self, ground_truths: set[GroundTruthState], noise: bool | np.ndarray = False, **_: object) -> set[TrueDetection]:
        model = self.measurement_model
        return {
            TrueDetection(model.function(truth), timestamp=truth.timestamp, measurement_model=model, groundtruth_path=truth)
            for truth in ground_truths
        }


_PREDICTOR = KalmanPredictor(
    LinearGaussianTimeInvariantTransitionModel(transition_matrix=transition_matrix(), covariance_matrix=np.diag(PSD) * STEP)
)
_UPDATER = ExtendedKalmanUpdater(measurement_model=None)


def _through_segment(prediction: GaussianStatePrediction, radio: _Radio | None) -> tuple[float, GaussianStatePrediction]:
    """Return the sum of position traces after the samples of one segment, and what is predicted for the first of the next."""
    spent = 0.0
    for _ in range(SAMPLES):
        posterior = prediction if radio is None else _updated(prediction, radio)
        spent += float(np.trace(np.array(posterior.covar)[np.ix_(POSITION, POSITION)]))
        prediction = _PREDICTOR.predict(posterior, timestamp=prediction.timestamp + timedelta(seconds=STEP))
    return spent, prediction


def _updated(prediction: GaussianStatePrediction, radio: _Radio) -> GaussianState:
    (detection,) = radio.measure({GroundTruthState(prediction.state_vector, timestamp=prediction.timestamp)})
    return _UPDATER.update(SingleHypothesis(prediction, detection))


def _radios_after(config: Mapping[_Radio, Sequence[Action]], time: datetime) -> list[_Radio]:
    """Return copies of the radios with the actions carried out, in the order of their segments, as Stone Soup's own rewards do."""
    radios, memo = [], {}
    for radio, actions in config.items():
        radios.append(copy.deepcopy(radio, memo))
        radios[-1].add_actions(actions)
        radios[-1].act(time, noise=False)
    return sorted(radios, key=lambda radio: radio.order)


def _reward(config: Mapping[_Radio, Sequence[Action]], tracks: set[Track], time: datetime) -> float:
    return _reward_with_tracks(config, tracks, time)[0]


def _reward_with_tracks(config: Mapping[_Radio, Sequence[Action]], tracks: set[Track], time: datetime) -> tuple[float, set[Track]]:
    """Minus the sum of position traces over one segment for each radio, one after the other; without a radio, over one segment."""
    (track,) = tracks
    total, prediction = 0.0, track[-1]
    for radio in _radios_after(config, time) or [None]:
        spent, prediction = _through_segment(prediction, radio)
        total -= spent
    return total, {Track([prediction])}


# ---------------------------------------------------------------- managers


@dataclass(frozen=True)
class Managed:
    """What a manager chose (K, S), in how many seconds, and what it looks at."""

    name: str
    chosen: np.ndarray
    seconds: float
    horizon: str


def managed(flight: StraightFlight) -> Iterator[Managed]:
    """Let each manager decide segment after segment."""
    makers = (_brute_force, _grid, _basin_hopping, _tree_search)
    for make in makers:
        np.random.seed(0)  # the managers draw from it
        began = process_time()
        picks = _decisions(flight, make)
        horizon = "three segments ahead" if make is _tree_search else "one segment ahead"
        yield Managed(make({_Radio()}).__class__.__name__, _as_schedule(picks), process_time() - began, horizon)


def _brute_force(radios: set[_Radio]) -> BruteForceSensorManager:
    return BruteForceSensorManager(radios, reward_function=_reward)


def _grid(radios: set[_Radio]) -> OptimizeBruteSensorManager:
    return OptimizeBruteSensorManager(radios, reward_function=_reward, n_grid_points=len(BEACONS))


def _basin_hopping(radios: set[_Radio]) -> OptimizeBasinHoppingSensorManager:
    return OptimizeBasinHoppingSensorManager(radios, reward_function=_reward, n_iter=20, stepsize=1.0)


def _tree_search(radios: set[_Radio]) -> MCTSRolloutSensorManager:
    return MCTSRolloutSensorManager(
        radios,
        reward_function=_reward_with_tracks,
        niterations=100,
        time_step=timedelta(seconds=SAMPLES * STEP),
        search_depth=2,
        discount_factor=1.0,
        exploration_factor=100.0,
        best_child_policy="max_average_reward",
    )


def managed_at_once(flight: StraightFlight) -> Managed:
    """Ask the brute-force manager for the whole schedule: a radio for each segment, all decided on together."""
    began = process_time()
    radios = {_Radio(order=j) for j in range(flight.segments)}
    manager = BruteForceSensorManager(radios, reward_function=_reward)
    _wake(radios, _EPOCH)
    (config,) = manager.choose_actions({Track([_start(flight)])}, _EPOCH + timedelta(seconds=SAMPLES * STEP))
    picks = [action.target_value for radio, (action,) in sorted(config.items(), key=lambda item: item[0].order)]
    return Managed("BruteForceSensorManager", _as_schedule(picks), process_time() - began, "all segments at once")


def _decisions(flight: StraightFlight, make: Callable[[set[_Radio]], BruteForceSensorManager]) -> list[int]:
    radio, prediction, picks = _Radio(), _start(flight), []
    manager = make({radio})
    for j in range(flight.segments):
        _wake({radio}, _EPOCH + timedelta(seconds=SAMPLES * STEP * j))
        end = _EPOCH + timedelta(seconds=SAMPLES * STEP * (j + 1))
        (config,) = manager.choose_actions({Track([prediction])}, end)
        radio.add_actions(config[radio])
        radio.act(end)
        picks.append(radio.beacon)
        prediction = _through_segment(prediction, radio)[1]
    return picks


def _wake(radios: set[_Radio], time: datetime) -> None:
    for radio in radios:
        radio.timestamp = time


def _start(flight: StraightFlight) -> GaussianStatePrediction:
    return GaussianStatePrediction(StateVector(flight.prior.mean), flight.prior.covariance, timestamp=_EPOCH)


def _as_schedule(picks: Sequence[int]) -> np.ndarray:
    return np.arange(len(BEACONS)) == np.array(picks)[:, None]
