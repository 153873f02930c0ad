"""Settings of simulated SCPI instruments without effect on the simulation: they are stored and reported."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from simulators.instruments.scpi import ILLEGAL_VALUE, Handler, Refusal, setting, switch


@dataclass(frozen=True, slots=True)
class Kept:
    """A setting: its default, and the format of its value, which raises Refusal."""

    first: str
    told: Callable[[str], str]


def kept_number(first: float, low: float, high: float, spell: Callable[[float], str]) -> Kept:
    """A number in a range."""
    return Kept(spell(first), lambda argument: spell(setting(argument, low, high)))


def kept_switch(first: str) -> Kept:
    """On or off, reported as 1 or 0."""
    return Kept(first, lambda argument: str(int(switch(argument))))


def kept_word(first: str, *words: str) -> Kept:
    """One of some words in the notation of manuals, `GUARd`; reported in short form."""
    short = {word.upper(): "".join(letter for letter in word if not letter.islower()) for word in words}
    found = short | {word: word for word in short.values()}

    def told(argument: str) -> str:
        if argument.upper() not in found:
            raise Refusal(ILLEGAL_VALUE)
        return found[argument.upper()]

    return Kept(first, told)


class KeptSettings:
    """Settings by header."""

    def __init__(self, settings: Mapping[str, Kept]) -> None:
        self._settings = settings
        self._told: dict[str, str] = {}

    def __getitem__(self, header: str) -> str:
        return self._told.get(header, self._settings[header].first)

    def commands(self) -> dict[str, Handler]:
        """Handlers of settings and queries, by header."""
        setters = {header: self._setter(header) for header in self._settings}
        return setters | {f"{header}?": self._teller(header) for header in self._settings}

    def reset(self) -> None:
        """Reset all settings to their defaults."""
        self._told.clear()

    def _setter(self, header: str) -> Handler:
        def put(argument: str) -> None:
            self._told[header] = self._settings[header].told(argument)

        return put

    def _teller(self, header: str) -> Handler:
        return lambda _: self[header]
