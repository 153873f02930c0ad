"""What bench files say of all devices that send CAN frames by themselves, described by a DBC."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

from pydantic_core import InitErrorDetails

from drivers.dbc_outline import outline
from drivers.fields import TextLike
from drivers.suggest import did_you_mean
from drivers.wording import problem_at

IDLE_BLOCK_S = 10.0  # how long frames are left together while nobody acquires

SignalName = Annotated[str, TextLike(r"\w+\.\w+", "Message.Signal, a name of the DBC")]


def text_of(dbc: Path) -> str:
    """The text of a DBC file, whatever its encoding."""
    return dbc.read_text(encoding="utf-8", errors="replace")


def signals_of(dbc: Path) -> Mapping[str, str]:
    """The signals of a DBC file: `Message.Signal` → unit."""
    return outline(text_of(dbc))


def temperatures_of(dbc: Path) -> Mapping[str, str]:
    """The signals with a unit of temperature: each is a reading."""
    return {name: unit for name, unit in signals_of(dbc).items() if unit == "°C"}


def unknown_signals(dbc: Path, named: Mapping[tuple[str | int, ...], str | None]) -> Iterator[InitErrorDetails]:
    """What names at their places the DBC does not have."""
    known = signals_of(dbc)
    for place, name in named.items():
        if name is not None and name not in known:
            yield problem_at(place, f"{dbc.name} has no signal '{name}'{did_you_mean(name, known)}")
