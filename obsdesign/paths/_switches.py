"""A level that is switched at free times: its means over the steps of a grid."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from obsdesign.paths._columns import is_array
from obsdesign.paths.abstract import Grid

if TYPE_CHECKING:
    import numpy as np


def softplus(z: Any) -> Any:  # noqa: ANN401  # symbolic or numerical
    """log(1 + exp(z)), elementwise, without overflow.

    As max(z, 0) + log1p(exp(-|z|)), of which both halves are the same analytic function. The side of z = 0 is chosen once, so that
    derivatives of all orders there are those of one half; built from max and | | they would be means of both.
    """
    import casadi as ca
    import numpy as np

    module = np if is_array(z) else ca
    above = 1.0 * (z >= 0)
    return above * z + module.log1p(module.exp((1 - 2 * above) * z))


def switched_means(durations: Any, jumps: np.ndarray, tau: float, grid: Grid) -> Any:  # noqa: ANN401
    """Means (N,) over the steps of sum_i jumps_i S((t - s_i) / tau), s_i [s] the running sums of the durations, S(z) = 1 / (1 + exp(-z)).

    From a to b the mean of S((t - s) / tau) is tau / (b - a) (softplus((b - s) / tau) - softplus((a - s) / tau)).
    """
    import casadi as ca
    import numpy as np

    nodes = np.arange(grid.steps + 1) * grid.step
    numerical = is_array(durations)
    times = nodes if numerical else ca.DM(nodes)
    total, switch = np.zeros(grid.steps) if numerical else type(durations).zeros(grid.steps, 1), 0.0
    for i, jump in enumerate(jumps):
        switch = switch + durations[i]
        area = softplus((times - switch) / tau)
        total = total + float(jump) * tau / grid.step * (area[1:] - area[:-1])
    return total


def mean_jacobian(durations: np.ndarray, jumps: np.ndarray, tau: float, grid: Grid) -> np.ndarray:
    """d means / d durations (N, switches): a duration moves all switches behind it."""
    import numpy as np
    from scipy.special import expit

    nodes = np.arange(grid.steps + 1) * grid.step
    per_switch = -jumps * np.diff(expit((nodes[:, None] - np.cumsum(durations)) / tau), axis=0) / grid.step
    return np.cumsum(per_switch[:, ::-1], axis=1)[:, ::-1]
