"""A sampling planner that asks obsdesign what each of its candidates would tell.

A thousand paths of random turn rates are judged at once: each by the smallest eigenvalue of its Fisher information, in units of what is
known before. The best that arrives is taken. Any sampling planner (RRT, lattices, motion primitives) can score its edges this way.
"""

from __future__ import annotations

import numpy as np

import obsdesign as od

GOAL, REACH = np.array([300.0, 150.0]), 60.0  # m
STEP, STEPS, LEGS = 0.5, 60, 6  # s, steps, turn rates per path
STD = np.array([20.0, 20.0, 0.2, 5.0, 5.0])  # what is known before


def main(candidates: int = 1000, seed: int = 0) -> dict[str, float]:
    """Print and return what the best path is worth beside the straight one."""
    system = od.System(
        od.Dubins(speed=15.0, wind="constant"), (od.GPS(sigma=2.0), od.Range((150.0, 300.0), sigma=1.0), od.Magnetometer(sigma=0.2))
    )
    start = [0.0, 0.0, np.arctan2(GOAL[1], GOAL[0]), 1.0, -1.0]
    rates = np.random.default_rng(seed).uniform(-0.2, 0.2, (candidates, LEGS))
    rates[0] = 0.0  # straight on
    inputs = np.repeat(rates, STEPS // LEGS, axis=1)[..., None]  # (M, N, 1)
    information = od.batch_information(system, np.tile(start, (candidates, 1)), inputs, STEP).sum(axis=1)  # (M, n, n), all sensors
    values = np.linalg.eigvalsh(information * np.outer(STD, STD))[:, 0]
    ends = np.array([od.simulate(system, start, u, STEP).x[-1, :2] for u in inputs[np.argsort(-values)[:200]]])
    arrives = np.linalg.norm(ends - GOAL, axis=1) < REACH
    best = np.argsort(-values)[:200][arrives][0]
    print(f"{candidates} paths; the best of the {arrives.sum()} that arrive: {values[best]:.0f}, straight on: {values[0]:.0f}")
    return {"best": float(values[best]), "straight": float(values[0]), "arrived": float(arrives.sum())}


if __name__ == "__main__":
    main()
