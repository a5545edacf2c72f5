"""The observable space at a generic state: which engine answers which question."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

import casadi as ca
from flint import arb, nmod

from obsdesign.analysis.autobracket_recursion import brackets_preserve_rates, codistribution_sequence
from obsdesign.analysis.engine_result import EngineResult, cut_after_growth, growth_result
from obsdesign.analysis.equations import Equations, with_input_states
from obsdesign.analysis.evaluation_point import EvaluationPoint, SamplingRegion
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.field_rescaling import RescaledSystem, rescale
from obsdesign.analysis.jets import jets_result
from obsdesign.analysis.lie_expressions import IndependenceTest, TooLargeError, sweep_ranks
from obsdesign.analysis.modular_points import random_modular_point
from obsdesign.analysis.rank_growth import ModularGrowth, generic_growth, modular_growth, usable_points
from obsdesign.errors import InputError
from obsdesign.rank.elimination import values_at
from obsdesign.rank.exact_numbers import Number
from obsdesign.rank.graph import NoValueError
from obsdesign.rank.residues import values_modulo

MAX_INPUT_DERIVATIVES = 2
"""Derivatives of the unknown inputs that are taken into the state where the outputs do not give the inputs away."""

_ATTEMPTS = 3  # random places tried: one misleads with a chance of about degree / PRIME (Schwartz and Zippel); more only cost time


def generic_result(equations: Equations, smooth: bool, region: SamplingRegion) -> EngineResult:
    """Return what is observable at a generic state.

    smooth: one smooth known input instead of any, switching ones included.
    """
    if not equations.unknown_fields:
        return _analyse_known_inputs(equations, region)
    witness = witness_point(equations, region)
    known_growth = _growth_if_known(equations, region, witness)
    cap = min(known_growth.dimension, equations.n_queried) if known_growth else equations.n_queried
    if known_growth and not smooth and equations.known_fields:
        equations = equations.with_inputs(*_influential_inputs(equations, known_growth, witness))
    if not equations.unknown_fields:
        return _analyse_known_inputs(equations, region)
    if smooth or not equations.known_fields:
        return growth_result(generic_growth(equations, region), cap)
    return _analyse_any_inputs(equations, cap, region)


def without_idle_inputs(equations: Equations, around: SamplingRegion) -> Equations:
    """Return the equations without the inputs that change no output, from no state: what is observable is the same without them.

    The covectors of what is observable to those who know all inputs vanish on their fields at generic states, so everywhere.
    """
    witness = witness_point(equations, around)
    known_growth = _growth_if_known(equations, around, witness)
    return equations.with_inputs(*_influential_inputs(equations, known_growth, witness)) if known_growth else equations


def witness_point(equations: Equations, region: SamplingRegion) -> EvaluationPoint | None:
    """Return a real place where functions are symbols modulo the prime.

    What vanishes modulo the prime vanishes where roots have those signs: ((1 + c^2)^2)^(1/2) is 1 + c^2 or -1 - c^2 there. What does not
    vanish may vanish by a relation that is not known, such as a^b = exp(b log a).
    """
    return None if equations.is_rational else next(usable_points(equations, region))


def _growth_if_known(equations: Equations, region: SamplingRegion, witness: EvaluationPoint | None) -> ModularGrowth | None:
    """Return how the space grows for somebody who knows the unknown inputs; None where more than that is proven at the witness."""
    all_known = equations.with_all_inputs_known()
    for attempt in range(_ATTEMPTS):
        bounds = modular_growth(all_known, region.seed + attempt)
        proven = bounds.verify_at(all_known, witness, region.seed) if witness else None
        if proven is None or proven.rank.rank <= bounds.total_dimension:
            return bounds
    return None


def cap_if_known(equations: Equations, region: SamplingRegion) -> int:
    """Return the dimension for somebody who knows the unknown inputs, at most."""
    return min(modular_growth(equations.with_all_inputs_known(), region.seed).dimension, equations.n_queried)


def _analyse_known_inputs(equations: Equations, region: SamplingRegion) -> EngineResult:
    growth = generic_growth(equations, region)
    result = growth_result(growth)
    if len(equations.drift_and_known_fields) < 2:
        return result
    independence = IndependenceTest(equations, random_modular_point(equations, region.seed))
    return _with_step_ranks(result, sweep_ranks(independence, equations.outputs, equations.drift_and_known_fields))


def _with_step_ranks(result: EngineResult, steps: Iterable[int]) -> EngineResult:
    """Return the finding with the dimensions of steps that end at its dimension, if these can be counted.

    Steps that end below it say nothing against it: a minor is proven. Those that go beyond an end that was found do.
    """
    ranks: list[int] = []
    try:
        for rank in islice(steps, 4 * result.rank.null_space.shape[0] + 4):
            ranks.append(rank)
            if rank >= result.dimension:
                break
    except (TooLargeError, NoValueError, ZeroDivisionError):
        return result
    if ranks[-1] > result.dimension and result.stopped_by in ("criterion", "bound"):
        what = f"not decided: Lie derivatives one by one give {ranks[-1]}, all at once {result.dimension}"
        return EngineResult(result.rank, result.point, result.ranks, "stalled", what)
    return replace(result, ranks=cut_after_growth(ranks)) if ranks[-1] == result.dimension else result


def _influential_inputs(equations: Equations, known_growth: ModularGrowth, witness: EvaluationPoint | None) -> tuple[list[int], list[int]]:
    """Return the known and the unknown inputs that change what is observable to those who know them all.

    The others change no output at all: what is observable is the same without them. They are so modulo the prime, and not
    proven to be otherwise at the witness.
    """
    fields, m = (*equations.known_fields, *equations.unknown_fields), len(equations.known_fields)
    input_fields = equations.function(ca.densify(ca.horzcat(*fields)))
    influential: set[int] = set()
    for point in (known_growth.point, witness):
        if point:
            values = _values(input_fields, (point.state, equations.values), point)
            rows = Experiments(equations.with_all_inputs_known(), point, len(known_growth.dimensions) - 1).rows()
            products = (
                (j, sum((row[i] * values[i][j] for i in range(equations.n)), point.arithmetic.number(0)))
                for row in rows
                for j in range(len(fields))
            )
            influential |= {j for j, product in products if not _may_vanish(product)}
    return [j for j in sorted(influential) if j < m], [j - m for j in sorted(influential) if j >= m]


def _values(matrix: ca.Function, arguments: Sequence[Sequence[Number]], point: EvaluationPoint) -> list[list[Any]]:
    return values_modulo(matrix, arguments, point.arithmetic) if point.is_modular else values_at(matrix, arguments)


def _may_vanish(value: nmod | arb | int) -> bool:
    return 0 in value if isinstance(value, arb) else value == 0


def _analyse_any_inputs(equations: Equations, cap: int, region: SamplingRegion) -> EngineResult:
    """Return what is observable under known inputs of any kind, from the equations rescaled by what the outputs give away.

    Where they do not give all unknown inputs away, these and some of their derivatives become states, and the next
    derivatives are the unknown inputs. What comes out must not be less than what jets prove.
    """
    result = _analyse_by_rescaling(equations, cap, region)
    if result:
        return result
    row_cache: dict[Any, Any] = {}
    jets_bound = jets_result(equations, False, region, cap, row_cache=row_cache)
    if jets_bound.is_decided:
        return jets_bound
    for level in range(1, MAX_INPUT_DERIVATIVES + 1):
        extended = with_input_states(equations, level)
        result = _analyse_by_rescaling(extended, cap, region)
        if result and result.is_decided and result.dimension >= jets_bound.dimension:
            return replace(result, point=EvaluationPoint(result.point.state[extended.n_added - equations.n_added :]))
    return jets_result(equations, False, region, cap, patience=2 * equations.n + 2, row_cache=row_cache)


def _analyse_by_rescaling(equations: Equations, cap: int, region: SamplingRegion) -> EngineResult | None:
    """Return what is observable for a canonic system; None where it is not, or not seen to be."""
    for attempt in range(_ATTEMPTS):
        independence = IndependenceTest(equations, random_modular_point(equations, region.seed + attempt), witness_point(equations, region))
        try:
            rescaled = rescale(independence)
            return _canonic_result(independence, rescaled, cap, region) if rescaled else None
        except TooLargeError:
            return None
        except (InputError, ZeroDivisionError):
            continue
    return None


def _canonic_result(independence: IndependenceTest, rescaled: RescaledSystem, cap: int, region: SamplingRegion) -> EngineResult:
    """Return Omega*, which holds the functions and what autobrackets change in the rates, and which all fields leave invariant.

    The smallest such space with the rates changed by the known fields is part of it; with the tensor T it holds it. Where both
    agree it is found. Else jets tell, which need no more than 2n + 2 steps.
    """
    equations = rescaled.equations
    inner = generic_growth(rescaled.equations_with_known_inputs(rescaled.rate_changes_by_known_fields), region)
    upper = min(cap, equations.n_queried)
    if inner.dimension < upper:
        outer = modular_growth(rescaled.equations_with_known_inputs(rescaled.rate_changes_by_known_fields, rescaled.tensor), region.seed)
        upper = min(outer.dimension, upper)
    if inner.dimension == upper or not inner.is_decided or brackets_preserve_rates(independence, rescaled):
        result = growth_result(inner, cap)
    else:
        result = jets_result(equations, False, region, upper, patience=2 * equations.n + 2, standstill_proves=True)
        if result.is_decided and result.dimension == upper < min(cap, equations.n_queried):
            result = replace(result, stopped_by="criterion", reason="no more: the tensor T belongs to the space")
    return (
        result
        if equations.n_added
        else _with_step_ranks(result, (functions.numel() for functions in codistribution_sequence(independence, rescaled)))
    )
