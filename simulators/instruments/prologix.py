"""A Prologix GPIB-ETHERNET gateway in front of one instrument: its own commands, on lines that begin with `++`.

After its user manual (version 1.6.6): settings are told when they are asked without a value, commands are answered by
nothing, and what it does not know by `Unrecognized command`.
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
_KEPT = {"mode": 1, "addr": ADDRESS, "auto": 1, "eoi": 1, "eos": 2, "read_tmo_ms": 3000, "savecfg": 1}
_DONE = ("clr", "ifc", "llo", "loc", "rst", "trg", "savecfg", "read")


class Gateway:
    """Its settings: as our page on the meter has them saved, reading an answer after every line."""

    def __init__(self) -> None:
        self._settings = dict.fromkeys(_MOST, 0) | _KEPT

    @property
    def reads_by_itself(self) -> bool:
        """Whether answers of the instrument are passed on without `++read`."""
        return self._settings["auto"] == 1

    @property
    def reaches_the_instrument(self) -> bool:
        """Whether data go to the instrument, and not to another address or nowhere."""
        return self._settings["mode"] == 1 and self._settings["addr"] == ADDRESS

    def execute(self, line: str, status: str) -> str:
        """What the gateway itself answers to a line; `status` is the status byte of the instrument."""
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
