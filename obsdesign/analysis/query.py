"""The first question: can the outputs, all their derivatives and the known inputs tell the whole state?"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.analysis.at_point import analyse_at, analyse_jets_at
from obsdesign.analysis.codistribution import NoSampleError, codistribution_of
from obsdesign.analysis.engine_result import EngineResult, with_start
from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import EvaluationPoint, SamplingRegion, origin_of, point_from, random_fractions
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.generic_rank import cap_if_known, generic_result
from obsdesign.analysis.jets import jets_result
from obsdesign.analysis.known_signals import with_signal_states
from obsdesign.analysis.map_rank import analyse_map
from obsdesign.analysis.model_equations import equations_of
from obsdesign.analysis.null_space_text import hidden_in_words
from obsdesign.analysis.number_readings import AbstractQuery, QueryResult, readings_text, verdict_over_readings
from obsdesign.analysis.polynomial_inputs import Polynomial, augment
from obsdesign.analysis.rank_growth import modular_growth, require_value, restrict_to_piece
from obsdesign.analysis.symmetry import Symmetry
from obsdesign.analysis.symmetry_search import symmetries_of
from obsdesign.analysis.verdict import Verdict
from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, require_count, require_known
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.errors import InputError
from obsdesign.rank.exact_numbers import ExactNumber
from obsdesign.rank.flint_lock import exclusive_flint

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
    known_at_start: Sequence[str] = (),
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
            signal, to which the unknown inputs may react; of a map several runs from one state under the same unknown inputs, or one run.
        seed: seed of the generic points.
        known_at_start: names of states that are known at the instant that is asked about, and not read later: their unit covectors join
            what the outputs tell, once; none of their rates is known by that.
        method: "recursion", or "jets" = unknown inputs as free jets: a lower bound, computed another way.
        orders: up to which order the jets go; None = until nothing was added for n orders.
    Raises InputError for values that are not accepted, a system without sensors, a point outside a function's domain.
    Source: Hermann and Krener 1977; Martinelli, IROS 2017; Belo, Salaris and Bicchi 2010.
    """
    return observability_of(
        system.model, at, held, disturbance, known_inputs, seed, known_at_start=known_at_start, method=method, orders=orders
    )


def observability_of(
    model: Model,
    at: ArrayLike | None = None,
    held: Mapping[str, float] | None = None,
    disturbance: Disturbance = "arbitrary",
    known_inputs: KnownInputs = "any",
    seed: int = 0,
    *,
    known_at_start: Sequence[str] = (),
    method: Literal["recursion", "jets"] = "recursion",
    orders: int | None = None,
) -> Verdict:
    """Return the verdict for a model, such as some of a system's sensors: `system.model.only(names)`. See `observability`."""
    _validate_query(model, disturbance, known_inputs, method, orders, seed)
    model, signals = (model, ()) if model.period is not None else with_signal_states(model, held or {})
    if at is not None and signals and np.shape(at) != (len(model.states),):
        at = [*as_array("at", at).tolist(), *(float(value) for value in random_fractions(len(signals), f"{seed} known signals"))]
    with exclusive_flint():
        augmented_model = augment(model, disturbance.degree) if isinstance(disturbance, Polynomial) and model.unknown_inputs else model
        point = None if at is None else _query_point(model, augmented_model, at, seed)
        require_known("known_at_start", known_at_start, [name for name in augmented_model.state_names if name not in signals])
        query = _ObservabilityQuery(
            model,
            augmented_model,
            _validate_held(held or {}),
            disturbance,
            known_inputs,
            seed,
            method,
            orders,
            signals,
            tuple(dict.fromkeys(known_at_start)),
        )
        given = [] if at is None else [float(value) for value in np.asarray(at, dtype=float)]
        return verdict_over_readings(query, point, given, seed)


