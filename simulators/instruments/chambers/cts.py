"""A CTS chamber: frames of its ASCII protocol in front of the world's chamber.

The off state is not simulated: a new set point is stored until the chamber is started.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import ClassVar, Literal, Self

from drivers.dialects.cts import wire
from drivers.dialects.cts.wire import ETX, FULL_SPEED_C_PER_MIN, STX, RampChannel
from drivers.kinds.chamber.tenths import as_stored
from simulators.faults.instrument_faults import FaultEffect, FaultKind, FaultPlan
from simulators.instruments.chambers.chamber import CHAMBER_FAULT_EFFECTS, SimulatedChamber
from simulators.instruments.setup import InstrumentSetup
from simulators.world import World

PROGRAM_C, PROGRAM_C_PER_MIN = 80.0, 1.0
FRAME_LIMIT_BYTES = 64
_SET_POINT = re.compile(r"a0 (\d{3}\.\d|-\d{2}\.\d)")
_RATE = re.compile(r"([ud])([01]) (\d{3}\.\d)")
_SWITCH = re.compile(r"s([1-9:;]) ([01])")


class SimulatedCts(SimulatedChamber):
    """A chamber at one address; it does not answer messages for others, or invalid or unknown ones.

    `set_point_reads` selects the set point reported during a ramp. `error` is the number of an error that stops it.
    `stuck`: settings are accepted and not executed. `frozen`: the air reading does not change.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, address: int = 1, ramp_channel: RampChannel = 1,
        versions: str = "2.41;1.07;123456", limits_c: tuple[float, float] = (-75.0, 185.0),
        set_point_reads: Literal["target", "in_force"] = "in_force",
    ) -> None:  # fmt: skip
        super().__init__(world, faults)
        self.address, self.versions = address, versions
        self.running, self.paused, self.error, self.program = True, False, "", False
        self.set_point_c = as_stored(world.thermal.set_point_c)
        self.rates = {"u": FULL_SPEED_C_PER_MIN, "d": FULL_SPEED_C_PER_MIN}
        self._ramp_channel, self._limits_c, self._reads = ramp_channel, limits_c, set_point_reads
        self._settings: tuple[tuple[re.Pattern[str], Callable[[re.Match[str]], bool]], ...] = (
            (_SET_POINT, self._set), (_RATE, self._set_rate), (_SWITCH, self._switch),
        )  # fmt: skip

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        options = setup.options
        return cls(setup.world, setup.faults, address=options.address, ramp_channel=options.ramp_channel)

    def session(self) -> FrameSession:
        """Open a connection."""
        return FrameSession(self)

    def execute(self, text: str) -> str:
        """Answer to one text; none to an unknown one."""
        self._world.look()
        match text:
            case "A0":
                return f"A0 {self.measured_c():05.1f} {self._told_c():05.1f}"
            case "S":
                return f"S{self.running:d}{bool(self.error):d}{not self.paused:d}00000{self.error or '0'}"
            case "C":
                return f"C{self.versions};" if self.versions else ""
            case _ if text == f"R{self._ramp_channel}":
                return self._ramp()
        for form, carry_out in self._settings:
            if (match := form.fullmatch(text)) and (self._not_now or carry_out(match)):
                if self._not_now:
                    self.faults.carry_out(partial(carry_out, match))
                return text[:2] if text[0] == "s" else text[0]
        return ""

    @property
    def _not_now(self) -> bool:
        """True if a setting is acknowledged before it is executed."""
        return self.faults.active("stuck") or self.faults.active("lag")

    def fail(self, number: str) -> None:
        """Raise an error that stops the chamber until it is acknowledged: `error` and `running`."""
        self.error, self.running = number, False

    def acknowledge(self) -> None:
        """Clear and acknowledge the error; the chamber stays off."""
        self.error = ""

    def start_program(self) -> None:
        """Start a program at the front panel."""
        self._world.look()
        self.running = self.program = True
        self.set_point_c = PROGRAM_C
        self._world.ramp(PROGRAM_C, PROGRAM_C_PER_MIN / 60)

    def restart(self) -> None:
        """Short power failure: it restarts switched off."""
        self.running = self.paused = self.program = False

    def _set(self, match: re.Match[str]) -> bool:
        set_point_c = float(match[1])
        if self._limits_c[0] <= set_point_c <= self._limits_c[1]:
            self.set_point_c, self.program = set_point_c, False
            self._follow()
        return True  # a set point beyond the limits is acknowledged and ignored

    def _set_rate(self, match: re.Match[str]) -> bool:
        direction, channel, rate = match.groups()
        if int(channel) != self._ramp_channel or float(rate) <= 0:
            return False
        self.rates[direction] = float(rate)
        return True

    def _switch(self, match: re.Match[str]) -> bool:
        on = match[2] == "1"
        if match[1] == "1":
            if on and not self.running:
                self._world.ramp(self._world.thermal.air_c, math.inf)  # a ramp starts at the air temperature
            self.running, self.paused = on and not self.error, False
        elif match[1] == "3":
            self.paused = not on
        self._follow()
        return True

    def _follow(self) -> None:
        """Ramp the active set point to the set point at its rate, or hold it."""
        now_c = self._world.thermal.set_point_c
        if not self.running or self.paused:
            self._world.ramp(now_c, math.inf)
            return
        rate_c_per_min = self.rates["u" if self.set_point_c > now_c else "d"]
        self._world.ramp(self.set_point_c, rate_c_per_min / 60 if rate_c_per_min < FULL_SPEED_C_PER_MIN else math.inf)

    @property
    def _ramps(self) -> bool:
        return self.program or min(self.rates.values()) < FULL_SPEED_C_PER_MIN

    def _ramp(self) -> str:
        active = self._ramps
        ramping = active and self.running and not self.paused and self._world.thermal.set_point_c != self.set_point_c
        target_c = f"{self.set_point_c:07.2f}" if self.set_point_c >= 0 else f"{self.set_point_c:06.2f}"
        up, down = self.rates["u"], self.rates["d"]
        return f"R{self._ramp_channel} {active:d}{ramping:d} {up:07.2f} {down:07.2f} {target_c}"

    def _told_c(self) -> float:
        in_force = self.running and self._ramps and self._reads == "in_force"
        return self._world.thermal.set_point_c if in_force else self.set_point_c

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **CHAMBER_FAULT_EFFECTS,
        "restart": FaultEffect(restart),
        "program": FaultEffect(start_program),
        "alarm": FaultEffect(lambda chamber: chamber.fail("1"), acknowledge),
    }


class FrameSession:
    """One connection: splits a byte stream into frames."""

    def __init__(self, chamber: SimulatedCts) -> None:
        self._chamber = chamber
        self._received = b""

    def feed(self, data: bytes) -> bytes:
        """Receive bytes in any portions; return the answers to completed frames."""
        *frames, self._received = (self._received + data).split(bytes([ETX]))
        self._received = self._received[-FRAME_LIMIT_BYTES:]
        return b"".join(map(self._answer, frames))

    def _answer(self, received: bytes) -> bytes:
        address = self._chamber.address
        try:
            text = wire.text_of(address, received[max(0, received.rfind(bytes([STX]))) :])
        except ValueError:
            return b""
        answer = self._chamber.execute(text)
        return wire.frame(address, answer.encode("ascii")) if answer else b""
