"""A Prologix GPIB-ETHERNET gateway in front of one instrument: its own commands, on lines that begin with `++`.

Source: its user manual (version 1.6.6). A setting without a value is a query, commands have no answer, and unknown ones
are answered by `Unrecognized command`.
"""

from __future__ import annotations

from collections.abc import Mapping

VERSION = "Prologix GPIB-ETHERNET Controller version 01.06.06.00"
UNKNOWN = "Unrecognized command"
ADDRESS = 22  # of the instrument
_MOST: Mapping[str, int] = {
    "mode": 1, "addr": 30, "auto": 1, "eoi": 1, "eos": 3, "eot_enable": 1, "eot_char": 255, "read_tmo_ms": 3000,
    "savecfg": 1, "lon": 0, "status": 255,
}  # fmt: skip
_STORED = {"mode": 1, "addr": ADDRESS, "auto": 1, "eoi": 1, "eos": 2, "read_tmo_ms": 3000, "savecfg": 1}
_DONE = ("clr", "ifc", "llo", "loc", "rst", "trg", "savecfg", "read")


class Gateway:
    """Its settings: as our page on the meter has them saved, with an automatic read after every line."""

    def __init__(self) -> None:
        self._settings = dict.fromkeys(_MOST, 0) | _STORED

    @property
    def reads_by_itself(self) -> bool:
        """True if answers of the instrument are passed on without `++read`."""
        return self._settings["auto"] == 1

    @property
    def reaches_the_instrument(self) -> bool:
        """True if data go to the instrument, and not to another address."""
        return self._settings["mode"] == 1 and self._settings["addr"] == ADDRESS

    def execute(self, line: str, status: str) -> str:
        """Answer of the gateway itself to a line; `status` is the status byte of the instrument."""
        name, *arguments = line.removeprefix("++").lower().split()
        if name == "ver":
            return VERSION
        if name == "spoll":
            return status
        if name == "srq":
            return str(int(int(status) >= 64))
        if name in _MOST and not arguments and name != "savecfg":
            return str(self._settings[name])
        if name in _MOST and arguments[:1] and arguments[0].isdecimal() and int(arguments[0]) <= _MOST[name]:
            self._settings[name] = int(arguments[0])
            return ""
        return "" if name in _DONE else UNKNOWN
