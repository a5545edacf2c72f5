"""The observable space at a generic state: which engine answers which question."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import islice

import casadi as ca
from flint import arb

from obsdesign.analysis.equations import Equations, with_input_states
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.finding import Finding, cut, finding_of
from obsdesign.analysis.growth import Growth, generic_growth, require_one_piece, require_value
from obsdesign.analysis.jets import jets_finding
from obsdesign.analysis.places import Place, Surroundings, modular_place
from obsdesign.analysis.recursion import brackets_leave_rates_alone, recursion
from obsdesign.analysis.rescaled import Rescaled, rescale
from obsdesign.analysis.words import Space, TooLargeError, sweeps
from obsdesign.errors import InputError
from obsdesign.rank.elimination import rank_of, values_at
from obsdesign.rank.graph import NoValueError

LEVELS = 2
"""Derivatives of the unknown inputs that are taken into the state where the outputs do not give the inputs away."""


def generic_finding(equations: Equations, smooth: bool, around: Surroundings) -> Finding:
    """Return what is observable at a generic state.

    smooth: one smooth known input instead of any, switching ones included.
    """
    if not equations.unknown:
        return _known(equations, around)
    growth = generic_growth(equations.with_all_known(), around)
    cap = growth.dimension if growth.decided else equations.asked
    if smooth or not equations.known:
        return finding_of(generic_growth(equations, around), cap)
    told = equations.with_unknown(_felt(equations, growth)) if growth.decided else equations
    return _switched(told, cap, around) if told.unknown else _known(told, around)


def cap_of(equations: Equations, around: Surroundings) -> int:
    """Return the dimension for somebody who knows the unknown inputs; n where that is not decided."""
    growth = generic_growth(equations.with_all_known(), around)
    return growth.dimension if growth.decided else equations.asked


def _known(equations: Equations, around: Surroundings) -> Finding:
    growth = generic_growth(equations, around)
    finding = finding_of(growth)
    if len(equations.fields) < 2:
        return finding
    space = Space(equations, _working_place(equations, growth), confirmed=False)
    return _counted(finding, sweeps(space, equations.outputs, equations.fields))


def _working_place(equations: Equations, growth: Growth) -> Place:
    """Return where expressions are evaluated: modulo the prime, if the growth was found there."""
    return modular_place(equations.n, 0) if growth.modular else growth.place


def _counted(finding: Finding, steps: Iterable[int]) -> Finding:
    """Return the finding with the dimensions of steps that end at its dimension, if these can be counted."""
    ranks: list[int] = []
    try:
        for rank in islice(steps, 4 * finding.rank.null_space.shape[0] + 4):
            ranks.append(rank)
            if rank >= finding.dimension:
                break
    except (TooLargeError, NoValueError, ZeroDivisionError):
        return finding
    if ranks[-1] == finding.dimension:
        return replace(finding, ranks=cut(ranks))
    # two ways of computing the same number differ: nothing is claimed
    what = f"not decided: Lie derivatives one by one give {ranks[-1]}, all at once {finding.dimension}"
    return Finding(finding.rank, finding.place, finding.ranks, "stalled", what)


def _felt(equations: Equations, cap: Growth) -> list[int]:
    """Return the unknown inputs that change what is observable to those who know them: the others change no output at all."""
    experiments = Experiments(equations.with_all_known(), cap.place, cap.order, seed=0)
    inputs = equations.function(ca.densify(ca.horzcat(*equations.unknown)))

    def effects(column: int) -> list[list[arb]]:
        values = values_at(inputs, (cap.place.state, equations.values))
        return [[sum((row[i] * values[i][column] for i in range(equations.n)), arb(0))] for row in experiments.rows()]

    return [j for j in range(len(equations.unknown)) if rank_of(lambda j=j: effects(j), 1).rank]


def _switched(equations: Equations, cap: int, around: Surroundings) -> Finding:
    """Return what is observable under known inputs of any kind, from the equations rescaled by what the outputs give away.

    Where they do not give all unknown inputs away, these and some of their derivatives become states, and the next
    derivatives are the unknown inputs. What comes out must not be less than what jets prove.
    """
    finding = _rescaled(equations, cap, around)
    if finding:
        return finding
    bound = jets_finding(equations, False, around, cap)
    if bound.decided:
        return bound
    for level in range(1, LEVELS + 1):
        extended = with_input_states(equations, level)
        finding = _rescaled(extended, cap, around)
        if finding and finding.decided and finding.dimension >= bound.dimension:
            return replace(finding, place=Place(finding.place.state[extended.extra :]))
    return jets_finding(equations, False, around, cap, patience=2 * equations.n + 2)


def _rescaled(equations: Equations, cap: int, around: Surroundings) -> Finding | None:
    """Return what is observable for a canonic system; None where it is not, or not seen to be."""
    for place in around.places(equations.extra):
        try:
            require_value(equations, place)
            require_one_piece(equations, around, place)
            space = space_at(equations, place, around)
            rescaled = rescale(space)
            return _canonic(space, rescaled, cap, around) if rescaled else None
        except TooLargeError:
            return None
        except (InputError, ZeroDivisionError):
            continue
    return None


def space_at(equations: Equations, place: Place, around: Surroundings) -> Space:
    """Return where expressions are evaluated: modulo the prime if that stands for the generic place."""
    modular = equations.is_rational and not around.alone
    return Space(equations, modular_place(equations.n, around.seed) if modular else place)


def _canonic(space: Space, rescaled: Rescaled, cap: int, around: Surroundings) -> Finding:
    """Return Omega*, which holds the functions and what autobrackets change in the rates, and which all fields leave invariant.

    The smallest such space with the rates changed by the known fields is part of it; with the tensor T it holds it. Where both
    agree it is found. Else jets tell, which need no more than 2n + 2 steps.
    """
    equations = rescaled.equations
    told = generic_growth(rescaled.known_equations(rescaled.switched_rates), around)
    most = min(cap, equations.asked)
    if told.dimension < most:
        above = generic_growth(rescaled.known_equations(rescaled.switched_rates, rescaled.tensor), around)
        most = above.dimension if above.decided else most
    if told.dimension == most or not told.decided or brackets_leave_rates_alone(space, rescaled):
        finding = finding_of(told, cap)
    else:
        finding = jets_finding(equations, False, around, most, patience=2 * equations.n + 2, ends=True)
        if finding.decided and finding.dimension == most < min(cap, equations.asked):
            finding = replace(finding, stopped_by="criterion", at_most="no more: the tensor T belongs to the space")
    counting = replace(space, confirmed=False)
    return finding if equations.extra else _counted(finding, (kept.numel() for kept in recursion(counting, rescaled)))
