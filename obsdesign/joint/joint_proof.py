"""The bound on every path with every schedule: branching on segments, and the check that needs no solver."""

from __future__ import annotations

from dataclasses import dataclass, replace
from heapq import heappop, heappush

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.blas_threads import one_thread
from obsdesign.checks import require_count, require_divisor
from obsdesign.design.path_bound.certificate import PathCertificate
from obsdesign.design.path_bound.dual_barrier import DualPoint
from obsdesign.design.path_bound.information_form import information_form
from obsdesign.design.path_bound.proof import first_guess, least_proof, left_out_scales, proven_value, require_information_alone
from obsdesign.design.path_bound.relaxation import GramRelaxation
from obsdesign.design.path_bound.rounding import gram_matrix
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import gap_between
from obsdesign.errors import InputError
from obsdesign.joint.joint_certificate import JointBound, JointCertificate
from obsdesign.joint.schedule_relaxation import Node, ScheduleRelaxation, branch, schedule_relaxation

NODES = 200  # at most, of the tree: work, not seconds
_MOST_PIECES = 100  # of a Gram matrix: each node solves a problem of some K^3
_TOLERANCE = 3e-4  # relative, to which a node's least level is looked for
_ALL = "all paths and schedules that the problem allows"
_END = (-1, -1)


@dataclass(frozen=True, eq=False)
class _NodeBound:
    """What is proven at a node; point: the multipliers that prove it, None where no path changes it."""

    node: Node
    relaxation: GramRelaxation
    point: DualPoint | None

    @property
    def value(self) -> float:
        """No path with a schedule of the node has more."""
        if self.point is None:
            return self.relaxation.value_of_positions
        return self.relaxation.value_of(self.point.level, self.point.share)

    @property
    def certificate(self) -> PathCertificate:
        """What proves it."""
        lengths = self.relaxation.motion.lengths
        if self.point is None:
            return PathCertificate(lengths=lengths)
        return PathCertificate(self.point.level, self.point.share, lengths, tuple(self.point.multipliers.tolist()))


def joint_bound_of(
    problem: DesignProblem, segments: int, per_segment: int, value: float = np.nan, gap: float | None = None, nodes: int = NODES
) -> JointBound:
    """Return a bound that is proven for every path with every schedule; never raises for want of one: then it is inf, with the reason.

    value: of a path and a schedule that are there; gap: branch on segments until the bound is that near to it, or the tree has so many
    nodes; None: without branches.
    """
    try:
        with one_thread(), np.errstate(all="ignore"):
            relaxation = _relaxation(problem, segments, per_segment)
            if len(relaxation.motion.lengths) > _MOST_PIECES:
                raise InputError(f"the path has {len(relaxation.motion.lengths)} pieces: the relaxation takes at most {_MOST_PIECES}")
            return _search(relaxation, per_segment, value, gap, nodes if gap is not None else 1)
    except (InputError, np.linalg.LinAlgError, ArithmeticError) as error:
        return JointBound(np.inf, None, _ALL, (), str(error))


@validate_arguments
def check_joint_bound(problem: DesignProblem, segments: int, per_segment: int, certificate: JointCertificate) -> float:
    """Return the bound on the value of every path with every schedule, recomputed from its certificate without a solver.

    Arguments:
        problem: what is asked of the path.
        segments: number K of equal segments.
        per_segment: how many sensors may be on at a time.
        certificate: `joint.proof.certificate`, or one read from a file.
    Raises InputError where the certificate proves nothing about this problem.
    """
    require_divisor("segments", segments, "steps", problem.steps)
    require_count("per_segment", per_segment, maximum=len(problem.system.model.channels))
    lengths = {end.lengths for end in certificate.ends}
    if len(lengths) != 1:
        raise InputError(f"certificate: its ends have {len(lengths)} kinds of pieces: must be one")
    with one_thread(), np.errstate(all="ignore"):
        relaxation = _relaxation(problem, segments, per_segment, tuple(lengths.pop()))
        nodes = _ends(relaxation, certificate)
        return max(proven_value(relaxation.at(node), end) for node, end in zip(nodes, certificate.ends, strict=True))


def _ends(relaxation: ScheduleRelaxation, certificate: JointCertificate) -> list[Node]:
    """The ends of the tree, in its order: together they are all schedules."""
    waiting, ends = [relaxation.root], list[Node]()
    for segment, option in certificate.branches:
        if not waiting:
            raise InputError("certificate: its tree goes on after its last end")
        node = waiting.pop()
        if (segment, option) == _END:
            ends.append(node)
        else:
            waiting += reversed(branch(node, segment, option))
    if waiting or len(ends) != len(certificate.ends):
        raise InputError(f"certificate: its tree has {len(ends)} ends and {len(waiting)} open: must have {len(certificate.ends)} and none")
    return ends


