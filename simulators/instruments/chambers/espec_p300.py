"""An ESPEC chamber with a P300 controller: lines in front of the world's chamber.

The modes OFF and STANDBY are not simulated: a new set point is stored until constant operation.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import ClassVar, Self

from drivers.dialects.espec_p300 import wire
from drivers.dialects.espec_p300.wire import CONSTANT, OFF, STANDBY
from drivers.kinds.chamber.tenths import as_stored
from simulators.faults.instrument_faults import FaultEffect, FaultKind, FaultPlan, sets
from simulators.instruments.chambers.chamber import CHAMBER_FAULT_EFFECTS, SimulatedChamber
from simulators.instruments.scpi import LineSession
from simulators.instruments.setup import InstrumentSetup
from simulators.world import World

RUN = "RUN"
PROGRAMS: Mapping[int, tuple[float, float]] = {1: (80.0, 1.0), 2: (-20.0, 0.5)}  # target, °C, and rate, °C/min
QUERY_GAP_S, SETTING_GAP_S = 0.2, 0.5  # minimum pause
_TEMPERATURE = re.compile(
    r"TEMP,\s*(?=[SHL])(?:S(-?\d{1,3}\.\d))?\s*(?:H\s*(-?\d{1,3}\.\d))?\s*(?:L\s*(-?\d{1,3}\.\d))?"
)
_MODE = re.compile(rf"MODE,\s*({OFF}|{STANDBY}|{CONSTANT})")
_POWER = re.compile(r"POWER,(ON|OFF)")
_HUMIDITY = re.compile(r"HUMI,\s*S(OFF|\d{1,3})")
_KEY_PROTECTION = re.compile(r"KEYPROTECT,\s*(ON|OFF)", re.IGNORECASE)
_RUN = re.compile(r"PRGM,RUN,RAM:(\d+),STEP(\d+)")
_END = re.compile(rf"PRGM,END,({OFF}|{STANDBY}|{CONSTANT})")


class Refusal(Exception):
    """A rejected command, with the reason in its answer."""


class SimulatedP300(SimulatedChamber):
    """One controller of a chamber without humidity, or with a constant one.

    `protected` is the switch at its front panel, `alarm` stops it. `hurried` counts lines received before the maker's
    waiting time was over. `stuck`: settings are accepted and not executed. `frozen`: the air reading does not change.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, kind: str = "S2", rom: str = "P300 1.04", address: int | None = None,
        limits_c: tuple[float, float] = (-70.0, 180.0), humidity_percent: int | None = None, mode: str = CONSTANT,
    ) -> None:  # fmt: skip
        super().__init__(world, faults)
        self.mode, self.alarms, self.protected, self.hurried = mode, list[int](), False, 0
        self.set_point_c = as_stored(world.thermal.set_point_c)
        self._address, self._humidity_percent = address, humidity_percent
        self._kind, self._rom, (self._lowest_c, self._highest_c) = kind, rom, limits_c
        self._ready_s = -math.inf
        self._questions: Mapping[str, Callable[[], str]] = {
            wire.TYPE_QUERY: lambda: f"T,{self._kind},180.0" if humidity_percent is None else f"T,T,{self._kind},180.0",
            wire.ROM_QUERY: lambda: self._rom,
            wire.TEMPERATURE_QUERY: self._temperatures,
            wire.MONITOR_QUERY: lambda: f"{self.measured_c():.1f},{self._humidity()},{self.mode},{len(self.alarms)}",
            wire.ALARM_QUERY: lambda: ",".join(map(str, [len(self.alarms), *self.alarms])),
            "MODE?": lambda: self.mode,
            "HUMI?": lambda: f"{self._humidity()},OFF,100,0",
            "KEYPROTECT?": lambda: "ON" if self.protected else "OFF",
        }
        self._settings: list[tuple[re.Pattern[str], Callable[[re.Match[str]], None]]] = [
            (_TEMPERATURE, self._set_temperature),
            (_HUMIDITY, self._set_humidity),
            (_KEY_PROTECTION, self._protect_keys),
            (_MODE, lambda match: self._enter(match[1])),
            (_POWER, lambda match: self._enter(STANDBY if match[1] == "ON" else OFF)),
            (_RUN, lambda match: self._run(int(match[1]))),
            (_END, lambda match: self._enter(match[1])),
        ]

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        return cls(setup.world, setup.faults, kind=setup.model or "S2", address=setup.options.address)

    def session(self) -> LineSession:
        """Open a connection."""
        return LineSession(self.execute, end=b"\n", answer_end=wire.END)

    def execute(self, line: str) -> str:
        """Answer to one line; none to a line for another address."""
        if self._address is not None:
            address, _, line = line.partition(",")
            if address != str(self._address):
                return ""
        now_s = self._world.look()
        self.hurried += now_s < self._ready_s
        self._ready_s = now_s + (QUERY_GAP_S if "?" in line else SETTING_GAP_S)
        try:
            return self._carry_out(line)
        except Refusal as refusal:
            return f"NA:{refusal}"

    def alarm(self, code: int) -> None:
        """Raise an alarm, which stops the chamber; `alarms.clear()` removes it."""
        self.alarms.append(code)
        self.mode = STANDBY

    def start_program(self) -> None:
        """Start a program at the front panel."""
        if self.mode != OFF:
            self._run(1)

    def end_program(self) -> None:
        """Return to constant operation at the front panel."""
        if self.mode == RUN:
            self._enter(CONSTANT)

    def _protect_keys(self, match: re.Match[str]) -> None:
        self.protected = match[1].upper() == "ON"

    def restart(self) -> None:
        """Short power failure: it restarts switched off."""
        self.mode = OFF

    def _carry_out(self, line: str) -> str:
        if line in self._questions:
            return self._questions[line]()
        for form, carry_out in self._settings:
            if match := form.fullmatch(line):
                if self.protected and form is not _KEY_PROTECTION:
                    raise Refusal("PROTECT ON")
                self.faults.carry_out(partial(carry_out, match), Refusal)
                return f"OK:{line}"
        known = any(line.partition(",")[0] == name for name in ("TEMP", "HUMI", "MODE", "POWER", "PRGM", "KEYPROTECT"))
        raise Refusal("PARA ERR" if known else "CMD ERR")

    def _set_temperature(self, match: re.Match[str]) -> None:
        set_point, highest, lowest = match.groups()
        highest_c = self._highest_c if highest is None else float(highest)
        lowest_c = self._lowest_c if lowest is None else float(lowest)
        set_point_c = self.set_point_c if set_point is None else float(set_point)
        if not lowest_c <= set_point_c <= highest_c:
            raise Refusal("DATA OUT OF RANGE")
        self._lowest_c, self._highest_c, self.set_point_c = lowest_c, highest_c, set_point_c
        if self.mode == CONSTANT:
            self._world.ramp(self.set_point_c, math.inf)

    def _set_humidity(self, _match: re.Match[str]) -> None:
        """Accepted if there is humidity, which does not change."""
        if self._humidity_percent is None:
            raise Refusal("CONT NOT READY-1")

    def _enter(self, mode: str) -> None:
        if self.alarms and mode == CONSTANT:
            raise Refusal("CHB NOT READY")
        self.mode = mode
        if mode == CONSTANT:
            self._world.ramp(self.set_point_c, math.inf)

    def _run(self, program: int) -> None:
        if program not in PROGRAMS:
            raise Refusal("DATA NOT READY")
        if self.alarms or self.mode == OFF:
            raise Refusal("CHB NOT READY")
        target_c, rate_c_per_min = PROGRAMS[program]
        self.mode = RUN
        self._world.ramp(target_c, rate_c_per_min / 60)

    def _temperatures(self) -> str:
        set_point_c = self._world.thermal.set_point_c if self.mode == RUN else self.set_point_c
        return f"{self.measured_c():.1f},{set_point_c:.1f},{self._highest_c:.1f},{self._lowest_c:.1f}"

    def _humidity(self) -> str:
        return "" if self._humidity_percent is None else str(self._humidity_percent)

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **CHAMBER_FAULT_EFFECTS,
        "restart": FaultEffect(restart),
        "program": FaultEffect(start_program, end_program),
        "alarm": FaultEffect(lambda chamber: chamber.alarm(1), lambda chamber: chamber.alarms.clear()),
        "front_panel": sets("protected", True, False),
    }
