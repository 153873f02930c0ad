"""Fixtures with a level axis."""

from simulators.physics.attitude import NORTH, SOUTH, Fixture, raised


def planar(sense: int, offset_deg: float) -> Fixture:
    """A head with a level axis: the input axis is `sense` x head angle + `offset_deg` above the horizontal."""
    body = raised(offset_deg)
    return Fixture((SOUTH if sense > 0 else NORTH,), tuple(body[0].tolist()), tuple(body[2].tolist()))
