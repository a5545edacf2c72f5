"""The first question: can the outputs, all their derivatives and the known inputs tell the whole state?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from numbers import Real
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.analysis.equations import Equations, equations_of
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.finding import Finding
from obsdesign.analysis.generic import cap_of, generic_finding
from obsdesign.analysis.growth import generic_growth, require_value
from obsdesign.analysis.hidden import hidden_in_words
from obsdesign.analysis.jets import jets_finding
from obsdesign.analysis.places import Place, Surroundings, as_place, random_fractions
from obsdesign.analysis.points import finding_at, jets_at
from obsdesign.analysis.polynomial import Polynomial, augmented
from obsdesign.analysis.verdict import Verdict
from obsdesign.checks import require_count
from obsdesign.errors import InputError
from obsdesign.model import AbstractSystem, Model

KnownInputs = Literal["any", "smooth"]
Disturbance = Literal["arbitrary"] | Polynomial


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

    at: None = at a generic point (drawn from seed), or a state (n,); with a polynomial disturbance also the augmented state
    held: known inputs kept at a value
    disturbance: what the unknown inputs may be: "arbitrary" smooth functions of time, or Polynomial(degree)
    known_inputs: "any", switching ones included, under each of which the unknown inputs are the same; "smooth": one smooth
    signal, to which the unknown inputs may react
    method: "jets" = unknown inputs as free jets up to `orders` (None: until nothing was added for n orders): a lower bound,
    computed another way
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
    asked = augmented(model, disturbance.degree) if isinstance(disturbance, Polynomial) and model.unknown_inputs else model
    place = None if at is None else _place(model, asked, at, seed)
    equations = equations_of(asked, _as_held(held or {}))
    if place:
        require_value(equations, place)
        Experiments(equations, place, 2, seed=seed).rank(2, confirmed=False)  # raises where a derivative has no value
    around = Surroundings(equations.n, seed, place)
    smooth = known_inputs == "smooth"
    if method == "jets":
        finding = jets_at(equations, smooth, place, seed, orders) if place else _jets(equations, smooth, around, orders)
        return _verdict(asked, model, finding, disturbance, known_inputs)
    nearby = generic_finding(equations, smooth, around)
    if isinstance(disturbance, Polynomial) and asked is not model:
        higher = equations_of(augmented(model, disturbance.degree + 1), held)
        step = _induction(higher, len(model.unknown_inputs), nearby, seed)
        nearby = replace(nearby, at_most=f"{nearby.at_most}; {step}")
    generic = _verdict(asked, model, nearby, disturbance, known_inputs)
    if place is None:
        return generic
    verdict = _verdict(asked, model, finding_at(equations, smooth, place, nearby, seed), disturbance, known_inputs)
    return verdict if verdict.dimension == generic.dimension else replace(verdict, generic=generic)


def _jets(equations: Equations, smooth: bool, around: Surroundings, orders: int | None) -> Finding:
    return jets_finding(equations, smooth, around, cap_of(equations, around), orders=orders)


def _induction(higher: Equations, unknown: int, finding: Finding, seed: int) -> str:
    """Say whether one degree more adds as many dimensions as there are unknown inputs: the step of Belo's induction."""
    added = generic_growth(higher, Surroundings(higher.n, seed)).dimension - finding.dimension
    holds = "holds" if added == unknown else "does not hold"
    return f"one degree more adds {added} for {unknown} unknown input{'s' * (unknown > 1)}: the induction step {holds}"


def _verdict(asked: Model, model: Model, finding: Finding, disturbance: Disturbance, known_inputs: KnownInputs) -> Verdict:
    rank, at, n = finding.rank, finding.place.midpoint, len(asked.states)
    hidden = hidden_in_words(asked, rank.null_space, at)
    return Verdict(
        dimension=rank.rank,
        observable=rank.rank == n,
        observable_states=tuple(name for name, is_seen in zip(asked.state_names, rank.seen, strict=True) if is_seen),
        unobservable_states=tuple(name for name, is_seen in zip(asked.state_names, rank.seen, strict=True) if not is_seen),
        null_space=rank.null_space,
        hidden=hidden if finding.decided else f"not decided, not seen so far: {hidden}",
        ranks=finding.ranks,
        disturbance=_disturbance_in_words(model, disturbance),
        known_inputs=known_inputs,
        at=at,
        stopped_by=finding.stopped_by,
        decided=finding.decided,
        proof=finding.proof(n),
    )


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
