"""What vehicles in space share: position, attitude as a quaternion from the vehicle's axes to the map's, turn rates about them."""

from __future__ import annotations

from obsdesign.signals import Signal

POSITION = (Signal("x", "m"), Signal("y", "m"), Signal("z", "m"))
ATTITUDE = (Signal("q_t", ""), Signal("q_x", ""), Signal("q_y", ""), Signal("q_z", ""))
TURN_RATES = (Signal("roll_rate", "rad/s"), Signal("pitch_rate", "rad/s"), Signal("yaw_rate", "rad/s"))
