"""What would mend it: the fewest sensors or manoeuvres, among those offered, with which the state is seen, each proven by a verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import casadi as ca
from numpy.typing import ArrayLike

from obsdesign.analysis.query import Disturbance, KnownInputs
from obsdesign.analysis.question import Question
from obsdesign.analysis.rank_growth import NoValueError
from obsdesign.analysis.ready_made_sensors import ready_made_sensors
from obsdesign.analysis.verdict import Verdict
from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count, require_known, require_positive
from obsdesign.display import AbstractDisplay, Summary
from obsdesign.dynamics.channel import Channel, Noise
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.system import System
from obsdesign.errors import InputError
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.signals import Point

_LISTED = 8  # remedies that are shown


@dataclass(frozen=True, eq=False)
class Remedy:
    """Sensors and manoeuvres that are added, and what is seen with them."""

    sensors: tuple[str, ...]
    """Names of the added sensors."""
    released: tuple[str, ...]
    """Names of inputs that are no longer held at a value, but vary as they like."""
    cost: float
    """What they cost together."""
    verdict: Verdict
    """The verdict with them."""
    places: Mapping[str, Point] = field(default_factory=dict)
    """Where the beacon stands (x, y) [m] of each of them that the system does not have, by name."""

    @property
    def in_words(self) -> str:
        """The remedy in words."""
        parts = [f"add {' and '.join(map(self._sensor, self.sensors))}"] if self.sensors else []
        parts += [f"let {' and '.join(self.released)} vary"] if self.released else []
        return ", and ".join(parts)

    def _sensor(self, name: str) -> str:
        """Return a sensor's name, and to what it looks where nobody said that yet."""
        if name not in self.places:
            return name
        x, y = self.places[name]
        return f"{name} to the beacon at ({x:g}, {y:g}) m"


@dataclass(frozen=True, eq=False)
class Remedies(AbstractDisplay):
    """The cheapest ways to see what is hidden, none of which holds another one."""

    verdict: Verdict
    """The verdict as things are."""
    about: tuple[str, ...]
    """Names of the states that are to be seen."""
    cheapest: tuple[Remedy, ...]
    """What mends it, the cheapest first; none where all of `about` is seen already, or where nothing that was tried mends it."""
    offered: tuple[str, ...]
    """Names of the sensors and of the held inputs that were tried."""
    at_once: int
    """So many at once were tried."""

    def _summary(self) -> Summary:
        hidden = [name for name in self.about if name in self.verdict.unobservable_states]
        if not hidden:
            return Summary("nothing is to be mended: all of it is seen")
        rows = [("hidden", self.verdict.hidden)]
        rows += [(f"cost {remedy.cost:g}", remedy.in_words) for remedy in self.cheapest[:_LISTED]]
        if not self.cheapest:
            rows.append(("tried", f"up to {self.at_once} at once of {', '.join(self.offered) or 'nothing'}: none mends it"))
        return Summary(f"to see {', '.join(hidden)}", tuple(rows))


