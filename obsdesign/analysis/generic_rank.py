"""The observable space at a generic state: which engine answers which question."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

import casadi as ca
from flint import arb, nmod

from obsdesign.analysis.autobracket_recursion import brackets_leave_rates_alone, recursion
from obsdesign.analysis.engine_result import Finding, cut, finding_of
from obsdesign.analysis.equations import Equations, with_input_states
from obsdesign.analysis.evaluation_point import Place, Surroundings
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.field_rescaling import Rescaled, rescale
from obsdesign.analysis.jets import jets_finding
from obsdesign.analysis.lie_expressions import Space, TooLargeError, sweeps
from obsdesign.analysis.modular_points import residue_place
from obsdesign.analysis.rank_growth import Bounds, generic_growth, growth_modulo, usable_places
from obsdesign.errors import InputError
from obsdesign.rank.elimination import values_at
from obsdesign.rank.exact_numbers import Number
from obsdesign.rank.graph import NoValueError
from obsdesign.rank.residues import values_modulo

LEVELS = 2
"""Derivatives of the unknown inputs that are taken into the state where the outputs do not give the inputs away."""

_SEEDS = 3  # random places tried: one misleads with a chance of about degree / PRIME (Schwartz and Zippel); more only cost time


def generic_finding(equations: Equations, smooth: bool, around: Surroundings) -> Finding:
    """Return what is observable at a generic state.

    smooth: one smooth known input instead of any, switching ones included.
    """
    if not equations.unknown:
        return _known(equations, around)
    witness = witness_of(equations, around)
    known = _if_known(equations, around, witness)
    cap = min(known.dimension, equations.asked) if known else equations.asked
    if known and not smooth and equations.known:
        equations = equations.with_inputs(*_felt(equations, known, witness))
    if not equations.unknown:
        return _known(equations, around)
    if smooth or not equations.known:
        return finding_of(generic_growth(equations, around), cap)
    return _switched(equations, cap, around)


def without_idle_inputs(equations: Equations, around: Surroundings) -> Equations:
    """Return the equations without the inputs that change no output, from no state: what is observable is the same without them.

    The covectors of what is observable to those who know all inputs vanish on their fields at generic states, so everywhere.
    """
    witness = witness_of(equations, around)
    known = _if_known(equations, around, witness)
    return equations.with_inputs(*_felt(equations, known, witness)) if known else equations


def witness_of(equations: Equations, around: Surroundings) -> Place | None:
    """Return a real place where functions are symbols modulo the prime.

    What vanishes modulo the prime vanishes where roots have those signs: ((1 + c^2)^2)^(1/2) is 1 + c^2 or -1 - c^2 there. What does not
    vanish may vanish by a relation that is not known, such as a^b = exp(b log a).
    """
    return None if equations.is_rational else next(usable_places(equations, around))


def _if_known(equations: Equations, around: Surroundings, witness: Place | None) -> Bounds | None:
    """Return how the space grows for somebody who knows the unknown inputs; None where more than that is proven at the witness."""
    every = equations.with_all_known()
    for attempt in range(_SEEDS):
        bounds = growth_modulo(every, around.seed + attempt)
        shown = bounds.at(every, witness, around.seed) if witness else None
        if shown is None or shown.rank.rank <= bounds.total:
            return bounds
    return None


def cap_of(equations: Equations, around: Surroundings) -> int:
    """Return the dimension for somebody who knows the unknown inputs, at most."""
    return min(growth_modulo(equations.with_all_known(), around.seed).dimension, equations.asked)


def _known(equations: Equations, around: Surroundings) -> Finding:
    growth = generic_growth(equations, around)
    finding = finding_of(growth)
    if len(equations.fields) < 2:
        return finding
    space = Space(equations, residue_place(equations, around.seed))
    return _counted(finding, sweeps(space, equations.outputs, equations.fields))


def _counted(finding: Finding, steps: Iterable[int]) -> Finding:
    """Return the finding with the dimensions of steps that end at its dimension, if these can be counted.

    Steps that end below it say nothing against it: a minor is proven. Those that go beyond an end that was found do.
    """
    ranks: list[int] = []
    try:
        for rank in islice(steps, 4 * finding.rank.null_space.shape[0] + 4):
            ranks.append(rank)
            if rank >= finding.dimension:
                break
    except (TooLargeError, NoValueError, ZeroDivisionError):
        return finding
    if ranks[-1] > finding.dimension and finding.stopped_by in ("criterion", "bound"):
        what = f"not decided: Lie derivatives one by one give {ranks[-1]}, all at once {finding.dimension}"
        return Finding(finding.rank, finding.place, finding.ranks, "stalled", what)
    return replace(finding, ranks=cut(ranks)) if ranks[-1] == finding.dimension else finding


def _felt(equations: Equations, known: Bounds, witness: Place | None) -> tuple[list[int], list[int]]:
    """Return the known and the unknown inputs that change what is observable to those who know them all.

    The others change no output at all: what is observable is the same without them. They are so modulo the prime, and not
    proven to be otherwise at the witness.
    """
    fields, m = (*equations.known, *equations.unknown), len(equations.known)
    inputs = equations.function(ca.densify(ca.horzcat(*fields)))
    felt: set[int] = set()
    for place in (known.place, witness):
        if place:
            values = _values(inputs, (place.state, equations.values), place)
            rows = Experiments(equations.with_all_known(), place, len(known.dimensions) - 1).rows()
            products = (
                (j, sum((row[i] * values[i][j] for i in range(equations.n)), place.arithmetic.number(0)))
                for row in rows
                for j in range(len(fields))
            )
            felt |= {j for j, product in products if not _may_vanish(product)}
    return [j for j in sorted(felt) if j < m], [j - m for j in sorted(felt) if j >= m]


def _values(matrix: ca.Function, arguments: Sequence[Sequence[Number]], place: Place) -> list[list[Any]]:
    return values_modulo(matrix, arguments, place.arithmetic) if place.modular else values_at(matrix, arguments)


def _may_vanish(value: nmod | arb | int) -> bool:
    return 0 in value if isinstance(value, arb) else value == 0


def _switched(equations: Equations, cap: int, around: Surroundings) -> Finding:
    """Return what is observable under known inputs of any kind, from the equations rescaled by what the outputs give away.

    Where they do not give all unknown inputs away, these and some of their derivatives become states, and the next
    derivatives are the unknown inputs. What comes out must not be less than what jets prove.
    """
    finding = _rescaled(equations, cap, around)
    if finding:
        return finding
    kept: dict[Any, Any] = {}
    bound = jets_finding(equations, False, around, cap, kept=kept)
    if bound.decided:
        return bound
    for level in range(1, LEVELS + 1):
        extended = with_input_states(equations, level)
        finding = _rescaled(extended, cap, around)
        if finding and finding.decided and finding.dimension >= bound.dimension:
            return replace(finding, place=Place(finding.place.state[extended.extra :]))
    return jets_finding(equations, False, around, cap, patience=2 * equations.n + 2, kept=kept)


def _rescaled(equations: Equations, cap: int, around: Surroundings) -> Finding | None:
    """Return what is observable for a canonic system; None where it is not, or not seen to be."""
    for attempt in range(_SEEDS):
        space = Space(equations, residue_place(equations, around.seed + attempt), witness_of(equations, around))
        try:
            rescaled = rescale(space)
            return _canonic(space, rescaled, cap, around) if rescaled else None
        except TooLargeError:
            return None
        except (InputError, ZeroDivisionError):
            continue
    return None


def _canonic(space: Space, rescaled: Rescaled, cap: int, around: Surroundings) -> Finding:
    """Return Omega*, which holds the functions and what autobrackets change in the rates, and which all fields leave invariant.

    The smallest such space with the rates changed by the known fields is part of it; with the tensor T it holds it. Where both
    agree it is found. Else jets tell, which need no more than 2n + 2 steps.
    """
    equations = rescaled.equations
    told = generic_growth(rescaled.known_equations(rescaled.switched_rates), around)
    most = min(cap, equations.asked)
    if told.dimension < most:
        above = growth_modulo(rescaled.known_equations(rescaled.switched_rates, rescaled.tensor), around.seed)
        most = min(above.dimension, most)
    if told.dimension == most or not told.decided or brackets_leave_rates_alone(space, rescaled):
        finding = finding_of(told, cap)
    else:
        finding = jets_finding(equations, False, around, most, patience=2 * equations.n + 2, ends=True)
        if finding.decided and finding.dimension == most < min(cap, equations.asked):
            finding = replace(finding, stopped_by="criterion", at_most="no more: the tensor T belongs to the space")
    return finding if equations.extra else _counted(finding, (kept.numel() for kept in recursion(space, rescaled)))
