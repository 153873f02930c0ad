"""Uninterruptible power supply of the bench computer in the bench file."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import BeforeValidator, Field, WithJsonSchema

from drivers.schema.fields import PositiveSeconds, StrictModel
from drivers.schema.wording import expected

PORT = 3493  # port of upsd
_ADDRESS = r"([\w.-]+)@([\w.-]+|\[[0-9A-Fa-f:]+\])(?::(\d{1,5}))?"


class Supply(NamedTuple):
    """Name of a supply, and host and port of its `upsd`."""

    name: str
    host: str
    port: int = PORT

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse NAME@HOST or NAME@HOST:PORT. Raises ValueError."""
        found = re.fullmatch(_ADDRESS, text)
        if found is None or not 0 < int(found[3] or PORT) < 65536:
            raise ValueError(text)
        return cls(found[1], found[2].strip("[]"), int(found[3] or PORT))


def _supply(raw: Any) -> Supply:
    try:
        return raw if isinstance(raw, Supply) else Supply.parse(raw)
    except (TypeError, ValueError):
        raise expected("NAME@HOST or NAME@HOST:PORT, as in bench@localhost", raw) from None


class PowerEntry(StrictModel):
    """Uninterruptible power supply of the computer, by Network UPS Tools, and the action of a run on battery."""

    ups: Annotated[Supply, BeforeValidator(_supply), WithJsonSchema({"type": "string"})] = Field(
        description="NAME@HOST or NAME@HOST:PORT of its upsd"
    )
    on_battery: Literal["stop", "hold", "continue"] = Field(
        "continue",
        description="end the run at once, begin no step until line power is back, or go on; the last two for at most "
        "`after`; a run always ends when the battery is low",
    )
    after: PositiveSeconds = Field(300.0, description="the longest time on battery with `hold` and `continue`")
