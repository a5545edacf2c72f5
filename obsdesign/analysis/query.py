"""The first question: can the outputs, all their derivatives and the known inputs tell the whole state?"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.analysis.at_point import finding_at, jets_at
from obsdesign.analysis.engine_result import Finding
from obsdesign.analysis.equations import Equations, equations_of
from obsdesign.analysis.evaluation_point import Place, Surroundings, as_place, origin_of, random_fractions
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.generic_rank import cap_of, generic_finding
from obsdesign.analysis.jets import jets_finding
from obsdesign.analysis.null_space_text import hidden_in_words
from obsdesign.analysis.number_readings import AbstractQuestion, Answer, as_read, with_doubts
from obsdesign.analysis.polynomial_inputs import Polynomial, augmented
from obsdesign.analysis.rank_growth import growth_modulo, one_piece, require_value
from obsdesign.analysis.verdict import Verdict
from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.errors import InputError
from obsdesign.rank.exact_numbers import Meaning
from obsdesign.rank.flint_lock import flint_alone

KnownInputs = Literal["any", "smooth"]
Disturbance = Literal["arbitrary"] | Polynomial


@validate_arguments
def observability(  # the public contract
    system: AbstractSystem,
    at: ArrayLike | None = None,
    held: Mapping[str, float] | None = None,
    disturbance: Disturbance = "arbitrary",
    known_inputs: KnownInputs = "any",
    seed: int = 0,
    *,
    method: Literal["recursion", "jets"] = "recursion",
    orders: int | None = None,
) -> Verdict:
    """Return what the outputs of the system, all their derivatives and the known inputs tell about the state.

    The rank, in exact arithmetic, of the gradients of the outputs' Lie derivatives; unknown inputs are eliminated by the rescaled fields
    and autobrackets of Martinelli's recursion, or counted as free jets.

    Arguments:
        system: vehicle and sensors, or a system of one's own.
        at (n,): the state that is asked about, in the units of the states; with a polynomial disturbance also the augmented state;
            None = a generic point (drawn from seed).
        held: known inputs kept at a value, by name, in their units.
        disturbance: what the unknown inputs may be: "arbitrary" smooth functions of time, or Polynomial(degree).
        known_inputs: "any", switching ones included, under each of which the unknown inputs are the same; "smooth": one smooth
            signal, to which the unknown inputs may react.
        seed: seed of the generic points.
        method: "recursion", or "jets" = unknown inputs as free jets: a lower bound, computed another way.
        orders: up to which order the jets go; None = until nothing was added for n orders.
    Raises InputError for values that are not accepted, a system without sensors, a point outside a function's domain.
    Source: Hermann and Krener 1977; Martinelli, IROS 2017; Belo, Salaris and Bicchi 2010.
    """
    return observability_of(system.model, at, held, disturbance, known_inputs, seed, method=method, orders=orders)


def observability_of(
    model: Model,
    at: ArrayLike | None = None,
    held: Mapping[str, float] | None = None,
    disturbance: Disturbance = "arbitrary",
    known_inputs: KnownInputs = "any",
    seed: int = 0,
    *,
    method: Literal["recursion", "jets"] = "recursion",
    orders: int | None = None,
) -> Verdict:
    """Return the verdict for a model, such as some of a system's sensors: `system.model.only(names)`. See `observability`."""
    _require_answerable(model, disturbance, known_inputs, method, orders, seed)
    with flint_alone():
        asked = augmented(model, disturbance.degree) if isinstance(disturbance, Polynomial) and model.unknown_inputs else model
        place = None if at is None else _place(model, asked, at, seed)
        question = _Question(model, asked, _as_held(held or {}), disturbance, known_inputs, seed, method, orders)
        given = [] if at is None else [float(value) for value in np.asarray(at, dtype=float)]
        return with_doubts(question, place, given, seed)


