#!/usr/bin/env bash
# Stone Soup 1.9.1: MCTSRolloutSensorManager draws the actions of its rollouts from the first (sum of the sensors' numbers of actions) of
# all (product of them) configurations: simulate_action adds the numbers up where choose_actions multiplies them. With two sensors of four
# actions, eight of sixteen: the sensor that comes first in a set takes its first two actions only, and the four configurations in which both
# sensors take their third or fourth are never rolled out. With sensors of one action each the sum is of nothing, and a call on valid
# input ends in numpy's "high <= 0".
# Whoever plans for several sensors gets values of rollouts that leave out some of what the sensors can do; two sensors of two actions hide
# it (2 + 2 = 2 * 2). What to do: give the manager one sensor whose action is the whole configuration.
# States: version, which configurations of two sensors of four actions are not in 3,200 rollouts, and what a manager says whose two sensors
# have one action each.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat > "$folder/rollouts.py" <<'PYTHON'
import warnings
from datetime import datetime, timedelta
from importlib.metadata import version

import numpy as np

warnings.simplefilter("ignore")
from stonesoup.base import Property
from stonesoup.sensor.sensor import Sensor
from stonesoup.sensormanager.action import Action, ActionableProperty, ActionGenerator
from stonesoup.sensormanager.tree_search import MCTSRolloutSensorManager
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track

START, STEP = datetime(2026, 1, 1), timedelta(seconds=1)


class Switch(Action):
    def act(self, current_time, timestamp, init_value, **kwargs):
        return self.target_value


class Switches(ActionGenerator):
    actions: int = Property(default=4)

    @property
    def default_action(self):
        return Switch(generator=self, end_time=self.end_time, target_value=self.current_value)

    def __contains__(self, item):
        return isinstance(item, Switch)

    def __iter__(self):
        return (Switch(generator=self, end_time=self.end_time, target_value=i) for i in range(self.actions))


class Selector(Sensor):
    target: int = ActionableProperty(generator_cls=Switches, generator_kwargs_mapping={"actions": "actions_count"}, default=0)
    actions_count: int = Property(default=4)
    name: str = Property(default="")

    @property
    def measurement_model(self):
        return None

    def measure(self, ground_truths, noise=True, **kwargs):
        return set()


def manager(actions, rolled_out):
    def reward(config, tracks, time):
        if time == START + 2 * STEP:  # the first step is the tree's, the second a rollout's: the tree never gets past its root's children
            rolled_out.append(tuple(action.target_value for _, (action,) in sorted(config.items(), key=lambda item: item[0].name)))
        return 0.0, tracks

    sensors = {Selector(name=name, actions_count=actions) for name in "ab"}
    for sensor in sensors:
        sensor.timestamp = START
    return MCTSRolloutSensorManager(sensors, reward_function=reward, niterations=actions**2 - 1, time_step=STEP, rollout_depth=1)


rolled_out = []
np.random.seed(0)
for _ in range(200):
    manager(4, rolled_out).choose_actions({Track([GaussianState([[0.0]], [[1.0]], timestamp=START)])}, START + STEP)
missing = sorted({(a, b) for a in range(4) for b in range(4)} - set(rolled_out))
print(version("stonesoup"), len(rolled_out), "rollouts, none of", missing)
try:
    manager(1, []).choose_actions({Track([GaussianState([[0.0]], [[1.0]], timestamp=START)])}, START + STEP)
    print("one action each: an answer")
except ValueError as error:
    print("one action each:", error)
PYTHON
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check stonesoup==1.9.1 numpy==2.4.6
"$folder/venv/bin/python" "$folder/rollouts.py" | tee "$folder/seen"
diff "$folder/seen" - <<'SEEN'
1.9.1 3200 rollouts, none of [(2, 2), (2, 3), (3, 2), (3, 3)]
one action each: high <= 0
SEEN
echo "as stated"
