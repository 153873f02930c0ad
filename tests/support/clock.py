"""A clock that a test turns by hand, and a chamber that goes by it."""

from simulators.physics.thermal import ChamberPhysics
from simulators.units.settings import WorldSettings
from simulators.world import World


class Clock:
    """Gives `now_s`."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def quiet_chamber(clock: Clock, start_c: float) -> World:
    """A world whose chamber has no limit cycle."""
    return World(WorldSettings(1, 9.8, chamber=ChamberPhysics(start_c=start_c, limit_cycle_c=0.0)), clock)
