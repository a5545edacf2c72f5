"""Why something stays hidden: theorems whose hypotheses hold for the system as it stands, each with its source."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum

import casadi as ca
from numpy.typing import ArrayLike

from obsdesign.analysis.dependence import function_count, states_that_move_nothing
from obsdesign.analysis.query import Disturbance, KnownInputs
from obsdesign.analysis.question import Question
from obsdesign.analysis.symmetry import Symmetry, SymmetryKind
from obsdesign.analysis.verdict import Verdict
from obsdesign.arguments import validate_arguments
from obsdesign.display import AbstractDisplay, Summary
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.motion import AffineMotion, moved_with


class ReasonKind(Enum):
    """Why a state is not seen; the value is the theorem's source."""

    MOVES_NOTHING = "Brace and Morgansen, Lemma 1 and Corollary 1"
    TOO_FEW_FUNCTIONS = "Brace and Morgansen, Lemmas 2 and 4"
    FORCING = "Brace and Morgansen, Lemma 3"
    SYMMETRY = "a vector field that annihilates the observable codistribution: Hermann and Krener 1977"
    HELD_INPUTS = "Brace and Morgansen, Lemma 6 and Theorem 2"
    UNKNOWN_INPUTS = "Martinelli, IROS 2017"
    SINGULAR_POINT = "Belo, Salaris and Bicchi 2010, section IV-B"


@dataclass(frozen=True, eq=False)
class Reason:
    """One reason, of which all hypotheses were checked."""

    kind: ReasonKind
    """Which theorem says it."""
    states: tuple[str, ...] = ()
    """Names of the states that it is about."""
    inputs: tuple[str, ...] = ()
    """Names of the inputs that it is about."""
    count: int = 0
    """How many functions there are, or how many dimensions would be seen without the reason."""
    symmetry: Symmetry | None = None
    """The symmetry that hides the states, if it is one."""

    @property
    def in_words(self) -> str:
        """The reason in words."""
        return _WORDS[self.kind](self)


def _words_of_moving_nothing(reason: Reason) -> str:
    verb = "is" if len(reason.states) == 1 else "are"
    return f"{', '.join(reason.states)} {verb} in no output, and in the rate of no state that moves an output"


def _words_of_forcing(reason: Reason) -> str:
    first, *forcing = reason.states
    others = ", ".join(forcing)
    return f"{first} is constant and in no output: its share in the rates is told only together with that of {others}, constant as well"


def _words_of_symmetry(reason: Reason) -> str:
    what = reason.symmetry.kind.value if reason.symmetry else "a symmetry"
    return f"{what} changes neither outputs nor how they go on: {', '.join(reason.states)}"


_WORDS: Mapping[ReasonKind, Callable[[Reason], str]] = {
    ReasonKind.MOVES_NOTHING: _words_of_moving_nothing,
    ReasonKind.TOO_FEW_FUNCTIONS: lambda reason: (
        f"outputs and their derivatives are {reason.count} functions of the state in all, the others being constant: fewer than states"
    ),
    ReasonKind.FORCING: _words_of_forcing,
    ReasonKind.SYMMETRY: _words_of_symmetry,
    ReasonKind.HELD_INPUTS: lambda reason: f"{', '.join(reason.inputs)} is held: where it varies {reason.count} dimensions are seen",
    ReasonKind.UNKNOWN_INPUTS: lambda reason: (
        f"{', '.join(reason.inputs)} may be anything: {reason.count} dimensions are seen by somebody who knows what it is"
    ),
    ReasonKind.SINGULAR_POINT: lambda reason: f"at this state less is seen than nearby, where it is {reason.count} dimensions",
}


@dataclass(frozen=True, eq=False)
class ExplainedVerdict(AbstractDisplay):
    """A verdict with the reasons for what it hides."""

    verdict: Verdict
    """What is seen, and what is not."""
    reasons: tuple[Reason, ...]
    """Why, in the order of `ReasonKind`; none where all is seen, or where no theorem that is looked at says it."""

    def _summary(self) -> Summary:
        n = self.verdict.null_space.shape[0]
        rows = [("hidden", self.verdict.hidden), *((f"because ({i})", reason.in_words) for i, reason in enumerate(self.reasons, 1))]
        return Summary(f"{self.verdict.dimension} of {n} dimensions seen", tuple(rows))


