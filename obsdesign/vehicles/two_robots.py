"""Two robots in the plane, of which the one knows of the other what it sees of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from obsdesign.arguments import validate_arguments
from obsdesign.errors import InputError
from obsdesign.signals import Signal
from obsdesign.vehicles import _planar as planar
from obsdesign.vehicles.abstract import HEADING, SPEED, TURN_RATE, AbstractVehicle, Fields, X, Y

if TYPE_CHECKING:
    import casadi as ca

Leader = Literal["known", "unknown"]
_PEER = (Signal("peer_x", "m"), Signal("peer_y", "m"), Signal("peer_heading", "rad", is_angle=True))
_PEER_INPUTS = (Signal("peer_speed", "m/s"), Signal("peer_turn_rate", "rad/s"))


@validate_arguments
@dataclass(frozen=True)
class TwoRobots(AbstractVehicle):
    """Two unicycles: (x, y, heading) moves with speed and turn_rate, the peer's likewise with inputs of its own.

    What the one sees of the other are `peer_range` and `peer_bearing`. States x, y, peer_x, peer_y [m], heading, peer_heading [rad].
    Raises InputError for other values.
    """

    peer: Leader = "unknown"
    """Whether the peer tells its speed and turn rate ("known": two more inputs) or nobody knows them ("unknown" inputs)."""

    def __post_init__(self) -> None:
        if self.peer not in ("known", "unknown"):
            raise InputError(f"peer is {self.peer!r}: must be 'known' (its speed and turn rate are inputs) or 'unknown' (unknown inputs)")

    @property
    def states(self) -> tuple[Signal, ...]:
        """x, y [m], heading [rad], peer_x, peer_y [m], peer_heading [rad]."""
        return (X, Y, HEADING, *_PEER)

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """speed [m/s] and turn_rate [rad/s], those of a known peer as peer_speed and peer_turn_rate."""
        return (SPEED, TURN_RATE, *(_PEER_INPUTS if self.peer == "known" else ()))

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        """peer_speed and peer_turn_rate where nobody knows them."""
        return _PEER_INPUTS if self.peer == "unknown" else ()

    def fields(self, x: ca.SX) -> Fields:
        """Return the fields of both robots' speeds and turn rates."""
        import casadi as ca

        zeros = ca.SX.zeros(3)
        mine = tuple(ca.vertcat(field(x[:3]), zeros) for field in (planar.forward_field, planar.turn_field))
        peers = tuple(ca.vertcat(zeros, field(x[3:])) for field in (planar.forward_field, planar.turn_field))
        if self.peer == "known":
            return Fields(ca.SX.zeros(6), (*mine, *peers))
        return Fields(ca.SX.zeros(6), mine, peers)
