"""A node as in ROS 2, without ROS: messages are dictionaries, a timer chooses what sensor is on next.

The node keeps a belief, moves it with every odometry message, takes the samples of the sensor that is on, and every two seconds asks which
one should be on next. In a node of rclpy `on_odometry`, `on_sample` and `on_timer` are the callbacks, and `publish` a publisher.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import obsdesign as od

STEP, SEGMENT, AHEAD = 0.5, 2.0, 20  # s, s, steps that are looked ahead
PSD = np.square([0.02, 0.02, 0.01])  # unit^2/s
Message = Mapping[str, Any]


@dataclass(frozen=True)
class Node:
    """What the node knows: the system, its belief, which sensor is on, its latest turn rate and what was measured since."""

    system: od.System
    belief: od.Prior
    on: str = "gps"
    turn_rate: float = 0.0
    samples: tuple[Message, ...] = ()

    def on_sample(self, message: Message) -> Node:
        """Keep a sample: {"sensor": name, "value": [...]}."""
        return replace(self, samples=(*self.samples, message)) if message["sensor"] == self.on else self

    def on_odometry(self, message: Message) -> Node:
        """Take the samples, then move the belief by one step of {"turn_rate": ...}."""
        sensors = [sensor.name for sensor in self.system.sensors]
        sizes = [len(sensor.outputs) for sensor in self.system.sensors]
        arrived = {sample["sensor"]: sample["value"] for sample in self.samples}
        y = np.concatenate([np.asarray(arrived.get(name, [np.nan] * size), float) for name, size in zip(sensors, sizes, strict=True)])
        active = np.array([[name in arrived for name in sensors]])
        u = [[message["turn_rate"]]]
        estimate = od.estimate_states(self.system, self.belief, u, y[None], STEP, active=active, disturbance_psd=PSD)
        belief = od.Prior(mean=estimate.mean[-1], covariance=estimate.covariance[-1])
        return replace(self, belief=belief, turn_rate=message["turn_rate"], samples=())

    def on_timer(self, publish: Callable[[Message], None]) -> Node:
        """Choose what is on for the next segment, and publish {"switch_on": name, "cost": ..., "bound": ...}."""
        ahead = np.full((AHEAD, 1), self.turn_rate)
        schedule = od.select_next(self.system, self.belief, ahead, STEP, segment=SEGMENT, disturbance_psd=PSD, scale=[1.0, 1.0, 0.1])
        names = [sensor.name for sensor in self.system.sensors]
        on = next((name for name, is_on in zip(names, schedule.chosen[0], strict=True) if is_on), self.on)
        publish({"switch_on": on, "cost": schedule.value, "bound": schedule.bound})
        return replace(self, on=on)


def main(seconds: int = 10, seed: int = 0) -> list[Message]:
    """Play a drive round a circle into the node; print and return what it publishes."""
    random, published = np.random.default_rng(seed), list[Message]()
    sensors = (od.GPS(sigma=3.0), od.Magnetometer(sigma=0.3), od.Bearing((30.0, 20.0), sigma=0.05))
    system = od.System(od.Dubins(speed=4.0), sensors)
    truth, sigmas = np.array([0.0, 0.0, 0.2]), {"gps": 3.0, "magnetometer": 0.3, "bearing": 0.05}
    node = Node(system, od.Prior(mean=[1.0, -1.0, 0.3], std=(3.0, 3.0, 0.3)))
    for k in range(round(seconds / STEP)):
        if k % round(SEGMENT / STEP) == 0:
            node = node.on_timer(published.append)
            print(published[-1])
        for sensor in sensors:
            values = np.atleast_1d(_measure(sensor.name, truth)) + sigmas[sensor.name] * random.standard_normal(len(sensor.outputs))
            node = node.on_sample({"sensor": sensor.name, "value": values.tolist()})
        node = node.on_odometry({"turn_rate": 0.2})
        truth = od.simulate(system, truth, [[0.2]], STEP).x[-1]
    error = float(np.linalg.norm(node.belief.mean[:2] - truth[:2]))
    print(f"off by {error:.1f} m at the end")
    return [*published, {"error": error, "std": np.sqrt(np.diag(node.belief.covariance)).tolist()}]


def _measure(sensor: str, x: np.ndarray) -> np.ndarray:
    """What a sensor would say without noise."""
    if sensor == "gps":
        return x[:2]
    return x[2:] if sensor == "magnetometer" else np.arctan2(20.0 - x[1:2], 30.0 - x[:1]) - x[2:]


if __name__ == "__main__":
    main()