@validate_arguments
def explain(
    system: AbstractSystem,
    at: ArrayLike | None = None,
    held: Mapping[str, float] | None = None,
    disturbance: Disturbance = "arbitrary",
    known_inputs: KnownInputs = "any",
    seed: int = 0,
) -> ExplainedVerdict:
    """Return the verdict with the reasons for what it hides, each a theorem whose hypotheses hold for this system.

    Arguments:
        system: vehicle and sensors, or a system of one's own.
        at (n,): the state that is asked about, in the units of the states; None = a generic point.
        held, disturbance, known_inputs, seed: as in `observability`.
    Raises InputError as `observability` does.
    Source: Brace and Morgansen; Belo, Salaris and Bicchi 2010; Martinelli, IROS 2017.
    """
    model, question = system.model, Question(at, dict(held or {}), disturbance, known_inputs, seed)
    verdict = question.verdict(model)
    if verdict.observable:
        return ExplainedVerdict(verdict, ())
    reasons = [*_of_functions(model, question.held), *_of_symmetries(model, verdict), *_of_inputs(model, question, verdict)]
    if verdict.generic and verdict.generic.dimension > verdict.dimension:
        reasons.append(Reason(ReasonKind.SINGULAR_POINT, count=verdict.generic.dimension))
    return ExplainedVerdict(verdict, tuple(reasons))


def _of_functions(model: Model, held: Mapping[str, float]) -> Iterator[Reason]:
    """Yield what follows from which functions there are."""
    idle = states_that_move_nothing(model, held)
    if idle:
        yield Reason(ReasonKind.MOVES_NOTHING, idle)
    count = function_count(model, held)
    if count is not None and count < len(model.states):
        yield Reason(ReasonKind.TOO_FEW_FUNCTIONS, count=count)


def _of_symmetries(model: Model, verdict: Verdict) -> Iterator[Reason]:
    for symmetry in verdict.symmetries:
        if symmetry.kind is SymmetryKind.FORCING and not _is_in_output(model, symmetry.states[0]):
            yield Reason(ReasonKind.FORCING, symmetry.states, symmetry=symmetry)
        elif symmetry.kind is not SymmetryKind.UNSEEN:
            yield Reason(ReasonKind.SYMMETRY, symmetry.states, symmetry=symmetry)


def _of_inputs(model: Model, question: Question, verdict: Verdict) -> Iterator[Reason]:
    """Yield what inputs hide that are held, or that nobody knows."""
    for name in question.held:
        count = question.verdict(model, released=(name,)).dimension
        if count > verdict.dimension:
            yield Reason(ReasonKind.HELD_INPUTS, inputs=(name,), count=count)
    if model.unknown_inputs and question.disturbance == "arbitrary":
        count = question.verdict(_with_inputs_known(model)).dimension
        if count > verdict.dimension:
            yield Reason(ReasonKind.UNKNOWN_INPUTS, inputs=tuple(signal.name for signal in model.unknown_inputs), count=count)


def _is_in_output(model: Model, name: str) -> bool:
    return bool(ca.jacobian(model.h, model.x[model.state_names.index(name)]).nnz())


def _with_inputs_known(model: Model) -> Model:
    """Return the model as it is for somebody who knows the unknown inputs."""
    symbols, none = ca.vertcat(model.u, model.w), ca.SX(0, 1)
    motion = (
        AffineMotion(model.drift, ca.horzcat(model.B, model.G), ca.SX(len(model.states), 0))
        if model.is_affine
        else moved_with(model.motion, inputs=(symbols, none), values=(model.u, model.w), below=none)
    )
    # the symbols in outputs are those of the model; the new one replaces them by its own
    return replace(model, inputs=(*model.inputs, *model.unknown_inputs), unknown_inputs=(), motion=motion, u_of_outputs=symbols)
