"""Prompts to the operator of a hand-turned head."""

from __future__ import annotations

from drivers.values import Approach

_COMING: dict[Approach, str] = {
    "direct": "", "from_below": ", coming to it from below", "from_above": ", coming to it from above",
}  # fmt: skip


def spelled(angle_deg: float) -> str:
    """Format an angle as read off a dial; the last digit is 0.000001°."""
    return f"{round(angle_deg, 6) + 0.0:.12g}°"


def move_prompt(device: str, from_deg: float | None, to_deg: float, approach: Approach) -> str:
    """Prompt for a turn: target, start, direction, and final approach."""
    if from_deg is None:
        way = ""
    elif from_deg == to_deg:
        way = ", where it stands now" if approach == "direct" else ", where it stands now: away from it and back"
    else:
        way = f", from {spelled(from_deg)} {'up' if to_deg > from_deg else 'down'} by {spelled(abs(to_deg - from_deg))}"
    return (
        f"Turn {device} by hand to {spelled(to_deg)}{way}{_COMING[approach]}. When it is there and "
        "locked, type the angle that it shows, in ° or deg."
    )


def angle_prompt(device: str) -> str:
    """Prompt for the angle of a head whose angle is unknown."""
    return f"Leave {device} as it is, and type the angle that it shows, in ° or deg."


def rejected(typed_deg: float, requested_deg: float | None, why: str, prompt: str) -> str:
    """Repeat a prompt after an implausible answer."""
    asked = f", {spelled(requested_deg)} was asked for" if requested_deg is not None else ""
    return f"{spelled(typed_deg)} was typed{asked}: {why}. {prompt}"