def _relaxation(problem: DesignProblem, segments: int, per_segment: int, lengths: tuple[int, ...] | None = None) -> ScheduleRelaxation:
    require_information_alone(problem)
    if problem.criterion.knowledge is not None or problem.weights is not None:
        raise InputError("the path is judged by more than the information about one start")
    return schedule_relaxation(problem, segments, per_segment, lengths)


# ---------------------------------------------------------------- branching


def _search(relaxation: ScheduleRelaxation, per_segment: int, value: float, gap: float | None, nodes: int) -> JointBound:
    """Branch at the node of the largest bound until that is near enough to a value, or the tree has so many nodes."""
    root = _bound(relaxation, relaxation.root, value)
    tree, queue, closed, count = dict[Node, tuple[int, int]](), [(-root.value, 0, root)], list[_NodeBound](), 1
    while queue and count + 2 <= nodes and gap_between(value, -queue[0][0]) > (gap or 0.0):
        _, _, parent = heappop(queue)
        segment, option = _branching(relaxation, parent)
        children = [] if segment < 0 else [_bound(relaxation, node, value, parent) for node in branch(parent.node, segment, option)]
        if not children or max(child.value for child in children) > parent.value:
            closed.append(parent)  # nothing is left to branch on, or it gains nothing
            continue
        tree[parent.node] = (segment, option)
        for child in children:
            heappush(queue, (-child.value, count, child))
            count += 1
    ends = {end.node: end for end in (*closed, *(end for *_, end in queue))}
    bound = max(end.value for end in ends.values())
    if not np.isfinite(bound):
        raise InputError("the relaxation proves nothing")
    motion, problem = relaxation.motion, relaxation.problem
    sensors = relaxation.problem.system.model.channels
    words = f"{motion.in_words}, with at most {per_segment} of {len(sensors)} sensors in each of {relaxation.segments} segments"
    left_out = tuple(dict.fromkeys((*motion.left_out, *root.relaxation.samples.left_out, *left_out_scales(problem))))
    return JointBound(bound, _certificate(relaxation.root, tree, ends), words, left_out)


def _certificate(root: Node, tree: dict[Node, tuple[int, int]], ends: dict[Node, _NodeBound]) -> JointCertificate:
    """The tree written down, first a node, then what follows from it."""
    branches, certificates, waiting = [], [], [root]
    while waiting:
        node = waiting.pop()
        if node in ends:
            branches.append(_END)
            certificates.append(ends[node].certificate)
        else:
            branches.append(tree[node])
            waiting += reversed(branch(node, *tree[node]))
    return JointCertificate(tuple(branches), tuple(certificates))


def _bound(relaxation: ScheduleRelaxation, node: Node, value: float, parent: _NodeBound | None = None) -> _NodeBound:
    here = relaxation.at(node)
    level = first_guess(here, value) if parent is None or parent.point is None else parent.point.level
    return _NodeBound(node, here, least_proof(here, min(level, 0.98 * here.form.largest_level), _TOLERANCE))


def _branching(relaxation: ScheduleRelaxation, parent: _NodeBound) -> tuple[int, int]:
    """The segment in which what is counted is farthest above the best of its options, and that option; (-1, -1) where none is left.

    They are compared along the path that the relaxation has in mind, given as the covariance of the residuals of its samples.
    """
    residuals, heading = _covariance(relaxation, parent)
    n, best, choice = relaxation.length, -np.inf, _END
    for j, options in enumerate(parent.node):
        if len(options) < 2:
            continue
        block = residuals[j * n : (j + 1) * n, j * n : (j + 1) * n]
        values = relaxation.weights(j, options) @ np.diag(block) + heading * relaxation.headings[list(options), j]
        B = parent.relaxation.samples.blocks[j]  # pyright: ignore[reportOptionalSubscript]
        excess = float(np.sum((B @ block) * B) + heading * relaxation.headings[list(options), j].max() - values.max())
        if excess > best:
            best, choice = excess, (j, options[int(np.argmax(values))])
    return choice


def _covariance(relaxation: ScheduleRelaxation, parent: _NodeBound) -> tuple[np.ndarray, float]:
    """Of the residuals (N, N) of samples of weight 1, and how much the heading counts; without multipliers, of positions alone."""
    samples = replace(parent.relaxation.samples, positions=np.ones(relaxation.problem.steps), blocks=None)
    plain, form = information_form(relaxation.problem, relaxation.motion, samples), parent.relaxation.form
    if parent.point is None:
        unknown = np.linalg.eigh(np.linalg.inv(form.M) * np.outer(form.judged, form.judged))[1][:, -1]
        return np.outer(plain.X @ unknown, plain.X @ unknown), 0.0
    rest = plain.rows - plain.X @ form.gain(parent.point.level)
    units = relaxation.problem.units
    return rest @ gram_matrix(parent.relaxation, parent.certificate) @ rest.T, float(units[2] ** 2)
