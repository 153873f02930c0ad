"""Settings of simulated SCPI instruments without effect on the simulation: they are stored and reported."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from simulators.instruments.scpi import ILLEGAL_VALUE, Handler, Refusal, setting, switch


@dataclass(frozen=True, slots=True)
class StoredSetting:
    """A setting: its default, and the format of its value, which raises Refusal."""

    default: str
    reported: Callable[[str], str]


def stored_number(default: float, low: float, high: float, format_value: Callable[[float], str]) -> StoredSetting:
    """A number in a range."""
    return StoredSetting(format_value(default), lambda argument: format_value(setting(argument, low, high)))


def stored_switch(default: str) -> StoredSetting:
    """On or off, reported as 1 or 0."""
    return StoredSetting(default, lambda argument: str(int(switch(argument))))


def stored_word(default: str, *words: str) -> StoredSetting:
    """One of some words in the notation of manuals, `GUARd`; reported in short form."""
    short = {word.upper(): "".join(letter for letter in word if not letter.islower()) for word in words}
    found = short | {word: word for word in short.values()}

    def reported(argument: str) -> str:
        if argument.upper() not in found:
            raise Refusal(ILLEGAL_VALUE)
        return found[argument.upper()]

    return StoredSetting(default, reported)


class StoredSettings:
    """Settings by header."""

    def __init__(self, settings: Mapping[str, StoredSetting]) -> None:
        self._settings = settings
        self._values: dict[object, str] = {}

    def __getitem__(self, header: str) -> str:
        return self._values.get(header, self._settings[header].default)

    def commands(self) -> dict[str, Handler]:
        """Handlers of settings and queries, by header."""
        setters = {header: self._setter(header) for header in self._settings}
        return setters | {f"{header}?": self._query_handler(header) for header in self._settings}

    def reset(self) -> None:
        """Reset all settings to their defaults."""
        self._values.clear()

    def _setter(self, header: str) -> Handler:
        def store(argument: str) -> None:
            self._values[header] = self._settings[header].reported(argument)

        return store

    def _query_handler(self, header: str) -> Handler:
        return lambda _: self[header]
