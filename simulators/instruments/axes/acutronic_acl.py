"""A rate table on an Acutrol3000: one axis with modes, limits, interlock, lock-outs and TCP port."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntFlag
from functools import lru_cache
from typing import ClassVar, Self

from drivers.dialects.acutronic_acl import wire
from drivers.dialects.acutronic_acl.wire import (
    ByteOrder,
    Dynamics,
    Interlock,
    InterlockInput,
    Mode,
    Reply,
    SoftwareFault,
    Supervisor,
)
from drivers.protocols import scpi
from simulators.faults.instrument_faults import MEASUREMENT_AND_COMMAND_FAULTS, FaultEffect, FaultKind, FaultPlan
from simulators.instruments.setup import InstrumentSetup
from simulators.physics.profiles import Slew
from simulators.world import World

BRAKE_DPS2 = 400.0  # deceleration of the table after its drive is switched off
TURN_DEG = 360.0
DEFAULT_DPS, DEFAULT_DPS2 = 100.0, 100.0
FACTORY_LIMITS = "1000,4200,100000,-1000000,1000000,1100"  # rate, acceleration, jerk, lowest, highest, trip
INTERLOCK_SUMMARY = 1 << 6 | 1 << 0  # bit of the status byte
MESSAGE_LIMIT_BYTES = 32_768
SWINGING = Dynamics.AT_AMPLITUDE | Dynamics.AT_FREQUENCY
OK = Reply(wire.NO_ERROR, "OK")
Handler = Callable[[Sequence[str]], str | None]


class Refusal(Exception):
    """A rejected command. The maker does not publish the error codes: these are our own."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.reply = Reply(code, text)


UNKNOWN, BAD_ARGUMENT, NOT_NOW, LOCKED = 1, 2, 3, 4


@dataclass
class Limits:
    """Rate and acceleration limits of a mode."""

    rate_dps: float = DEFAULT_DPS
    acceleration_dps2: float = DEFAULT_DPS2


