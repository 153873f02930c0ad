"""A Keysight 3458A behind a gateway that passes lines on."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from drivers.dialects.keysight_3458a import wire
from simulators.faults.instrument_faults import MEASUREMENT_AND_COMMAND_FAULTS, FaultEffect, FaultKind, FaultPlan
from simulators.instruments.meters.meter_inputs import MeterInput
from simulators.instruments.prologix import Gateway
from simulators.serving.serve import DelayedAnswers
from simulators.units.unit_file import stream
from simulators.world import World

SYNTAX, UNDEFINED, OUT_OF_RANGE = 103, 105, 106
_ERRORS = {
    100: "HARDWARE ERROR", 102: "TRIGGER TOO FAST", SYNTAX: "SYNTAX ERROR", UNDEFINED: "UNDEFINED PARAMETER RECEIVED",
    OUT_OF_RANGE: "PARAMETER OUT OF RANGE", 109: "OUT OF CALIBRATION",
}  # fmt: skip
_ON_OFF = {"OFF": 0, "ON": 1}
_EVENTS = {"AUTO": 1, "EXT": 2, "SGL": 3, "HOLD": 4, "SYN": 5}
_CHOICES = {
    "TARM": _EVENTS, "TRIG": _EVENTS, "END": {**_ON_OFF, "ALWAYS": 2}, "INBUF": _ON_OFF, "OFORMAT": {"ASCII": 1},
    "QFORMAT": {"NUM": 0, "NORM": 1}, "AZERO": {**_ON_OFF, "ONCE": 2}, "MATH": {"OFF": 0, "NULL": 7},
    # Stored and reported, as used by third-party programs: no effect on the simulation.
    "LFILTER": _ON_OFF, "FIXEDZ": _ON_OFF, "LOCK": _ON_OFF, "BEEP": {**_ON_OFF, "ONCE": 2},
    "DISP": {**_ON_OFF, "MSG": 2, "CLR": 3}, "MEM": {"OFF": 0, "LIFO": 1, "FIFO": 2, "CONT": 3},
    "MFORMAT": {"ASCII": 1, "SINT": 2, "DINT": 3, "SREAL": 4, "DREAL": 5},
}  # fmt: skip
_STORED = {"LFILTER": 0, "FIXEDZ": 0, "LOCK": 0, "BEEP": 1, "DISP": 1, "MEM": 0, "MFORMAT": 4}
_PRESET = {"TARM": 1, "TRIG": 5, "INBUF": 0, "AZERO": 1, "OFORMAT": 1, "MATH": 0, **_STORED}
_POWER_ON = {**_PRESET, "TRIG": 1, "END": 0, "QFORMAT": 1}
_NUMBERS = {"NDIG": (7.0, 3.0, 8.0), "NRDGS": (1.0, 1.0, 1.0), "DELAY": (0.0, 0.0, 6000.0)}  # default range
_INSIDE_C = 36.5
_NPLC_MAX, _APERTURE_MAX_S = 1000.0, 1.0
_FUNCTIONS = {"DCV": (wire.DC_VOLTS, wire.RANGES_V), "DCI": (wire.DC_CURRENT, wire.RANGES_A)}
_OVER_RANGE, _OVER_1_A = 1.2, 1.05
_SWITCHING = ("DCV", "DCI", "RANGE", "NPLC", "APER", "AZERO")  # settings executed late with `lag`
_ERROR_BIT = 1 << 5  # bits of the status byte
_NOISE_NPLC = 10.0  # integration time for which the noise of its input is stated


class Simulated3458A:
    """A meter connected to an input; in another function it measures nothing.

    Commands received during a reading are executed after it. Without END a gateway cannot detect the end of answers, so
    they are not delivered. `frozen`: readings repeat. `stuck`: settings are accepted and not executed.
    """

    def __init__(
        self, world: World, faults: FaultPlan, connected: MeterInput, *, name: str = "voltmeter",
        line_hz: float = 50.0, identity: str = "HP3458A",
    ) -> None:  # fmt: skip
        self.faults = faults
        self.errors: set[int] = set()
        self._world, self.connected, self._line_hz = world, connected, line_hz
        self._noise = stream(world.settings.seed, "noise", name, "reading")
        self._read = 0.0
        self._answers: Mapping[str, Callable[[], str]] = {
            "ID?": lambda: identity,
            "REV?": lambda: "9,2",
            "CALNUM?": lambda: "12",
            "LFREQ?": lambda: _engineering(round(1e7 / round(1e7 / line_hz), 5)),
            "LINE?": lambda: _engineering(line_hz),
            "ERRSTR?": self._take_error,
            "ERR?": lambda: self._take_register(100),
            "AUXERR?": lambda: self._take_register(200),
            "STB?": lambda: str(_ERROR_BIT if self.errors else 0),
            "OPT?": lambda: "0",
            "TEMP?": lambda: _engineering(_INSIDE_C),
            "FUNC?": lambda: f"{self.function.code:g}, {self._range_spelled()}",
            "RANGE?": self._range_spelled,
            "NPLC?": lambda: _engineering(self.nplc),
            "APER?": lambda: _engineering(self.nplc / self._line_hz),
            "ARANGE?": lambda: str(int(self.full_scale is None)),
            "ISCALE?": lambda: _engineering(1.0),  # format of readings as text
            "MCOUNT?": lambda: "0",
            "TERM?": lambda: "1",  # terminals at the front
        }
        self.restart()
        world.integrate_with(self._catch_up)

    def session(self) -> VoltmeterSession:
        """Open a connection to the gateway."""
        return VoltmeterSession(self)

    def restart(self) -> None:
        """Short power failure: all settings are as at power-on."""
        self.codes: dict[str, int] = dict(_POWER_ON)
        self._numbers = {header: first for header, (first, _, _) in _NUMBERS.items()}
        self.function, self._ranges = _FUNCTIONS["DCV"]
        self.full_scale: float | None = None
        self.nplc = 10.0
        self._reading: _Aperture | None = None
        self._reading_ends_s = 0.0
        self._single = "TARM"  # the trigger that was last single
        self.errors.clear()

    @property
    def is_reading(self) -> bool:
        """True during a reading; one whose connection is closed ends unread."""
        if self._reading is not None and self._world.look() > self._reading_ends_s:
            self.end_reading()
        return self._reading is not None

    def execute(self, command: str) -> str:
        """Execute one command other than a trigger; return its answer, or "" for none."""
        header, *parameters = re.split(r"[ ,]+", command.upper())
        if header in self._answers:
            return self._answers[header]()
        if header.endswith("?") and header[:-1] in self.codes:
            return str(self.codes[header[:-1]])
        if header.endswith("?") and header[:-1] in self._numbers:
            return f"{self._numbers[header[:-1]]:g}"
        if header == "FUNC" and parameters:  # FUNC DCV,10 is DCV 10
            header, *parameters = parameters
        setting = partial(self._set, header, parameters[0] if parameters else "")
        if header in _SWITCHING:
            self.faults.carry_out(setting)
        elif not self.faults.active("stuck"):
            setting()
        return ""

    def triggered_by(self, command: str) -> bool:
        """Return whether a command triggers a reading: of the two triggers, one is single and the other passes."""
        header, *parameters = re.split(r"[ ,]+", command.upper())
        other = {"TARM": "TRIG", "TRIG": "TARM"}.get(header)
        if other is None or parameters[:1] != ["SGL"] or (header == "TRIG" and self.codes[other] != _EVENTS["AUTO"]):
            return False
        self._single = header
        return True

    def begin_reading(self) -> float:
        """Begin a triggered reading; return its duration (s)."""
        now_s = self._world.look()
        duration_s = wire.duration_s(self.nplc, self._line_hz)
        self._reading = _Aperture(now_s, now_s + duration_s - wire.last_zero_s(self.nplc, self._line_hz), now_s)
        self._reading_ends_s = now_s + duration_s
        return duration_s

    def end_reading(self) -> str:
        """Finish the reading and hold the trigger again; "" after a power failure meanwhile."""
        self._world.look()
        self._catch_up()
        reading, self._reading = self._reading, None
        if reading is None:
            return ""
        self.codes[self._single] = _EVENTS["HOLD"]
        if not self.faults.active("frozen"):
            mean = reading.input / (reading.integrated_s - reading.begin_s)
            noise = self.connected.noise * math.sqrt(_NOISE_NPLC / self.nplc) * float(self._noise.standard_normal())
            self._read = self.connected.read(mean, reading.end_s) + noise
        full_scale = self.full_scale or self._range_for(abs(self._read))
        beyond = abs(self._read) > _over(full_scale, self.function)
        return f"{math.copysign(wire.OVERLOAD, self._read) if beyond else self._read: .9E}"

    def _catch_up(self) -> None:
        """Integrate the input up to now, or to the end of the aperture, under the stimulus until now."""
        reading = self._reading
        if reading is None:
            return
        until_s = min(self._world.now(), reading.end_s)
        if until_s > reading.integrated_s:
            is_there = self.function == self.connected.function
            mean = self.connected.mean(reading.integrated_s, until_s) if is_there else 0.0
            reading.input += mean * (until_s - reading.integrated_s)
            reading.integrated_s = until_s

    def _set(self, header: str, parameter: str) -> None:
        match header:
            case "RESET":
                self.restart()
            case "PRESET":
                self.codes.update(_PRESET)
                self.function, self._ranges = _FUNCTIONS["DCV"]
                self.full_scale, self.nplc = None, 1.0
            case "DCV" | "DCI":
                self.function, self._ranges = _FUNCTIONS[header]
                self._set_range(parameter)
            case "NPLC":
                self._set_nplc(parameter)
            case "APER":
                aperture_s = self._number(parameter, _APERTURE_MAX_S)
                self.nplc = self.nplc if aperture_s is None else aperture_s * self._line_hz
            case "RANGE":
                self._set_range(parameter)
            case _ if header in _NUMBERS:
                self._set_number(header, parameter)
            case _ if header in _CHOICES:
                code = _CHOICES[header].get(parameter)
                if code is None:
                    self.errors.add(UNDEFINED)
                else:
                    self.codes[header] = code
            case _:
                self.errors.add(SYNTAX)

    def _set_range(self, parameter: str) -> None:
        if parameter in ("", "AUTO", "-1"):
            self.full_scale = None
        elif (most := self._number(parameter, self._ranges[-1])) is not None:
            self.full_scale = self._range_for(most)

    def _set_nplc(self, parameter: str) -> None:
        """Set the integration time in cycles: above one rounded up to integers, above ten to tens."""
        nplc = self._number(parameter, _NPLC_MAX)
        if nplc is not None:
            self.nplc = nplc if nplc < 1 else float(math.ceil(nplc) if nplc <= 10 else 10 * math.ceil(nplc / 10))

    def _set_number(self, header: str, parameter: str) -> None:
        _, low, high = _NUMBERS[header]
        number = self._number(parameter, high)
        if number is not None and number >= low:
            self._numbers[header] = number
        elif number is not None:
            self.errors.add(OUT_OF_RANGE)

    def _number(self, parameter: str, most: float) -> float | None:
        try:
            value = wire.read_number(parameter.encode())
        except ValueError:
            self.errors.add(UNDEFINED)
            return None
        if not 0 <= value <= most:
            self.errors.add(OUT_OF_RANGE)
            return None
        return value

    def _range_spelled(self) -> str:
        full_scale = self.full_scale or self._range_for(abs(self._read))
        return f"{full_scale:G}".removeprefix("0") if full_scale >= 1e-4 else _engineering(full_scale)

    def _range_for(self, most: float) -> float:
        """Smallest range for an input, the largest one if it exceeds all."""
        return next((each for each in self._ranges if most <= _over(each, self.function)), self._ranges[-1])

    def _take_error(self) -> str:
        """Read and clear the lowest error bit, auxiliary errors first."""
        if not self.errors:
            return '0,"NO ERROR"'
        code = min(self.errors, key=lambda code: (code < 200, code))
        self.errors.remove(code)
        return f'{code},"{_ERRORS.get(code, "HARDWARE ERROR")}"'

    def _take_register(self, first: int) -> str:
        """Read and clear the errors from `first` on, one bit each."""
        cleared = {code for code in self.errors if first <= code < first + 100}
        self.errors -= cleared
        return str(sum(1 << code - first for code in cleared))

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **MEASUREMENT_AND_COMMAND_FAULTS,
        "restart": FaultEffect(restart),
    }


@dataclass(slots=True)
class _Aperture:
    """A running reading: its input is measured from `begin_s` to `end_s`, and integrated so far (V·s or A·s)."""

    begin_s: float
    end_s: float
    integrated_s: float
    input: float = 0.0


class VoltmeterSession(DelayedAnswers):
    """A connection to the gateway: commands are queued, and only a reading takes time.

    Lines that begin with `++` are for the gateway; with `++auto 0` answers stay in the instrument until `++read`.
    """

    def __init__(self, meter: Simulated3458A) -> None:
        self._meter = meter
        self._rest = b""
        self._commands: deque[str] = deque()
        self._gateway = Gateway()
        self._unread: deque[bytes] = deque()

    def feed(self, data: bytes) -> bytes:
        """Receive bytes in any portions; return the immediate answers."""
        *received, self._rest = re.split(rb"[\r\n;]", self._rest + data)
        self._commands.extend(command for part in received if (command := part.decode("latin-1").strip()))
        return self._next_replies()

    def _next_replies(self) -> bytes:
        sent = b""
        while self._commands and not self._meter.is_reading:
            command = self._commands.popleft()
            if command.startswith("++"):
                sent += self._of_the_gateway(command)
            elif not self._gateway.reaches_the_instrument:
                continue
            elif self._meter.triggered_by(command):
                self._later(self._meter.begin_reading(), self._finish)
            else:
                sent += self._reply(self._meter.execute(command))
        return sent

    def _finish(self) -> bytes:
        return self._reply(self._meter.end_reading()) + self._next_replies()

    def _of_the_gateway(self, line: str) -> bytes:
        if line.lower().split()[0] == "++read" and self._unread and self._gateway.reaches_the_instrument:
            return self._unread.popleft()
        answer = self._gateway.execute(line, self._meter.execute("STB?"))
        return answer.encode() + b"\r\n" if answer else b""

    def _reply(self, answer: str) -> bytes:
        if not (answer and self._meter.codes["END"]):
            return b""
        line = answer.encode() + b"\r\n"
        if self._gateway.reads_by_itself:
            return line
        self._unread.append(line)
        return b""


def _over(full_scale: float, function: wire.Function) -> float:
    """Full scale of a range."""
    return full_scale * (_OVER_1_A if (function, full_scale) == (wire.DC_CURRENT, 1.0) else _OVER_RANGE)


def _engineering(value: float) -> str:
    """Format with nine digits and an exponent in steps of three."""
    exponent = 3 * math.floor(math.log10(value) / 3) if value else 0
    mantissa = value / 10.0**exponent
    return f"{mantissa:.{9 - len(str(int(mantissa)))}f}E{exponent:+03d}"
