"""Current sources for sinstruments, a synchrotron's framework for simulators: `python -m sinstruments -c FILE`.

Written from what is known of the wire, with nothing of our own drivers or simulators: connections, the pseudo-terminal
and where a line ends are sinstruments's. As in IEEE 488.2, a message is commands joined by `;`, and so are its answers.
"""

from collections.abc import Mapping
from typing import ClassVar

from sinstruments.simulator import BaseDevice


class Source(BaseDevice):
    """A source with settings that are kept as they are spelled; a number beyond its limits is refused."""

    joined_by = ";"
    identity: str
    power_on: ClassVar[Mapping[str, str]]  # header → value
    most: ClassVar[Mapping[str, float]]

    def __init__(self, name: str, **options: object) -> None:
        super().__init__(name, **options)
        self.values = dict(self.power_on)
        self.errors = ['-113,"Undefined header"']  # left there by somebody else

    def handle_message(self, message: bytes) -> bytes | None:
        commands = message.decode("ascii").strip().upper().split(";")
        answers = [answer for command in commands if (answer := self.carry_out(command.strip())) is not None]
        return self.joined_by.join(answers).encode("ascii") + self.newline if answers else None

    def carry_out(self, command: str) -> str | None:
        header, _, value = command.partition(" ")
        header = header.removeprefix(":")
        if header == "*IDN?":
            return self.identity
        if header == "SYST:ERR?":
            return self.errors.pop(0) if self.errors else '0,"No error"'
        if header.endswith("?") and header[:-1] in self.values:
            return self.values[header[:-1]]
        if header not in self.values:
            self.errors.append('-113,"Undefined header"')
        elif abs(float(value) if header in self.most else 0.0) > self.most.get(header, 0.0):
            self.errors.append('-222,"Parameter data out of range"')
        else:
            self.values[header] = {"ON": "1", "OFF": "0"}.get(value, value)
        return None


class GS200(Source):
    identity = "YOKOGAWA,GS210,91W000001,2.02"
    power_on: ClassVar = {"SOUR:FUNC": "VOLT", "SOUR:RANG": "1E+0", "SOUR:LEV": "0.00000E+0", "SOUR:PROT:VOLT": "30",
                "OUTP": "0", "STAT:COND": "0"}  # fmt: skip
    most: ClassVar = {"SOUR:RANG": 0.2, "SOUR:LEV": 0.2, "SOUR:PROT:VOLT": 30}

    def carry_out(self, command: str) -> str | None:
        before = self.values["SOUR:FUNC"]
        answer = super().carry_out(command)
        if before != self.values["SOUR:FUNC"]:  # another quantity has ranges of its own
            self.values |= {"SOUR:RANG": "1E-3", "SOUR:LEV": "0.0000E-3"}
        return answer


class Keithley6220(Source):
    newline = b"\r"
    joined_by = "; "
    identity = "KEITHLEY INSTRUMENTS INC.,MODEL 6220,1234567,A03  /700x"
    power_on: ClassVar = {"SOUR:CURR": "0.0000E+00", "SOUR:CURR:RANG": "1.0000E-01", "SOUR:CURR:RANG:AUTO": "1",
                "SOUR:CURR:COMP": "1.0000E+01", "OUTP": "0", "STAT:MEAS:COND": "0"}  # fmt: skip
    most: ClassVar = {"SOUR:CURR": 0.105, "SOUR:CURR:RANG": 0.1, "SOUR:CURR:COMP": 105}

    def carry_out(self, command: str) -> str | None:
        answer = super().carry_out(command)
        if command.startswith((":SOUR:CURR:RANG ", "SOUR:CURR:RANG ")):
            self.values["SOUR:CURR:RANG:AUTO"] = "0"
        return answer
