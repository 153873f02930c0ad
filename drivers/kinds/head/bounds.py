"""Angle limits of the bench file for a head, checked before a command or a prompt is sent."""

from __future__ import annotations

from drivers.errors import BeyondLimit
from drivers.kinds.head.description import AngleRange


def check_angle(device: str, what: str, angle_deg: float, allowed: AngleRange) -> None:
    """Raise BeyondLimit for an angle outside `allowed`; `what` names the angle in the message."""
    if not allowed.min <= angle_deg <= allowed.max:
        raise BeyondLimit(
            device, f"{what} {angle_deg:g}° is outside {allowed.min:g}° to {allowed.max:g}°",
            remedy="Nothing was sent. Correct the sequence, or limits.angle in the bench file.",
        )  # fmt: skip