@dataclass(frozen=True, eq=False)
class _ObservabilityQuery(AbstractQuery):
    """What was asked but for the point; augmented_model: the model with the unknown inputs of a polynomial disturbance as states.

    signals: names of the states that stand for known inputs, which the verdict is not about; known_at_start: names of states.
    """

    model: Model
    augmented_model: Model
    held: Mapping[str, float]
    disturbance: Disturbance
    known_inputs: KnownInputs
    seed: int
    method: Literal["recursion", "jets"]
    orders: int | None
    signals: tuple[str, ...] = ()
    known_at_start: tuple[str, ...] = ()

    @property
    def is_smooth(self) -> bool:
        """Whether the known inputs are one smooth signal."""
        return self.known_inputs == "smooth"

    def analyse(self, point: EvaluationPoint | None, reading: Callable[[float], ExactNumber]) -> QueryResult:
        """Return the verdict at the place, or at generic points; reading: what a constant of the model stands for."""
        equations = equations_of(self.augmented_model, self.held, origin_of(point) if point else None, reading)
        places = tuple(self.augmented_model.state_names.index(name) for name in self.known_at_start)
        equations = replace(equations, known_at_start=places)
        relative_point = equations.place_of(point, self.seed) if point else None
        return QueryResult(equations, relative_point, *self._results(equations, relative_point))

    def verdict(self, query_result: QueryResult) -> Verdict:
        """Return the verdict, with the one nearby where it is another."""
        equations, point = query_result.equations, query_result.point
        told = (query_result.nearby or query_result.result).dimension
        result, nearby = with_start(query_result.result, self.known_at_start), query_result.nearby
        nearby = nearby and with_start(nearby, self.known_at_start)
        state = equations.original_state(point).state[equations.n_added :] if point else ()
        readings = (*equations.readings, *zip(self.augmented_model.state_names, state, strict=bool(state)))
        is_singular = nearby is not None and not (result.is_decided and result.dimension == nearby.dimension)
        verdict = self._verdict_of(equations, result, told, is_given_point=point is not None, is_singular=is_singular)
        generic = self._verdict_of(equations, nearby, told) if nearby and nearby.dimension != result.dimension else None
        return replace(verdict, proof=f"{verdict.proof}{readings_text(readings)}", generic=generic)

    def _results(self, equations: Equations, point: EvaluationPoint | None) -> tuple[EngineResult, EngineResult | None]:
        """Return what was found, and, where a point was asked for, what was found nearby."""
        if equations.step_map is not None:
            return self._results_of_map(equations, point)
        if point:
            require_value(equations, point)
            Experiments(equations, point, 2, seed=self.seed).rank(2)  # raises where a derivative has no value
        region = equations.region(self.seed, point)
        equations = restrict_to_piece(equations, region)
        smooth = self.is_smooth
        if self.method == "jets":
            at_point = (
                analyse_jets_at(equations, smooth, point, self.seed, self.orders)
                if point
                else _jets_result(equations, smooth, region, self.orders)
            )
            return at_point, None
        nearby = generic_result(equations, smooth, region)
        if isinstance(self.disturbance, Polynomial) and self.augmented_model is not self.model:
            nearby = replace(nearby, reason=f"{nearby.reason}; {self._induction_text(self.disturbance, nearby)}")
        return (analyse_at(equations, smooth, point, nearby, self.seed), nearby) if point else (nearby, None)

    def _results_of_map(self, equations: Equations, point: EvaluationPoint | None) -> tuple[EngineResult, EngineResult | None]:
        region, smooth = equations.region(self.seed, point), self.is_smooth
        if self.method == "jets":
            raise InputError("method is 'jets': goes with systems in continuous time; of a map unknown inputs are free from step to step")
        if point is None:
            return analyse_map(equations, smooth, region), None
        require_value(equations, point)
        return analyse_map(equations, smooth, region, point), analyse_map(equations, smooth, region)

    def _induction_text(self, disturbance: Polynomial, result: EngineResult) -> str:
        """Say whether one degree more adds as many dimensions as there are unknown inputs: the step of Belo's induction."""
        n_unknown = len(self.model.unknown_inputs)
        higher = equations_of(augment(self.model, disturbance.degree + 1), self.held)
        higher = restrict_to_piece(higher, SamplingRegion(higher.n, self.seed))
        n_gained = modular_growth(higher, self.seed).dimension - result.dimension
        holds = "holds" if n_gained == n_unknown else "does not hold"
        return f"one degree more adds {n_gained} for {n_unknown} unknown input{'s' * (n_unknown > 1)}: the induction step {holds}"

    def _verdict_of(
        self, equations: Equations, result: EngineResult, told: int, *, is_given_point: bool = False, is_singular: bool = False
    ) -> Verdict:
        rank, r, states = result.rank, len(self.signals), self.augmented_model.state_names
        n, is_asked = len(states) - r, [name not in self.signals for name in states]
        at = equations.original_state(result.point).midpoint[equations.n_added :]
        symmetries = self._symmetries(equations, result, at, told)
        hidden = hidden_in_words(
            self.augmented_model, rank.null_basis, at, symmetries, is_given_point=is_given_point, is_singular=is_singular
        )
        return Verdict(
            dimension=rank.rank - r,
            observable=rank.rank == n + r,
            observable_states=tuple(
                name for name, is_seen in zip(states, rank.is_determined, strict=True) if is_seen and name not in self.signals
            ),
            unobservable_states=tuple(name for name, is_seen in zip(states, rank.is_determined, strict=True) if not is_seen),
            null_space=rank.null_space[is_asked],
            symmetries=tuple(symmetry.without(is_asked) for symmetry in symmetries),
            hidden=hidden if result.is_decided else f"not decided, not seen so far: {hidden}",
            ranks=tuple(count - r for count in result.ranks),
            disturbance=_disturbance_in_words(self.model, self.disturbance),
            known_inputs=self.known_inputs,
            at=at[is_asked],
            stopped_by=result.stopped_by,
            decided=result.is_decided,
            proof=_proof_of(equations, result, n + r) + _states_for_inputs(equations, self.signals),
        )

    def _symmetries(self, equations: Equations, result: EngineResult, at: np.ndarray, told: int) -> tuple[Symmetry, ...]:
        """Return what hides the state from any state, with vectors at `at` (n,); told: the dimension that outputs tell there."""
        unseen = [i for i, is_seen in enumerate(result.rank.is_determined) if not is_seen]
        if not unseen:
            return ()
        equations = restrict_to_piece(equations, equations.region(self.seed, result.point))
        codistribution = codistribution_of(equations, told, self.seed, smooth=self.is_smooth)
        count = result.rank.null_space.shape[1]
        try:
            return symmetries_of(codistribution, self.augmented_model, unseen, at, count) if codistribution else ()
        except NoSampleError:  # a root has another sign there than at real states: none is proven, so none is named
            return ()


