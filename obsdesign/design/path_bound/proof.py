"""The bound on every path of a problem: found with a solver, checked without one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.blas_threads import one_thread
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.design.path_bound.certificate import PathBound, PathCertificate
from obsdesign.design.path_bound.dual_barrier import DualPoint, least_level
from obsdesign.design.path_bound.relaxation import GramRelaxation, relaxation_of
from obsdesign.design.problem import DesignProblem
from obsdesign.design.upper_bound import cap_of
from obsdesign.errors import InputError

_TOLERANCE = 3e-5  # relative, to which the least level is looked for
_FIRST_RAISE, _RAISES = 1e-7, 16  # relative rise of a level until its proof goes through with rounding; doublings of it
_MOST_PIECES = 200  # of a Gram matrix: its solve takes some K^3
_NO_MORE = "the relaxation proves no more than what no path changes"
_ALL_PATHS = "all paths that the problem allows"


def path_bound_of(problem: DesignProblem, value: float = np.nan, lengths: tuple[int, ...] | None = None) -> PathBound:
    """Return the least bound that is proven for every path of a problem; never raises for want of one: then it is inf, with the reason.

    value: of a path that is there; one that reaches the cap needs no more. lengths: steps of the pieces of the Gram matrix, which divide
    those in which inputs are held; shorter ones cost time and give a bound that is a little nearer.
    """
    cap = _cap_bound(problem)
    if value >= cap.bound * (1 - 1e-6):
        return cap
    try:
        with one_thread(), np.errstate(all="ignore"):
            relaxed = _relaxed_bound(problem, value, lengths)
            return replace(cap, reason=_NO_MORE) if cap.bound <= relaxed.bound else relaxed
    except (InputError, np.linalg.LinAlgError, ArithmeticError) as error:
        return replace(cap, reason=str(error))


@validate_arguments
def check_path_bound(problem: DesignProblem, certificate: PathCertificate) -> float:
    """Return the bound on the value of every path that the problem allows, recomputed from its certificate without a solver.

    Arguments:
        problem: what is asked of the path.
        certificate: `design.proof.certificate`, or one read from a file.
    Raises InputError where the certificate proves nothing about this problem.
    """
    if not certificate.lengths:
        bound = _cap_bound(problem).bound
        if not np.isfinite(bound):
            raise InputError("certificate: has no multipliers, and there is nothing that no path changes: it proves no bound")
        return bound
    with one_thread(), np.errstate(all="ignore"):
        return proven_value(_relaxation(problem, tuple(certificate.lengths)), certificate)


def proven_value(relaxation: GramRelaxation, certificate: PathCertificate) -> float:
    """Return the value that a certificate proves of a relaxation; raises InputError where it proves none."""
    if not certificate.multipliers and np.isfinite(relaxation.value_of_positions):
        return relaxation.value_of_positions
    multipliers, wanted = np.array(certificate.multipliers), len(relaxation.constraints.limits)
    if len(multipliers) != wanted:
        raise InputError(f"certificate: has {len(multipliers)} multipliers: must be {wanted}, one for each constraint of this problem")
    if not relaxation.proves(certificate.level, certificate.share, multipliers):
        raise InputError(f"certificate: its multipliers do not prove the level {certificate.level:g} for this problem")
    return relaxation.value_of(certificate.level, certificate.share)


def _cap_bound(problem: DesignProblem) -> PathBound:
    """What no path changes, as a bound; inf without."""
    if problem.prices or problem.robust is not None or problem.criterion.knowledge is not None:
        return PathBound(np.inf, None, _ALL_PATHS, (), "the path is judged by more than the information about one start")
    cap = cap_of(problem)
    if cap is None:
        return PathBound(np.inf, None, _ALL_PATHS, (), "every part of the information depends on the path")
    left_out = tuple(name for name in problem.system.model.state_names if name not in cap.states)
    bound = cap.value * (1 + cap.rounding) if cap.value else 0.0
    return PathBound(bound, PathCertificate(), _ALL_PATHS, tuple(f"what is known of {name}" for name in left_out))


def _relaxed_bound(problem: DesignProblem, value: float, lengths: tuple[int, ...] | None) -> PathBound:
    """The bound by the relaxation; raises InputError with the reason where there is none."""
    relaxation = _relaxation(problem, lengths)
    motion, top = relaxation.motion, relaxation.value_of_positions
    if len(motion.lengths) > _MOST_PIECES:
        raise InputError(f"the path has {len(motion.lengths)} pieces: the relaxation takes at most {_MOST_PIECES}")
    left_out = tuple(dict.fromkeys((*motion.left_out, *relaxation.samples.left_out, *left_out_scales(problem))))
    proof = least_proof(relaxation, first_guess(relaxation, value))
    if proof is not None:
        certificate = PathCertificate(proof.level, proof.share, motion.lengths, tuple(proof.multipliers.tolist()))
        return PathBound(relaxation.value_of(proof.level, proof.share), certificate, motion.in_words, left_out)
    if not np.isfinite(top):
        raise InputError(_NO_MORE)
    # what position and wind alone could be known to, were every sensor as good as it is taken for
    return PathBound(top, PathCertificate(lengths=motion.lengths), motion.in_words, left_out, _NO_MORE)


def _relaxation(problem: DesignProblem, lengths: tuple[int, ...] | None) -> GramRelaxation:
    """The relaxation; raises InputError with the reason where there is none."""
    require_information_alone(problem)
    return relaxation_of(problem, lengths)


def require_information_alone(problem: DesignProblem) -> None:
    """Raise InputError where paths are judged by more than the information about one start."""
    if problem.prices or problem.robust is not None:
        raise InputError("the path is judged by more than the information about one start")


def first_guess(relaxation: GramRelaxation, value: float) -> float:
    """Return where to look for the least level: near the value of a path that is there, if the level is that."""
    top = relaxation.form.largest_level
    if relaxation.form.kind is MinEigenvalue and 0 < value < top:
        return min(1.01 * value, (value + top) / 2)
    return 0.9 * top if np.isfinite(top) else 1.0


def least_proof(relaxation: GramRelaxation, guess: float, tolerance: float = _TOLERANCE) -> DualPoint | None:
    """Return the least level, to a relative tolerance, whose proof goes through; None where no more is proven than what no path changes.

    Where none goes through with the ends that paths must reach, those count for nothing.
    """
    proof, ends = _checked_proof(relaxation, guess, tolerance), len(relaxation.motion.ends)
    if proof is not None or not ends:
        return proof
    free = replace(relaxation, constraints=relaxation.constraints.without_last(ends))
    proof = _checked_proof(free, guess, tolerance)
    return None if proof is None else replace(proof, multipliers=np.append(proof.multipliers, np.zeros(ends)))


def _checked_proof(relaxation: GramRelaxation, guess: float, tolerance: float) -> DualPoint | None:
    """Return the least level, raised a little until the check goes through, rounding included."""
    proof = least_level(relaxation, guess, tolerance)
    if proof is None:
        return None
    for k in range(_RAISES):
        level = proof.level * (1 + _FIRST_RAISE * 2.0**k)
        if relaxation.proves(level, proof.share, proof.multipliers):
            return replace(proof, level=level)
    return None


def left_out_scales(problem: DesignProblem) -> tuple[str, ...]:
    """Return units that differ between the axes: the larger one stands for both."""
    S = problem.units
    return ("that scales of x and y differ",) if S[0] != S[1] or (len(S) > 4 and S[3] != S[4]) else ()
