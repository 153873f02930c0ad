"""A head or a rate table with the frame protocol of a profile, driving an axis of the world.

It follows the profile, to rehearse it; that is no evidence of the behaviour of the real controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import ClassVar, Self

from drivers.dialects.framed.parts import Bit, Fault, Number
from drivers.dialects.framed.profile import FrameProfile
from drivers.dialects.framed.wire import NumberFormat, Raw, Splitter
from simulators.faults.instrument_faults import MEASUREMENT_AND_COMMAND_FAULTS, FaultEffect, FaultKind, FaultPlan
from simulators.instruments.setup import InstrumentSetup
from simulators.physics.profiles import Slew
from simulators.serving.serve import Later
from simulators.world import World

TURN_DEG = 360.0
SERIAL_NUMBER, FIRMWARE = 1001, 12
RATE_DPS, ACCELERATION_DPS2 = 10.0, 40.0  # default for a controller whose commands do not contain them
STOP_DPS2 = 4000.0  # deceleration
HOMING_DPS = 10.0
RUN_UP_S = 2.0  # run-up of a sine


class SimulatedFrames:
    """One axis: energised by `enable` if there is such a command, else always; homed by default.

    A fault switches the motor off and stays until `clear_fault`; so does a pressed emergency stop until it is released.
    A rejected command changes nothing; there is no other sign of the rejection. `frozen`: the readings do not change.
    `stuck`: commands are accepted and the axis does not follow.

    `stale` repeats the last status including its counter; `loses` = n drops every n-th status.
    """

    def __init__(
        self, world: World, faults: FaultPlan, profile: FrameProfile, *, role: str | None = None, homed: bool = True,
        serial_number: int = SERIAL_NUMBER,
    ) -> None:  # fmt: skip
        self.faults, self.profile = faults, profile
        self.homed, self.remote, self.emergency_stop = homed, True, False
        self.enabled = profile.commands.enable is None
        self.stale, self.loses = False, 0
        self.mode = "off"
        self.target_deg = self.target_dps = 0.0
        self._world, self._role, self._axis = world, role, world.axis_of(role)
        self._latched: set[int] = set()
        self._serial_number, self._sent = serial_number, 0
        self._seen = (self._axis.encoder_deg(world.now()), 0.0)
        self._last = b""
        self._handlers: dict[str, Callable[[bytes], None]] = {
            "enable": lambda _: self._energise(),
            "disable": lambda _: self._drop(),
            "stop": lambda _: self._stop(),
            "home": lambda _: self._home(),
            "clear_fault": lambda _: self._latched.clear(),
            "move": self._move,
            "rate": self._turn,
            "sine": self._swing,
        }

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file, whose check has made sure of the profile."""
        number = int(setup.serial) if setup.serial.isdecimal() else SERIAL_NUMBER
        return cls(
            setup.world, setup.faults, setup.options.profile.content, role=setup.axis, serial_number=number
        )  # fmt: skip

    def session(self) -> FramesSession:
        """Open a connection."""
        return FramesSession(self)

    def trip(self, index: int = 0) -> None:
        """Raise a fault of the profile: the motor is switched off."""
        self._latched.add(index)
        self._drop()

    def press_emergency_stop(self, pressed: bool = True) -> None:
        """Press or release the emergency stop."""
        self.emergency_stop = pressed
        if pressed:
            self._drop()

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **MEASUREMENT_AND_COMMAND_FAULTS,
        "emergency_stop": FaultEffect(press_emergency_stop, lambda controller: controller.press_emergency_stop(False)),
        "interlock": FaultEffect(trip),
    }

    def carry_out(self, name: str, frame: bytes) -> None:
        """Execute a command."""
        if self.remote:
            self.faults.do(lambda: self._handlers[name](frame))

    def status(self, request: bytes = b"") -> bytes:
        """Present status, b"" for a lost one; `request` is the request that it answers."""
        self._sent += 1
        if self.loses and self._sent % self.loses == 0:
            return b""
        if not (self.stale and self._last):
            self._last = self._build(request)
        return self._last

    def _build(self, request: bytes) -> bytes:
        status, read = self.profile.status, self._read()
        numbers: list[tuple[NumberFormat, Raw]] = []
        values = {
            "angle": read[0] % TURN_DEG if self.profile.angle_wraps else read[0], "rate": read[1],
            "target_angle": self.target_deg, "target_rate": self.target_dps,
        }  # fmt: skip
        for name, value in values.items():
            number: Number | None = getattr(status, name)
            if number is not None:
                form = self.profile.number(number)
                numbers.append((form, form.raw(value)))
        counts = {"serial_number": self._serial_number, "firmware": FIRMWARE, "counter": self._sent,
                  "answers": self._counter_of(request)}  # fmt: skip
        for name, count in counts.items():
            place = getattr(status, name)
            if place is not None:
                numbers.append((self.profile.number(place), count % (1 << 8 * place.count)))
        if status.mode is not None:
            code = getattr(status.mode, self.mode)
            numbers.append((self.profile.number(status.mode), status.mode.off if code is None else code))
        return self.profile.format("status").build([*numbers, *self._bytes_of_bits()])

    def _bytes_of_bits(self) -> list[tuple[NumberFormat, Raw]]:
        now = self._world.now()
        states = self.profile.status.states
        moving, swings = self._axis.moving(now), self.mode == "sine"
        holds = {
            "enabled": self.enabled, "homed": self.homed, "moving": moving, "remote": self.remote,
            "in_position": not moving, "at_sine": swings and moving and self._axis.done(now),
            "emergency_stop": self.emergency_stop,
        }  # fmt: skip
        found: dict[int, int] = {}
        for name, there in holds.items():
            bit: Bit | None = getattr(states, name)
            if bit is not None:
                found[bit.at] = found.get(bit.at, 0) | (bit.is_ if there else 1 - bit.is_) << bit.bit
        for index, fault in enumerate(self.profile.status.faults):
            found[fault.at] = found.get(fault.at, 0) | _spelled(fault, index in self._latched)
        return [(NumberFormat(at, "u8"), byte) for at, byte in found.items()]

    def _counter_of(self, request: bytes) -> int:
        counter = self.profile.request.counter if self.profile.request is not None else None
        return int(self.profile.number(counter).read(request)) if counter is not None and request else 0

    def _read(self) -> tuple[float, float]:
        """Reported angle and rate, ° and °/s."""
        if not self.faults.active("frozen"):
            now = self._world.now()
            self._seen = self._axis.encoder_deg(now), self._axis.rate_dps(now)
        return self._seen

    # Commands

    def _energise(self) -> None:
        if not (self._latched or self.emergency_stop):
            self.enabled = True

    def _drop(self) -> None:
        self._stop()
        if self.profile.commands.enable is not None:
            self.enabled = False

    def _stop(self) -> None:
        self.mode = "off"
        self._world.turn(0.0, STOP_DPS2, self._role)

    def _home(self) -> None:
        if self.enabled:
            self.homed = True
            self._world.move(0.0, HOMING_DPS, role=self._role)

    def _move(self, frame: bytes) -> None:
        if not self._ready():
            return
        self.mode, self.target_deg = "position", self._value("move", "angle", frame)
        here_deg, target_deg = self._axis.encoder_deg(self._world.now()), self.target_deg
        if self.profile.angle_wraps:
            target_deg = here_deg + math.remainder(target_deg - here_deg, TURN_DEG)
        if not self.faults.active("stuck"):
            rate_dps = abs(self._value("move", "rate", frame)) or RATE_DPS
            self._world.move(target_deg, rate_dps, self._acceleration("move", frame), self._role)

    def _turn(self, frame: bytes) -> None:
        if not self._ready():
            return
        self.mode, self.target_dps = "rate", self._value("rate", "rate", frame)
        if not self.faults.active("stuck"):
            self._world.turn(self.target_dps, self._acceleration("rate", frame), self._role)

    def _swing(self, frame: bytes) -> None:
        if not self._ready():
            return
        self.mode = "sine"
        amplitude_deg = self._value("sine", "amplitude", frame)
        frequency_hz = self._value("sine", "frequency", frame)
        if not self.faults.active("stuck") and amplitude_deg > 0 and frequency_hz > 0:
            self._world.swing(
                Slew(0.0, amplitude_deg, amplitude_deg / RUN_UP_S), Slew(0.0, frequency_hz, frequency_hz / RUN_UP_S),
                0.0, self._role,
            )  # fmt: skip

    def _ready(self) -> bool:
        return self.enabled and self.homed and not self._latched and not self.emergency_stop

    def _acceleration(self, name: str, frame: bytes) -> float:
        return abs(self._value(name, "acceleration", frame)) or ACCELERATION_DPS2

    def _value(self, name: str, key: str, frame: bytes) -> float:
        """Value of a command; 0 if its frame has no field for it."""
        number: Number | None = getattr(self.profile.shape(name), key)
        if number is None:
            return 0.0
        form = self.profile.number(number)
        return form.value(form.read(frame))


class FramesSession:
    """One connection."""

    def __init__(self, controller: SimulatedFrames) -> None:
        self._controller, profile = controller, controller.profile
        asks = ["request"] if profile.request is not None else []
        self._splitter = Splitter([profile.format(name) for name in [*profile.command_names(), *asks]])

    def answer_by(self, later: Later) -> None:
        """Set the callback for unsolicited status frames."""
        cycle = self._controller.profile.cyclic
        if cycle is None:
            return

        def tick() -> bytes:
            later(cycle.period, tick)
            return self._controller.status()

        later(cycle.period, tick)

    def feed(self, data: bytes) -> bytes:
        """Receive bytes in any portions; return the answers to completed frames."""
        answers = []
        for form, frame in self._splitter.feed(data):
            if form.name == "request":
                answers.append(self._controller.status(frame))
                continue
            self._controller.carry_out(form.name, frame)
            if self._controller.profile.commands_answered:
                answers.append(self._controller.status(frame))
        return b"".join(answers)


def _spelled(fault: Fault, there: bool) -> int:
    """Raw value of a fault."""
    if fault.bit is not None:
        return int(there) << fault.bit
    return next(code for code in range(1, 256) if code not in fault.quiet) if there else fault.quiet[0]
