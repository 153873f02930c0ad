"""The angles that a bench file allows a head, refused before anything is sent to it or asked of anybody."""

from __future__ import annotations

from drivers.errors import BeyondLimit
from drivers.kinds.head.description import AngleRange


def check_angle(device: str, what: str, angle_deg: float, allowed: AngleRange) -> None:
    """Raises BeyondLimit for an angle outside `allowed`; `what` it is stands before it."""
    if not allowed.min <= angle_deg <= allowed.max:
        raise BeyondLimit(
            device, f"{what} {angle_deg:g}° is outside {allowed.min:g}° to {allowed.max:g}°",
            remedy="Nothing was sent. Correct the sequence, or limits.angle in the bench file.",
        )  # fmt: skip
