"""What a bound is made of: a price for information, one for every resource, and what the criterion adds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Dual:
    """criterion(W) <= sum_r <W_r, Z_r> + offset for every W; Z (R, n, n) >= 0, one for each set of sensors that may be lost.

    mu (resources,) >= 0: what one more unit of a resource is worth. Hence for every schedule
    value <= offset + mu'limits + max over schedules of (sum <W_r, Z_r> - mu'usage - switching).
    """

    Z: np.ndarray
    mu: np.ndarray
    offset: float