class SimulatedAcutrol:
    """A controller with one axis without ends, which is the axis of the world; initially de-energised.

    A fault switches the drive off and latches, with the status frozen, until it is reset. A mode other than OFF is
    entered at rest only, and a sine is set up before it is entered; jerk is not limited. Angles are reported from -180°
    to 180°. `frozen`: the readings do not change. `stuck`: demands are accepted and the table does not follow.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, axis: int = 1, byte_order: ByteOrder = "little", serial: str = "0",
        role: str | None = None,
    ) -> None:  # fmt: skip
        self.faults = faults
        self.interlock, self.mode = Interlock.OPEN, Mode.OFF
        self.supervisor = Supervisor(0)
        self._world, self._axis, self._order = world, str(axis), byte_order
        self._role, self._driven = role, world.axis_of(role)
        self._identity = f"Acutronic R&D USA,Acutrol3000,{serial},A8800-SIM"
        self._limits = {mode: Limits() for mode in Mode}
        self._demand_deg = self._demand_dps = 0.0
        self._sine = (0.0, 0.0, 0.0)  # °, Hz, ° of phase
        self._slews = (10.0, 10.0)  # °/s, Hz/s
        self._tripped, self._inputs = SoftwareFault(0), InterlockInput(0)
        self._latched: Dynamics | None = None  # status before a fault
        self._seen_deg = self._seen_dps = 0.0
        self._registers: dict[str, Callable[[], IntFlag]] = {
            f"A{axis}DYN": self._dynamics,
            f"A{axis}SWFAULT": lambda: self._tripped,
            f"A{axis}INTLK": lambda: self._inputs,
            "SUP0": lambda: self.supervisor,
        }
        self._known: dict[str, Handler] = {}  # commands as received, abbreviated or not
        self._commands: dict[str, Handler] = {
            "*IDN?": lambda _: self._identity,
            "UTILITY:LOCKOUT": lambda words: self._lock(Supervisor.LOCKOUT, words),
            "UTILITY:REMOTELOCKOUT": lambda words: self._lock(Supervisor.REMOTE_LOCKOUT, words),
            "INTERLOCK:RESET": self._reset,
            "INTERLOCK:CLOSE": self._close,
            "INTERLOCK:OPEN": self._open,
            "INTERLOCK?": self._on_axis(lambda: self.interlock.value),
            **{f"MODE:{mode.value.upper()}": self._enter(mode) for mode in Mode},
            "MODE?": self._on_axis(lambda: self.mode.value),
            "MODE": lambda words: self._enter(wire.spelled(words[1], Mode))(words),
            "UTILITY:FORMAT": self._format,
            "LIMIT:RATE?": lambda words: _spell(self._limits_of(words).rate_dps),
            "LIMIT:ACCELERATION?": lambda words: _spell(self._limits_of(words).acceleration_dps2),
            "LIMIT:ABSOLUTE?": self._on_axis(lambda: FACTORY_LIMITS),
            "LIMIT:RATE": self._limit_rate,
            "LIMIT:ACCELERATION": self._limit_acceleration,
            "DEMAND:POSITION": self._position,
            "DEMAND:RATE": self._rate,
            "DEMAND:DELTA": self._delta,
            "DEMAND:ACCELERATION": self._acceleration,
            "DEMAND:OSCILLATOR": self._oscillator,
            "CONFIGURE:OSCILLATOR": self._configure,
            "CONFIGURE:OSCILLATOR?": self._on_axis(lambda: f"Enable,{self._slews[0]:g},{self._slews[1]:g},Pos,Lin"),
            "READ:POSITION?": self._on_axis(lambda: _spell(self._angle_deg())),
            "READ:RATE?": self._on_axis(lambda: _spell(self._rate_dps())),
            "READ:ACCELERATION?": self._on_axis(lambda: _spell(self._driven.acceleration_dps2(self._world.now()))),
            "STATUS:CSR?": self._register,
            "*STB?": lambda _: str(INTERLOCK_SUMMARY if self.interlock is Interlock.FAULT else 0),
        }

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        options = setup.options
        return cls(setup.world, setup.faults, axis=options.axis, byte_order=options.byte_order, role=setup.axis)

    def session(self) -> AclSession:
        """Open a connection."""
        return AclSession(self)

    def trip(self, fault: SoftwareFault, inputs: InterlockInput) -> None:
        """Raise a fault: the drive drops out, the table slows down, the status is unchanged."""
        self._tripped, self._inputs = self._tripped | fault, self._inputs | inputs
        self._latched = self._dynamics()
        self.interlock = Interlock.FAULT
        self._leave(BRAKE_DPS2)

    def at_panel(self, message: str) -> Reply:
        """Execute a front-panel command, unless it is locked out."""
        if Supervisor.LOCKOUT in self.supervisor:
            return Reply(LOCKED, "front panel locked")
        return self.execute(message)

    def answer(self, line: bytes) -> bytes:
        """Execute one message; return its answer as sent over the wire."""
        return wire.render(self.execute(line.decode("latin-1").strip()), self._order)

    def execute(self, message: str) -> Reply:
        """Execute one message; return the answers to its queries, or OK, or the first error."""
        answers: list[str] = []
        try:
            for command in scpi.commands(message):
                answer = self._carried_out(command)
                answers += [] if answer is None else [answer]
        except Refusal as refusal:
            return refusal.reply
        except (ValueError, IndexError):
            return Reply(BAD_ARGUMENT, "bad argument")
        return Reply(wire.NO_ERROR, ";".join(answers)) if answers else OK

    def _carried_out(self, command: scpi.Command) -> str | None:
        """Answer to a query; with `lag` a setting is acknowledged before it is evaluated."""
        handler, words = self._handler(command.header), _words(command.argument)
        if command.header.endswith("?") or command.header.startswith("R") or not self.faults.active("lag"):
            return handler(words)
        self.faults.do(lambda: handler(words), Refusal, ValueError, IndexError)
        return None

    def _handler(self, header: str) -> Handler:
        """Handler of a command, each of whose words may be abbreviated; READ needs no question mark."""
        if header not in self._known:
            self._known[header] = self._looked_up(header)
        return self._known[header]

    def _looked_up(self, header: str) -> Handler:
        if "READ".startswith(header.partition(":")[0]):
            header = header.removesuffix("?") + "?"
        for spelled, handler in self._commands.items():
            full, given = spelled.removesuffix("?").split(":"), header.removesuffix("?").split(":")
            same_kind = spelled.endswith("?") == header.endswith("?") and len(full) == len(given)
            if same_kind and all(part and word.startswith(part) for word, part in zip(full, given, strict=True)):
                return handler
        raise Refusal(UNKNOWN, "unknown command")

    def _on_axis(self, answer: Callable[[], str]) -> Handler:
        def handle(words: Sequence[str]) -> str:
            self._check_axis(words[0])
            return answer()

        return handle

    def _check_axis(self, word: str) -> None:
        if word != self._axis:
            raise Refusal(BAD_ARGUMENT, "no such axis")

    # Interlock and lock-outs

    def _lock(self, bit: Supervisor, words: Sequence[str]) -> None:
        locked = {"ON": True, "OFF": False}.get(words[0].upper())
        if locked is None:
            raise Refusal(BAD_ARGUMENT, "neither ON nor OFF")
        self.supervisor = self.supervisor | bit if locked else self.supervisor & ~bit

    def _reset(self, _: Sequence[str]) -> None:
        if self.interlock is Interlock.FAULT:
            self.interlock, self._latched = Interlock.OPEN, None
            self._tripped, self._inputs = SoftwareFault(0), InterlockInput(0)

    def _close(self, words: Sequence[str]) -> None:
        self._check_axis(words[0])
        if self.interlock is Interlock.FAULT:
            raise Refusal(NOT_NOW, "interlock fault")
        self.interlock = Interlock.CLOSED

    def _open(self, words: Sequence[str]) -> None:
        self._check_axis(words[0])
        if self.interlock is Interlock.CLOSED:
            self.interlock = Interlock.OPEN
            self._leave(self._limits[Mode.OFF].acceleration_dps2)

    def _leave(self, acceleration_dps2: float) -> None:
        self.mode = Mode.OFF
        self._world.turn(0.0, acceleration_dps2, self._role)

    # Modes and demands

    def _enter(self, mode: Mode) -> Handler:
        follow = {Mode.POSITION: self._go, Mode.RATE: self._turn, Mode.SYNTHESIS: self._swing}.get(mode)

        def handle(words: Sequence[str]) -> None:
            self._check_axis(words[0])
            if mode is Mode.OFF:
                self._leave(self._limits[Mode.OFF].acceleration_dps2)
                return
            if follow is None or self.interlock is not Interlock.CLOSED:
                raise Refusal(NOT_NOW, "mode cannot be entered")
            if mode is not self.mode and self._driven.moving(self._world.now()):
                raise Refusal(NOT_NOW, "axis is moving")
            self.mode = mode
            follow()

        return handle

    def _limit_rate(self, words: Sequence[str]) -> None:
        self._limits_of(words).rate_dps = _positive(words[2])

    def _limit_acceleration(self, words: Sequence[str]) -> None:
        self._limits_of(words).acceleration_dps2 = _positive(words[2])

    def _limits_of(self, words: Sequence[str]) -> Limits:
        self._check_axis(words[1])
        return self._limits[wire.spelled(words[0], Mode)]

    def _position(self, words: Sequence[str]) -> None:
        self._check_axis(words[0])
        self._demand_deg = scpi.number(words[1])
        if self.mode is Mode.POSITION:
            self._go()

    def _delta(self, words: Sequence[str]) -> None:
        self._check_axis(words[0])
        by_deg = scpi.number(words[1])
        if abs(by_deg) > TURN_DEG / 2:
            raise Refusal(BAD_ARGUMENT, "more than half a turn")
        self._position([words[0], f"{self._driven.target_deg() + by_deg:.9f}"])

    def _acceleration(self, words: Sequence[str]) -> None:
        """Do nothing: only TRACK uses the acceleration, and it is not simulated."""
        self._check_axis(words[0])
        scpi.number(words[1])

    def _format(self, words: Sequence[str]) -> None:
        """Do nothing: numbers are always sent as decimals, which other programs request by F."""
        if not words[0].upper().startswith("F"):
            raise Refusal(BAD_ARGUMENT, "only decimal numbers are simulated")

    def _rate(self, words: Sequence[str]) -> None:
        self._check_axis(words[0])
        self._demand_dps = scpi.number(words[1])
        if self.mode is Mode.RATE:
            self._turn()

    def _oscillator(self, words: Sequence[str]) -> None:
        self._check_axis(words[0])
        sine = (scpi.number(words[1]), scpi.number(words[2]), scpi.number(words[3]))
        under_way = self.mode is Mode.SYNTHESIS and self._driven.moving(self._world.now())
        self._sine = sine
        if under_way and sine[0] and sine[1]:
            if not self.faults.active("stuck"):
                self._world.change_swing(sine[0], sine[1], self._slews, self._role)
        elif under_way:  # an oscillation ends at zero amplitude
            self._world.turn(0.0, self._limits[Mode.SYNTHESIS].acceleration_dps2, self._role)
        elif self.mode is Mode.SYNTHESIS:
            self._swing()

    def _configure(self, words: Sequence[str]) -> None:
        self._check_axis(words[0])
        enabled, *slews, kind, law = words[1:6]
        if [word.upper()[:1] for word in (enabled, kind, law)] != ["E", "P", "L"]:
            raise Refusal(BAD_ARGUMENT, "only linear slews of an angle are simulated")
        self._slews = (_positive(slews[0]), _positive(slews[1]))

    def _go(self) -> None:
        limits, here_deg = self._limits[Mode.POSITION], self._driven.encoder_deg(self._world.now())
        target_deg = here_deg + math.remainder(self._demand_deg - here_deg, TURN_DEG)
        if not self.faults.active("stuck"):
            self._world.move(target_deg, limits.rate_dps, limits.acceleration_dps2, self._role)

    def _turn(self) -> None:
        limits = self._limits[Mode.RATE]
        rate_dps = min(max(self._demand_dps, -limits.rate_dps), limits.rate_dps)
        if not self.faults.active("stuck"):
            self._world.turn(rate_dps, limits.acceleration_dps2, self._role)

    def _swing(self) -> None:
        amplitude_deg, frequency_hz, phase_deg = self._sine
        if not self.faults.active("stuck") and amplitude_deg and frequency_hz:
            amplitude, frequency = Slew(0.0, amplitude_deg, self._slews[0]), Slew(0.0, frequency_hz, self._slews[1])
            self._world.swing(amplitude, frequency, phase_deg, self._role)

    # Readings

    def _angle_deg(self) -> float:
        if not self.faults.active("frozen"):
            self._seen_deg = math.remainder(self._driven.encoder_deg(self._world.now()), TURN_DEG)
        return self._seen_deg

    def _rate_dps(self) -> float:
        if not self.faults.active("frozen"):
            self._seen_dps = self._driven.rate_dps(self._world.now())
        return self._seen_dps

    def _register(self, words: Sequence[str]) -> str:
        register = self._registers.get(words[0].upper())
        if register is None:
            raise Refusal(BAD_ARGUMENT, "no such register")
        return str(register().value)

    def _dynamics(self) -> Dynamics:
        if self._latched is not None:
            return self._latched
        now, axis = self._world.now(), self._driven
        if not axis.done(now):
            return Dynamics(0)
        match self.mode:
            case Mode.POSITION:
                return Dynamics.POSITION_COMPLETE
            case Mode.RATE:
                return Dynamics.RATE_COMPLETE
            case Mode.SYNTHESIS if axis.moving(now):
                return SWINGING
        return Dynamics(0)

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **MEASUREMENT_AND_COMMAND_FAULTS,
        "emergency_stop": FaultEffect(lambda table: table.trip(SoftwareFault.ABORT, InterlockInput.MASTER_INTERLOCK)),
        "interlock": FaultEffect(lambda table: table.trip(SoftwareFault(0), InterlockInput.INTERLOCK_1)),
    }


class AclSession:
    """One connection: messages end with LF or CR LF."""

    def __init__(self, controller: SimulatedAcutrol) -> None:
        self._controller = controller
        self._rest = b""

    def feed(self, data: bytes) -> bytes:
        """Receive bytes in any portions; return the answers to completed messages."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > MESSAGE_LIMIT_BYTES:
            self._rest = b""
        return b"".join(self._controller.answer(line) for line in lines)


@lru_cache(maxsize=256)
def _words(argument: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in argument.split(","))


def _positive(text: str) -> float:
    value = scpi.number(text)
    if value <= 0:
        raise Refusal(BAD_ARGUMENT, "not above zero")
    return value


def _spell(value: float) -> str:
    """Format with five digits after the point, the resolution of the encoder; never -0."""
    return f"{round(value, 5) + 0.0:.5f}"