@dataclass(frozen=True, eq=False)
class _Question(AbstractQuestion):
    """What was asked but for the point; asked: the model with the unknown inputs of a polynomial disturbance as states."""

    model: Model
    asked: Model
    held: Mapping[str, float]
    disturbance: Disturbance
    known_inputs: KnownInputs
    seed: int
    method: Literal["recursion", "jets"]
    orders: int | None

    def answer(self, place: Place | None, meaning: Callable[[float], Meaning]) -> Answer:
        """Return the verdict at the place, or at generic points; meaning: what a constant of the model stands for."""
        equations = equations_of(self.asked, self.held, origin_of(place) if place else None, meaning)
        there = place.less(equations.origin) if place else None
        return Answer(equations, there, *self._findings(equations, there))

    def worded(self, answer: Answer) -> Verdict:
        """Return the verdict, with the one nearby where it is another."""
        equations, place, finding, nearby = answer.equations, answer.place, answer.finding, answer.nearby
        state = equations.state_at(place).state if place else ()
        read = (*equations.read, *zip(self.asked.state_names, state, strict=bool(state)))
        singular = nearby is not None and not (finding.decided and finding.dimension == nearby.dimension)
        verdict = self._worded(equations, finding, chosen=place is not None, singular=singular)
        generic = self._worded(equations, nearby) if nearby and nearby.dimension != finding.dimension else None
        return replace(verdict, proof=f"{verdict.proof}{as_read(read)}", generic=generic)

    def _findings(self, equations: Equations, place: Place | None) -> tuple[Finding, Finding | None]:
        """Return what was found, and, where a point was asked for, what was found nearby."""
        if place:
            require_value(equations, place)
            Experiments(equations, place, 2, seed=self.seed).rank(2)  # raises where a derivative has no value
        around = Surroundings(equations.n, self.seed, place)
        equations = one_piece(equations, around)
        smooth = self.known_inputs == "smooth"
        if self.method == "jets":
            at_place = jets_at(equations, smooth, place, self.seed, self.orders) if place else _jets(equations, smooth, around, self.orders)
            return at_place, None
        nearby = generic_finding(equations, smooth, around)
        if isinstance(self.disturbance, Polynomial) and self.asked is not self.model:
            nearby = replace(nearby, at_most=f"{nearby.at_most}; {self._induction(self.disturbance, nearby)}")
        return (finding_at(equations, smooth, place, nearby, self.seed), nearby) if place else (nearby, None)

    def _induction(self, disturbance: Polynomial, finding: Finding) -> str:
        """Say whether one degree more adds as many dimensions as there are unknown inputs: the step of Belo's induction."""
        unknown = len(self.model.unknown_inputs)
        higher = equations_of(augmented(self.model, disturbance.degree + 1), self.held)
        higher = one_piece(higher, Surroundings(higher.n, self.seed))
        added = growth_modulo(higher, self.seed).dimension - finding.dimension
        holds = "holds" if added == unknown else "does not hold"
        return f"one degree more adds {added} for {unknown} unknown input{'s' * (unknown > 1)}: the induction step {holds}"

    def _worded(self, equations: Equations, finding: Finding, *, chosen: bool = False, singular: bool = False) -> Verdict:
        rank, n, states = finding.rank, len(self.asked.states), self.asked.state_names
        at = equations.state_at(finding.place).midpoint
        hidden = hidden_in_words(self.asked, rank.null_basis, at, chosen=chosen, singular=singular)
        return Verdict(
            dimension=rank.rank,
            observable=rank.rank == n,
            observable_states=tuple(name for name, is_seen in zip(states, rank.seen, strict=True) if is_seen),
            unobservable_states=tuple(name for name, is_seen in zip(states, rank.seen, strict=True) if not is_seen),
            null_space=rank.null_space,
            hidden=hidden if finding.decided else f"not decided, not seen so far: {hidden}",
            ranks=finding.ranks,
            disturbance=_disturbance_in_words(self.model, self.disturbance),
            known_inputs=self.known_inputs,
            at=at,
            stopped_by=finding.stopped_by,
            decided=finding.decided,
            proof=finding.proof(n),
        )


def _jets(equations: Equations, smooth: bool, around: Surroundings, orders: int | None) -> Finding:
    return jets_finding(equations, smooth, around, cap_of(equations, around), orders=orders)


def _disturbance_in_words(model: Model, disturbance: Disturbance) -> str:
    if not model.unknown_inputs:
        return "none"
    return f"polynomial of degree {disturbance.degree}" if isinstance(disturbance, Polynomial) else "arbitrary"


def _place(model: Model, asked: Model, at: ArrayLike, seed: int) -> Place:
    """Return the point; where it names x alone and the unknown inputs are states, these are drawn."""
    if asked is not model and np.shape(at) == (len(model.states),):
        drawn = random_fractions(len(asked.states) - len(model.states), f"{seed} unknown inputs")
        return Place((*as_place(model.state_names, at).state, *drawn))
    return as_place(asked.state_names, at)


def _require_answerable(model: Model, disturbance: object, known_inputs: object, method: object, orders: int | None, seed: int) -> None:
    if not (disturbance == "arbitrary" or isinstance(disturbance, Polynomial)):
        raise InputError(f"disturbance is {disturbance!r}: must be 'arbitrary' or Polynomial(degree)")
    if known_inputs not in ("any", "smooth"):
        raise InputError(f"known_inputs is {known_inputs!r}: must be 'any' or 'smooth'")
    if method not in ("recursion", "jets"):
        raise InputError(f"method is {method!r}: must be 'recursion' or 'jets'")
    if orders is not None and method != "jets":
        raise InputError(f"orders is {orders!r}: goes with method='jets' alone")
    if orders is not None:
        require_count("orders", orders)
    require_count("seed", seed, least=0)
    if not model.channels:
        raise InputError("the system has no sensors: nothing can be seen without one")


def _as_held(held: Mapping[str, float]) -> dict[str, float]:
    for name, value in held.items():
        if not (isinstance(value, Real) and math.isfinite(value)):
            raise InputError(f"held: {name} is {value!r}: must be a finite number")
    return {name: float(value) for name, value in held.items()}
