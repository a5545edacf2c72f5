"""The posterior Cramer-Rao recursion: what can be known of x(t_k) with process noise and unknown inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import require_known
from obsdesign.compile import transition
from obsdesign.errors import InputError
from obsdesign.information.gramian import require_fit
from obsdesign.information.prior import Prior
from obsdesign.information.sampling import local_information
from obsdesign.model import AbstractSystem
from obsdesign.trajectory import Trajectory


def posterior_information(
    system: AbstractSystem,
    path: Trajectory,
    prior: Prior,
    disturbance_psd: ArrayLike | None = None,
    unknown_inputs: Sequence[str] = (),
    active: np.ndarray | None = None,
) -> np.ndarray:
    """Return J (N+1, n, n), the information about x(t_k): J[k] includes the samples at t_k for k < N, J[N] is predicted.

    J+ = M - M B (B'M B + Q^-1)^# B'M + C'R^-1 C,  M = F^-T J F^-1,  J_0 = P_0^-1 + C'R^-1 C; for an unknown input Q^-1 = 0.
    disturbance_psd: None, (n,) or (n, n) in unit^2/s, Q = psd * step; active (N, S) bool: which sensors are on, None = all.
    Raises InputError for shapes that do not fit and unknown names. Source: Tichavsky, Muravchik, Nehorai (1998).
    """
    require_fit(system, path)
    model = system.model
    if prior.mean.shape != path.x[0].shape:
        raise InputError(f"prior has {prior.mean.size} states: the path has {path.x.shape[1]} ({', '.join(model.state_names)})")
    require_known("unknown_inputs", unknown_inputs, [signal.name for signal in model.unknown_inputs])
    columns = [i for i, signal in enumerate(model.unknown_inputs) if signal.name in unknown_inputs]
    F, B_w = _sensitivities(system, path)
    noise = noise_factor(disturbance_psd, path.x.shape[1], path.step)
    gained = _gained(system, path, active)
    certainty = np.diag([0.0] * len(columns) + [1.0] * noise.shape[1])
    J = [prior.information + gained[0]]
    for k in range(path.steps):
        B = np.hstack([B_w[k][:, columns], noise])
        J.append(_predicted(J[-1], F[k], B, certainty) + gained[k + 1])
    return np.array(J)


def noise_factor(disturbance_psd: ArrayLike | None, n: int, step: float) -> np.ndarray:
    """Return L (n, r) with L L' = psd * step; raise InputError unless the psd is (n,) >= 0 or (n, n) positive semidefinite."""
    if disturbance_psd is None:
        return np.zeros((n, 0))
    psd = np.array(disturbance_psd, dtype=float)
    if psd.shape == (n,):
        psd = np.diag(psd)
    if psd.shape != (n, n) or not np.isfinite(psd).all() or not np.allclose(psd, psd.T):
        raise InputError(f"disturbance_psd has shape {psd.shape}: must be finite, ({n},) or symmetric ({n}, {n})")
    values, vectors = np.linalg.eigh(psd)
    if values[0] < -1e-12 * max(values[-1], 0.0):
        raise InputError(f"disturbance_psd has the eigenvalue {values[0]:g}: must be positive semidefinite")
    kept = values > 0
    return vectors[:, kept] * np.sqrt(values[kept] * step)


def _sensitivities(system: AbstractSystem, path: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    n, steps, p = path.x.shape[1], path.steps, len(system.model.unknown_inputs)
    _, F, B_w = transition(system, path.step).map(steps)(path.x[:-1].T, path.u.T, np.zeros((p, steps)))
    return F.full().reshape(n, steps, n).transpose(1, 0, 2), B_w.full().reshape(n, steps, p).transpose(1, 0, 2)


def _gained(system: AbstractSystem, path: Trajectory, active: np.ndarray | None) -> np.ndarray:
    """Information (N+1, n, n) of the samples at each step about the state at that step; none at t_N."""
    blocks = local_information(system, path)
    if active is not None:
        if np.shape(active) != blocks.shape[:2]:
            raise InputError(f"active has shape {np.shape(active)}: must be {blocks.shape[:2]}")
        blocks = np.where(np.asarray(active, dtype=bool)[:, :, None, None], blocks, 0.0)
    n = path.x.shape[1]
    return np.concatenate([blocks.sum(axis=1), np.zeros((1, n, n))])


def _predicted(J: np.ndarray, F: np.ndarray, B: np.ndarray, certainty: np.ndarray) -> np.ndarray:
    inverse = np.linalg.inv(F)
    M = inverse.T @ J @ inverse
    MB = M @ B
    J_next = M - MB @ np.linalg.pinv(B.T @ MB + certainty, hermitian=True) @ MB.T
    return (J_next + J_next.T) / 2
