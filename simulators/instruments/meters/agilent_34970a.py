"""An Agilent 34970A scanner with sensors in the chamber: scan list, sensors, units, and scans of realistic duration.

Scans are triggered immediately or by the timer; triggers by bus, contact or alarm are not simulated, nor is any
measurement but temperature. Scans, memory and answers follow the user's guide (chapter 5); further queries of
third-party programs, such as relay cycles, are answered as by a new instrument.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from typing import ClassVar, Self

import numpy as np

from drivers.dialects.agilent_34970a import wire
from drivers.dialects.agilent_34970a.wire import Condition
from drivers.protocols.scpi import Command, ErrorEntry
from simulators.faults.instrument_faults import MEASUREMENT_AND_COMMAND_FAULTS, FaultEffect, FaultKind, FaultPlan
from simulators.instruments.meters.scanner_session import ScannerSession
from simulators.instruments.meters.scanner_settings import ChannelSettings
from simulators.instruments.meters.scanner_sweeps import MEMORY_READINGS, Scans, StoredReading, exponential
from simulators.instruments.scpi import (
    ILLEGAL_VALUE,
    OUT_OF_RANGE,
    SETTINGS_CONFLICT,
    Handler,
    Interpreter,
    Refusal,
    ScpiInstrument,
    setting,
    switch,
)
from simulators.instruments.setup import InstrumentSetup
from simulators.world import World

STALE = ErrorEntry(-230, "Data corrupt or stale")
IDENTITY = "HEWLETT-PACKARD,34970A,0,13-2-2"
NO_CARD = "HEWLETT-PACKARD,0,0,0"
_CHANNELS_OF_A_CARD = 20
_CONFIGURATION = re.compile(r"(TC,(?:[BEJKNRST]|DEF)|F?RTD,(?:85|91|DEF)|DEF)(?:,1(?:,(?:MIN|MAX|DEF))?)?,(\(@.*\))")
_VOLTS = re.compile(r"(?:(?:[.\dE+-]+|AUTO|MIN|MAX|DEF)(?:,(?:[.\dE+-]+|MIN|MAX|DEF))?,\s*)?(\(@.*\))")
_DEFAULT_TYPES = {"TC": "J", "RTD": "85", "FRTD": "85"}
_LIST = re.compile(r"\(@\s*((?:\d{3}(?::\d{3})?(?:\s*,\s*\d{3}(?::\d{3})?)*)?)\s*\)")
_FORMATS = ("UNIT", "TIME", "CHANnel", "ALARm")
_NOTHING_HAPPENS = ("SYSTem:REMote", "SYSTem:LOCal", "DISPlay[:STATe]", "DISPlay:TEXT", "ROUTe:OPEN", "ROUTe:CLOSe")
_UNITS: Mapping[str, Callable[[float], float]] = {
    "C": lambda celsius: celsius, "F": lambda celsius: celsius * 1.8 + 32, "K": lambda celsius: celsius + 273.15,
}  # fmt: skip


class SimulatedScanner(ScpiInstrument):
    """A scanner with a card of 20 channels in each slot of `slots`.

    A sensor named like a place is on the unit there; any other is in the air of the chamber. A scan takes 0.2 s for
    each sensor; its readings are computed on request. `frozen`: readings repeat.
    """

    def __init__(
        self, world: World, faults: FaultPlan, names: Mapping[int, str], *, identity: str = IDENTITY,
        answer_end: bytes = b"\n",
    ) -> None:  # fmt: skip
        self.faults = faults
        self.open: set[int] = set()
        self.answer_end = answer_end
        self._world, self.names = world, names
        self._slots = {channel // 100 * 100 for channel in names}
        self._last: dict[int, float] = {}
        self._scans = Scans(world, self._reading_c)
        self._settings = ChannelSettings(self._channels)
        self.scan: tuple[int, ...] = ()
        self.monitored: tuple[int, ...] = ()
        self._reset()
        self._interpreter = Interpreter(identity, self._commands(), signed=True)

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file; with a serial number it is the later model, which reports it."""
        identity = IDENTITY
        if setup.model == "34972A":
            identity = f"Agilent Technologies,34972A,{setup.serial or 'SIM-34972A-01'},1.16-1.12-02-02"
        end = b"\r\n" if setup.is_serial_line else b"\n"
        return cls(setup.world, setup.faults, setup.options.names(), identity=identity, answer_end=end)

    def session(self) -> ScannerSession:
        """Open a connection."""
        return ScannerSession(self)

    def carry_out(self, command: Command) -> str | None:
        """Execute a command that does not wait for a scan; return its answer."""
        return self._interpreter.carry_out(command)

    def joined(self, answers: list[str]) -> str:
        """Join the answers to one line."""
        return self._interpreter.joined(answers)

    def begin_scan(self, *, kept: bool = True) -> float | None:
        """Begin a scan; return its duration (s), or None if there is nothing to scan or a scan is running."""
        return self._noting(lambda: self._scans.begin(self.scan, kept=kept))

    def begin_measurement(self, argument: str, *, volts: bool) -> float | None:
        """Configure channels as CONF:TEMP or CONF:VOLT does and begin a scan of them; as `begin_scan`."""

        def begin() -> float:
            (self._configure_volts if volts else self._configure)(argument)
            return self._scans.begin(self.scan, kept=False)

        return self._noting(begin)

    def _noting(self, begin: Callable[[], float]) -> float | None:
        try:
            return begin()
        except Refusal as refusal:
            self._interpreter.note(refusal.entry)
            return None

    def left_s(self) -> float:
        """Remaining time of the running scan (s), 0 without one."""
        return self._scans.left_s()

    def end_scan(self) -> str:
        """Readings of the finished scan, "" if there is none, or after a power failure."""
        return self._spelled(self._scans.end())

    def _fetch(self, _: str) -> str:
        """Readings in memory; none after READ?, whose readings are not stored."""
        memory = self._scans.stored_readings()
        if not memory:
            raise Refusal(STALE)
        return self._spelled(memory)

    def _remove(self, argument: str) -> str:
        """Take the oldest readings out of the memory."""
        memory = self._scans.stored_readings()
        count = round(setting(argument, 1, MEMORY_READINGS))
        if count > len(memory):
            raise Refusal(STALE)
        return self._spelled([memory.popleft() for _ in range(count)])

    def _read_out(self, argument: str) -> str:
        """The same as a block, with the available number of readings."""
        memory = self._scans.stored_readings()
        count = min(len(memory), round(setting(argument or str(MEMORY_READINGS), 1, MEMORY_READINGS)))
        return _block(self._spelled([memory.popleft() for _ in range(count)]))

    def _spelled(self, readings: Iterable[StoredReading]) -> str:
        return ",".join(self._spelled_one(reading) for reading in readings)

    def _spelled_one(self, reading: StoredReading) -> str:
        unit, shown = self.units.get(reading.channel, "C"), reading.temperature_c
        if reading.channel in self.volts:
            unit = "VDC"
        elif shown is not None:
            shown = _UNITS[unit](shown)
        fields = [exponential(wire.OVERLOAD if shown is None else shown) + (f" {unit}" if self.formats["UNIT"] else "")]
        if self.formats["TIME"]:
            fields.append(f"{reading.since_s:012.3f}")
        if self.formats["CHANnel"]:
            fields.append(str(reading.channel))
        if self.formats["ALARm"]:
            fields.append("0")
        return ",".join(fields)

    def _reading_c(self, channel: int, at_s: float) -> float | None:
        """Reading of a sensor at a true time, None if it is open."""
        if channel in self.volts:
            return 0.0  # no voltage source there
        name = self.names.get(channel, "")
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
            "ABORt": lambda _: self._scans.abort(),
            "INITiate[:IMMediate]": lambda _: self._begin(),
            "FETCh?": self._fetch,
            "DATA:POINts?": lambda _: f"{len(self._scans.stored_readings()):+d}",
            "DATA:REMove?": self._remove,
            "R?": self._read_out,
            "FORMat:READing:TIME:TYPE": lambda _: None,
            wire.CONFIGURE: self.unless_stuck(self._configure),
            wire.SCAN: self.unless_stuck(self._set_scan),
            f"{wire.SCAN}?": lambda _: _block(wire.listed(self.scan)),
            f"{wire.SCAN}:SIZE?": lambda _: f"{len(self.scan):+d}",
            wire.UNIT: self.unless_stuck(self._set_unit),
            f"{wire.UNIT}?": lambda argument: self._of_each(argument, lambda channel: self.units.get(channel, "C")),
            f"{wire.KIND}?": lambda argument: self._of_each(argument, lambda channel: self._sensor(channel)[0]),
            "[SENSe:]FUNCtion?": lambda argument: self._of_each(argument, self._function),
            "CONFigure:VOLTage[:DC]": self.unless_stuck(self._configure_volts),
            "CONFigure?": lambda argument: self._of_each(argument, self._configured),
            "ROUTe:MONitor": self.unless_stuck(self._set_monitor),
            "ROUTe:MONitor?": lambda _: _block(wire.listed(self.monitored)),
            "ROUTe:MONitor:STATe": self.unless_stuck(self._switch_monitor),
            "ROUTe:MONitor:STATe?": lambda _: str(int(self.monitors)),
            "ROUTe:MONitor:DATA?": lambda _: self._monitor(),
            f"{wire.CONDITION}?": lambda _: f"{int(Condition.SCANNING) if self.left_s() else 0:+d}",
            f"{wire.CARD}?": self._card,
            "DIAGnostic:DMM:CYCLes?": lambda _: "+0,+0,+0",
            "DIAGnostic:RELay:CYCLes?": lambda argument: self._of_each(argument, lambda _: "+0"),
            "DIAGnostic:PEEK:SLOT:DATA?": lambda _: '"          "',
            "*RST": lambda _: self._reset(),
            **dict.fromkeys(_NOTHING_HAPPENS, lambda _: None),
            **self._scans.commands(),
            **self._settings.commands(),
        }
        for header in wire.TYPES.values():
            commands[f"{header}?"] = lambda argument: self._of_each(argument, self._type)
        for name in _FORMATS:
            commands[f"FORMat:READing:{name}"] = self.unless_stuck(self._format(name))
            commands[f"FORMat:READing:{name}?"] = self._formatted(name)
        return commands

    def _begin(self) -> None:
        self.begin_scan()

    def _configure(self, argument: str) -> None:
        match = _CONFIGURATION.fullmatch(argument.upper())
        if match is None:
            raise Refusal(ILLEGAL_VALUE)
        kind, _, type_ = match[1].partition(",")
        kind = kind.replace("DEF", "TC")
        channels = self._channels(match[2])
        if kind == "FRTD" and any(channel % 100 > _CHANNELS_OF_A_CARD // 2 for channel in channels):
            raise Refusal(SETTINGS_CONFLICT)
        sensor = (kind, _DEFAULT_TYPES[kind] if type_ in ("", "DEF") else type_)
        self.sensors.update(dict.fromkeys(channels, sensor))
        self.volts -= set(channels)
        self.scan = channels

    def _configure_volts(self, argument: str) -> None:
        match = _VOLTS.fullmatch(argument.upper())
        if match is None:
            raise Refusal(ILLEGAL_VALUE)
        self.scan = self._channels(match[1])
        self.volts |= set(self.scan)

    def _function(self, channel: int) -> str:
        return '"VOLT"' if channel in self.volts else '"TEMP"'

    def _configured(self, channel: int) -> str:
        """Configuration of a channel, with its constant range and resolution."""
        if channel in self.volts:
            return f'"VOLT {exponential(10.0)},{exponential(3e-5)}"'
        return f'"TEMP {",".join(self._sensor(channel))},{exponential(1.0)},{exponential(3e-6)}"'

    def _set_monitor(self, argument: str) -> None:
        channels = self._channels(argument)
        if len(channels) != 1:
            raise Refusal(ILLEGAL_VALUE)
        self.monitored = channels

    def _switch_monitor(self, argument: str) -> None:
        self.monitors = switch(argument)

    def _monitor(self) -> str:
        """Reading of the monitored channel, without unit, time and channel; raises Refusal."""
        if not (self.monitors and self.monitored):
            raise Refusal(SETTINGS_CONFLICT)
        (channel,) = self.monitored
        value = self._reading_c(channel, self._world.now())
        return exponential(wire.OVERLOAD if value is None else value)

    def _set_scan(self, argument: str) -> None:
        self.scan = self._channels(argument)

    def _set_unit(self, argument: str) -> None:
        unit, _, channels = argument.upper().partition(",")
        if unit not in _UNITS:
            raise Refusal(ILLEGAL_VALUE)
        self.units.update(dict.fromkeys(self._channels(channels), unit))

    def _channels(self, argument: str) -> tuple[int, ...]:
        """Parse a channel list in scan order; empty means the scan list. Raises Refusal for a channel of no card."""
        if not argument:
            return self.scan
        found = _LIST.fullmatch(argument.strip())
        if found is None:
            raise Refusal(ILLEGAL_VALUE)
        channels: set[int] = set()
        for each in filter(None, found[1].replace(" ", "").split(",")):
            first, _, last = each.partition(":")
            channels.update(range(int(first), int(last or first) + 1))
        if any(channel // 100 * 100 not in self._slots or not 1 <= channel % 100 <= _CHANNELS_OF_A_CARD
               for channel in channels):  # fmt: skip
            raise Refusal(OUT_OF_RANGE)
        return tuple(sorted(channels))

    def _of_each(self, argument: str, answer: Callable[[int], str]) -> str:
        return ",".join(answer(channel) for channel in self._channels(argument))

    def _sensor(self, channel: int) -> tuple[str, str]:
        return self.sensors.get(channel, ("TC", "J"))

    def _type(self, channel: int) -> str:
        kind, type_ = self._sensor(channel)
        return type_ if kind == "TC" else f"+{type_}"

    def _card(self, argument: str) -> str:
        return "HEWLETT-PACKARD,34901A,0,2.3" if argument.isdigit() and int(argument) in self._slots else NO_CARD

    def _format(self, name: str) -> Handler:
        def put(argument: str) -> None:
            self.formats[name] = switch(argument)

        return put

    def _formatted(self, name: str) -> Handler:
        return lambda _: str(int(self.formats[name]))

    def _reset(self) -> None:
        self._scans.reset()
        self._settings.reset()
        self.scan = ()
        self.sensors: dict[int, tuple[str, str]] = {}
        self.units: dict[int, str] = {}
        self.volts: set[int] = set()
        self.monitored, self.monitors = (), False
        self.formats = dict.fromkeys(_FORMATS, False)

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **MEASUREMENT_AND_COMMAND_FAULTS,
        "restart": FaultEffect(ScpiInstrument.restart),
        "open_sensor": FaultEffect(
            lambda scanner: scanner.open.update(scanner.names), lambda scanner: scanner.open.clear()
        ),
    }


def _block(body: str) -> str:
    """Encode text as a definite block."""
    return f"#{len(str(len(body)))}{len(body)}{body}"