@validate_arguments
def remedies(
    system: AbstractSystem,
    at: ArrayLike | None = None,
    held: Mapping[str, float] | None = None,
    disturbance: Disturbance = "arbitrary",
    known_inputs: KnownInputs = "any",
    seed: int = 0,
    *,
    sensors: Sequence[str] | None = None,
    offered: Sequence[AbstractSensor] | None = None,
    about: Sequence[str] | None = None,
    costs: Mapping[str, float] | None = None,
    at_once: int = 2,
) -> Remedies:
    """Return the cheapest sensors and manoeuvres with which the state is seen, each proven by a verdict.

    Offered are the sensors of the system that are not in use, sensors that are given (of a vehicle without any: ready-made ones), for
    systems of one's own without any the measurement of each hidden state, named "measure x", and the release of every input that is held.

    Arguments:
        system: vehicle and sensors, or a system of one's own.
        at (n,): the state that is asked about, in the units of the states; None = a generic point.
        held, disturbance, known_inputs, seed: as in `observability`.
        sensors: names of those in use; None = all of the system.
        offered: further sensors of a ready-made vehicle; None = GPS, magnetometer, speed and course over ground, and of each landmark
            range and bearing.
        about: names of the states that are to be seen; None = all.
        costs: name of a sensor or of a held input -> what it costs, > 0; 1 where it is not named.
        at_once: so many at once are tried.
    Raises InputError for values that are not accepted, and sensors that are offered for a system of one's own.
    """
    require_count("at_once", at_once)
    require_known("sensors", tuple(sensors or ()), system.model.sensor_names)
    require_known("about", tuple(about or ()), system.model.state_names)
    question = Question(at, held or {}, disturbance, known_inputs, seed)
    in_use = system.model.sensor_names if sensors is None else tuple(sensors)
    verdict = question.verdict(system.model.only(in_use))
    aims = tuple(about) if about is not None else (*verdict.observable_states, *verdict.unobservable_states)
    model = _with_offers(system, in_use, offered, verdict)
    options = [*(name for name in model.sensor_names if name not in in_use), *question.held]
    prices = {name: float((costs or {}).get(name, 1.0)) for name in options}
    require_known("costs", tuple(costs or ()), options)
    for name, price in prices.items():
        require_positive(f"costs: {name}", price)
    is_mended = not set(aims) & set(verdict.unobservable_states)
    mending = () if is_mended else _cheapest(question, model, in_use, aims, prices, at_once)
    cheapest = tuple(replace(remedy, places=_new_places(remedy, system.model, model)) for remedy in mending)
    return Remedies(verdict, tuple(name for name in system.model.state_names if name in aims), cheapest, tuple(options), at_once)


def _new_places(remedy: Remedy, present: Model, model: Model) -> dict[str, Point]:
    """Return where the beacon stands of each sensor of a remedy that the present model does not have."""
    added = (channel for channel in model.channels if channel.name in remedy.sensors and channel.name not in present.sensor_names)
    return {channel.name: channel.landmarks[0] for channel in added if len(channel.landmarks) == 1}


def _with_offers(system: AbstractSystem, in_use: Sequence[str], offered: Sequence[AbstractSensor] | None, verdict: Verdict) -> Model:
    """Return the model with all that is offered."""
    if isinstance(system, System):
        complete = replace(system, suite=None)
        if offered is None:
            unused = [name for name in complete.model.sensor_names if name not in in_use]
            offered = () if unused else ready_made_sensors(complete)
        return replace(complete, sensors=(*complete.sensors, *offered)).model
    if offered is not None:
        raise InputError("offered: sensors go with ready-made vehicles; a system of one's own has outputs, of which `sensors` are in use")
    model = system.model
    if any(name not in in_use for name in model.sensor_names):
        return model
    names = [name for name in verdict.unobservable_states if name in model.state_names]
    return replace(model, channels=(*model.channels, *(_measurement(model, name) for name in names)))


def _measurement(model: Model, name: str) -> Channel:
    """Return the sensor that measures a state."""
    i = model.state_names.index(name)
    return Channel(f"measure {name}", (replace(model.states[i], name=f"measured {name}"),), model.x[i], Noise(ca.SX(1), ca.SX(1)))


def _cheapest(
    question: Question, model: Model, in_use: Sequence[str], aims: Sequence[str], prices: Mapping[str, float], at_once: int
) -> Iterator[Remedy]:
    """Yield sets of options with which all is seen, the cheapest first, none that holds another one."""
    mending: list[frozenset[str]] = []
    sets = [chosen for count in range(1, at_once + 1) for chosen in combinations(prices, count)]
    for chosen in sorted(sets, key=lambda names: (sum(prices[name] for name in names), len(names))):
        if any(smaller <= set(chosen) for smaller in mending):
            continue
        added, released = [name for name in chosen if name not in question.held], [name for name in chosen if name in question.held]
        try:
            verdict = question.verdict(model.only((*in_use, *added)), released)
        except NoValueError:  # a sensor that reads nothing at the point, such as a course at rest
            continue
        if verdict.decided and set(aims) <= set(verdict.observable_states):
            mending.append(frozenset(chosen))
            yield Remedy(tuple(added), tuple(released), sum(prices[name] for name in chosen), verdict)
