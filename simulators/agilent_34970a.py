"""An Agilent 34970A scanner with sensors in the chamber: scan list, sensors, units, scans that take their time."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import ClassVar, Self

import numpy as np

from drivers import scpi
from drivers.agilent_34970a import wire
from drivers.agilent_34970a.wire import Condition
from drivers.scpi import ErrorEntry
from simulators.faults import MEASURES_AND_OBEYS, FaultKind, FaultPlan, Mishap
from simulators.scpi import (
    ILLEGAL_VALUE,
    OUT_OF_RANGE,
    SETTINGS_CONFLICT,
    Handler,
    Interpreter,
    Refusal,
    switch,
)
from simulators.serve import Later
from simulators.setup import InstrumentSetup
from simulators.world import World

STALE = ErrorEntry(-230, "Data corrupt or stale")
IDENTITY = "HEWLETT-PACKARD,34970A,0,13-2-2"
_CHANNELS_OF_A_CARD = 20
_SENSOR_S = 0.2
_CONFIGURATION = re.compile(r"(TC,[BEJKNRST]|F?RTD,(?:85|91)),(\(@.*\))")
_FORMATS = ("UNIT", "TIME", "CHANnel", "ALARm")


class SimulatedScanner:
    """A scanner with a card of 20 channels in each slot of `slots`.

    A sensor whose name is that of a place is on the unit there; any other is in the air of the chamber. A scan takes
    0.2 s for each sensor. `frozen`: readings repeat.
    """

    def __init__(
        self, world: World, faults: FaultPlan, names: Mapping[int, str], *, identity: str = IDENTITY,
        answer_end: bytes = b"\n",
    ) -> None:  # fmt: skip
        self.faults = faults
        self.open: set[int] = set()
        self.answer_end = answer_end
        self._world, self._names = world, names
        self._slots = {channel // 100 * 100 for channel in names}
        self._last: dict[int, float] = {}
        self._begun_s: float | None = None
        self._memory = ""
        self.scan: tuple[int, ...] = ()
        self._reset()
        self._interpreter = Interpreter(identity, self._commands())

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """As a bench file has it; with a serial number it is the later model, which tells it."""
        identity = IDENTITY
        if setup.model == "34972A":
            identity = f"Agilent Technologies,34972A,{setup.serial or 'SIM-34972A-01'},1.16-1.12-02-02"
        end = b"\r\n" if setup.is_serial_line else b"\n"
        return cls(setup.world, setup.faults, setup.options.names(), identity=identity, answer_end=end)

    def session(self) -> ScannerSession:
        """A new connection."""
        return ScannerSession(self)

    def execute(self, message: str) -> str:
        """Carries out a message that is no scan; its answers."""
        return self._interpreter.execute(message)

    def open_sensors(self) -> None:
        """The plug with all sensors comes off."""
        self.open.update(self._names)

    def close_sensors(self) -> None:
        """It is in place again."""
        self.open.clear()

    def restart(self) -> None:
        """The mains fail for a moment: nothing is scanned any more."""
        self._reset()
        self._interpreter.power_on()

    def begin_scan(self) -> float | None:
        """Begins a scan; how long it takes (s), None when nothing is to be scanned or a scan is under way."""
        if not self.scan or self._begun_s is not None:
            self._interpreter.note(SETTINGS_CONFLICT)
            return None
        self._begun_s, self._memory = self._world.look(), ""
        return _SENSOR_S * len(self.scan)

    def end_scan(self) -> str:
        """The readings of the scan under way, "" when the mains have failed meanwhile."""
        begun_s, self._begun_s = self._begun_s, None
        if begun_s is None:
            return ""
        self._world.look()
        return ",".join(
            self._spelled(channel, begun_s, number * _SENSOR_S) for number, channel in enumerate(self.scan, start=1)
        )

    def keep(self, readings: str) -> str:
        """Readings of a scan that was initiated: they stay in memory until the next scan."""
        self._memory = readings
        return readings

    def remembered(self) -> str:
        """What is in memory; nothing after READ?, whose readings are in none."""
        if not self._memory:
            self._interpreter.note(STALE)
        return self._memory

    def _spelled(self, channel: int, begun_s: float, since_s: float) -> str:
        unit = self.units.get(channel, "C")
        reading = self._reading_c(channel, begun_s + since_s)
        shown = wire.OVERLOAD if reading is None else reading * 1.8 + 32 if unit == "F" else reading
        fields = [f"{shown:+.8E}" + (f" {unit}" if self.formats["UNIT"] else "")]
        if self.formats["TIME"]:
            fields.append(f"{since_s:012.3f}")
        if self.formats["CHANnel"]:
            fields.append(str(channel))
        return ",".join(fields)

    def _reading_c(self, channel: int, at_s: float) -> float | None:
        """What a sensor reads at a true time, None when it is open."""
        name = self._names.get(channel, "")
        unit = self._world.counted.get(name)
        if channel in self.open or (unit is not None and unit.faults.active("open_thermometer")):
            return None
        if not (self.faults.active("frozen") and channel in self._last):
            self._last[channel] = (
                self._world.thermal.air_c if unit is None else float(unit.thermometer_c(np.array([at_s]))[0])
            )
        return self._last[channel]

    def _commands(self) -> dict[str, Handler]:
        commands: dict[str, Handler] = {
            "SYSTem:REMote": lambda _: None,
            "ABORt": lambda _: self._abort(),
            "TRIGger:SOURce": lambda _: None,
            "TRIGger:COUNt": lambda _: None,
            "FORMat:READing:TIME:TYPE": lambda _: None,
            wire.CONFIGURE: self._unless_stuck(self._configure),
            wire.SCAN: self._unless_stuck(self._set_scan),
            f"{wire.SCAN}?": lambda _: self._block(),
            wire.UNIT: self._unless_stuck(self._set_unit),
            f"{wire.UNIT}?": lambda argument: self._of_each(argument, lambda channel: self.units.get(channel, "C")),
            f"{wire.KIND}?": lambda argument: self._of_each(argument, lambda channel: self._sensor(channel)[0]),
            f"{wire.CONDITION}?": lambda _: str(0 if self._begun_s is None else int(Condition.SCANNING)),
            f"{wire.CARD}?": self._card,
            "*RST": lambda _: self._reset(),
        }
        for header in wire.TYPES.values():
            commands[f"{header}?"] = lambda argument: self._of_each(argument, self._type)
        for name in _FORMATS:
            commands[f"FORMat:READing:{name}"] = self._unless_stuck(self._format(name))
        return commands

    def _unless_stuck(self, handler: Handler) -> Handler:
        return lambda argument: None if self.faults.active("stuck") else handler(argument)

    def _configure(self, argument: str) -> None:
        match = _CONFIGURATION.fullmatch(argument.upper())
        if match is None:
            raise Refusal(ILLEGAL_VALUE)
        kind, channels = match[1].partition(",")[0], self._channels(match[2])
        if kind == "FRTD" and any(channel % 100 > _CHANNELS_OF_A_CARD // 2 for channel in channels):
            raise Refusal(SETTINGS_CONFLICT)
        self.sensors.update(dict.fromkeys(channels, match[1]))
        self.scan = channels

    def _set_scan(self, argument: str) -> None:
        self.scan = self._channels(argument)

    def _set_unit(self, argument: str) -> None:
        unit, _, channels = argument.upper().partition(",")
        if unit not in ("C", "F"):
            raise Refusal(ILLEGAL_VALUE)
        self.units.update(dict.fromkeys(self._channels(channels), unit))

    def _channels(self, argument: str) -> tuple[int, ...]:
        """A list of channels in the order of a scan; raises Refusal for one that no card has."""
        try:
            channels = wire.read_channels(f"#3{len(argument):03d}{argument}")
        except ValueError:
            raise Refusal(ILLEGAL_VALUE) from None
        if any(channel // 100 * 100 not in self._slots or not 1 <= channel % 100 <= _CHANNELS_OF_A_CARD
               for channel in channels):  # fmt: skip
            raise Refusal(OUT_OF_RANGE)
        return tuple(sorted(set(channels)))

    def _of_each(self, argument: str, tell: Callable[[int], str]) -> str:
        return ",".join(tell(channel) for channel in self._channels(argument))

    def _sensor(self, channel: int) -> tuple[str, str]:
        kind, _, type_ = self.sensors.get(channel, "TC,J").partition(",")
        return kind, type_

    def _type(self, channel: int) -> str:
        kind, type_ = self._sensor(channel)
        return type_ if kind == "TC" else f"+{type_}"

    def _block(self) -> str:
        body = wire.listed(self.scan)
        return f"#{len(str(len(body)))}{len(body)}{body}"

    def _card(self, argument: str) -> str:
        return "HEWLETT-PACKARD,34901A,0,2.3" if argument.isdigit() and int(argument) in self._slots else "0,0,0,0"

    def _format(self, name: str) -> Handler:
        def put(argument: str) -> None:
            self.formats[name] = switch(argument)

        return put

    def _abort(self) -> None:
        self._begun_s = None

    def _reset(self) -> None:
        self._begun_s = None
        self.scan = ()
        self.sensors: dict[int, str] = {}
        self.units: dict[int, str] = {}
        self.formats = dict.fromkeys(_FORMATS, False)

    MISHAPS: ClassVar[Mapping[FaultKind, Mishap]] = {
        **MEASURES_AND_OBEYS,
        "restart": Mishap(restart),
        "open_sensor": Mishap(open_sensors, close_sensors),
    }


class ScannerSession:
    """A connection: a scan is answered when it is over, everything else at once; lines end with LF or CR LF."""

    def __init__(self, scanner: SimulatedScanner) -> None:
        self._scanner = scanner
        self._later: Later = lambda _delay_s, _answer: None
        self._rest = b""

    def answer_by(self, later: Later) -> None:
        """How a scan is said when it is over; without it, it never is."""
        self._later = later

    def feed(self, data: bytes) -> bytes:
        """Takes bytes in any portions; the answers that are there at once."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        return b"".join(self._spoken(self._carry_out(line.decode("latin-1").strip())) for line in lines)

    def _carry_out(self, line: str) -> str:
        match tuple(command.header for command in scpi.commands(line)):
            case ("READ?",):
                return self._scan(lambda readings: readings)
            case ("INIT", "FETC?"):
                return self._scan(self._scanner.keep)
            case ("FETC?",):
                return self._scanner.remembered()
        return self._scanner.execute(line)

    def _scan(self, kept: Callable[[str], str]) -> str:
        takes_s = self._scanner.begin_scan()
        if takes_s is not None:
            self._later(takes_s, lambda: self._spoken(kept(self._scanner.end_scan())))
        return ""

    def _spoken(self, answer: str) -> bytes:
        return answer.encode() + self._scanner.answer_end if answer else b""
