"""A receding horizon with a Kalman filter in the loop, step by step: plan from the belief, fly a second, measure, believe anew.

`od.fly` does this in one call; here every part is in the open, for a loop of your own.
"""

from __future__ import annotations

import numpy as np

import obsdesign as od

STEP, EVERY, PLANS = 0.5, 4, 5  # s; steps between plans; how many plans
PSD = np.square([0.0, 0.0, 0.01, 0.05, 0.05])  # unit^2/s


def main(seed: int = 0) -> dict[str, list[float]]:
    """Print and return the filter's standard deviations and errors after each plan."""
    system = od.System(od.Dubins(speed=15.0, wind="constant"), (od.GPS(sigma=2.0), od.Magnetometer(sigma=0.2)))
    random, truth = np.random.default_rng(seed), np.array([0.0, 0.0, 0.3, 3.0, -2.0])
    std = np.array([10.0, 10.0, 0.2, 4.0, 4.0])
    belief = od.Prior(mean=truth + std * random.standard_normal(5), std=std)
    problem = od.DesignProblem(
        system=system, start=belief.mean, duration=10.0, step=STEP, path=od.PiecewiseConstant(pieces=5),
        bounds={"turn_rate": (-0.3, 0.3)}, criterion=od.MinEigenvalue(), scale=std,
    )  # fmt: skip
    planner, plan = od.Planner(problem, every=EVERY * STEP), None
    history: dict[str, list[float]] = {"std of the wind": [], "error of the wind": []}
    for _ in range(PLANS):
        plan = planner.step(belief.mean, previous=plan, prior=belief)  # the warm start travels in the plan
        u = plan.trajectory.u[:EVERY]
        flown = od.simulate(system, truth, u, STEP)  # here the vehicle itself would fly
        noise = random.standard_normal((EVERY, 3)) * [2.0, 2.0, 0.2]
        y = flown.x[:-1, :3] + noise  # GPS and magnetometer
        estimate = od.estimate_states(system, belief, u, y, STEP, disturbance_psd=PSD)  # the extended Kalman filter, four steps on
        truth, belief = flown.x[-1], od.Prior(mean=estimate.mean[-1], covariance=estimate.covariance[-1])
        history["std of the wind"].append(float(np.sqrt(np.trace(belief.covariance[3:, 3:]))))
        history["error of the wind"].append(float(np.linalg.norm(belief.mean[3:] - truth[3:])))
        print(", ".join(f"{name} {values[-1]:.2f} m/s" for name, values in history.items()))
    return history


if __name__ == "__main__":
    main()