def _proof_of(equations: Equations, result: EngineResult, n: int) -> str:
    """The proof; with unknown inputs as states what is known at most are their rates."""
    proof = result.proof(n)
    return proof.replace("if the inputs are known", "if the rates of the unknown inputs are known") if equations.n_added else proof


def _states_for_inputs(equations: Equations, signals: tuple[str, ...]) -> str:
    """Say which inputs are states."""
    known = f"; {len(signals)} of these are the known signals {', '.join(signals)}" if signals else ""
    if not equations.n_added:
        return known
    w = ", ".join(equations.names[: equations.n_added])
    return f"{known}; the unknown inputs {w} are further states, of which nothing is asked, and their rates unknown"


def _jets_result(equations: Equations, smooth: bool, region: SamplingRegion, orders: int | None) -> EngineResult:
    return jets_result(equations, smooth, region, cap_if_known(equations, region), orders=orders)


def _disturbance_in_words(model: Model, disturbance: Disturbance) -> str:
    if not model.unknown_inputs:
        return "none"
    return f"polynomial of degree {disturbance.degree}" if isinstance(disturbance, Polynomial) else "arbitrary"


def _query_point(model: Model, augmented_model: Model, at: ArrayLike, seed: int) -> EvaluationPoint:
    """Return the point; where it names x alone and the unknown inputs are states, these are drawn."""
    if augmented_model is not model and np.shape(at) == (len(model.states),):
        input_values = random_fractions(len(augmented_model.states) - len(model.states), f"{seed} unknown inputs")
        return EvaluationPoint((*point_from(model.state_names, at).state, *input_values))
    return point_from(augmented_model.state_names, at)


def _validate_query(model: Model, disturbance: object, known_inputs: object, method: object, orders: int | None, seed: int) -> None:
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
    require_count("seed", seed, minimum=0)
    if not model.channels:
        raise InputError("the system has no sensors: nothing can be seen without one")


def _validate_held(held: Mapping[str, float]) -> dict[str, float]:
    for name, value in held.items():
        if not (isinstance(value, Real) and math.isfinite(value)):
            raise InputError(f"held: {name} is {value!r}: must be a finite number")
    return {name: float(value) for name, value in held.items()}
