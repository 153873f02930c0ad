"""An indexing head on an Ensemble controller: one axis with servo, faults and ASCII port.

Commands that our driver does not send, and parameter numbers, follow ESRF's BLISS.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import ClassVar, Self

from drivers.dialects.aerotech_ensemble import wire
from drivers.dialects.aerotech_ensemble.wire import AxisFault, AxisStatus, Outcome, Reply
from simulators.faults.instrument_faults import MEASUREMENT_AND_COMMAND_FAULTS, FaultEffect, FaultKind, FaultPlan
from simulators.instruments.setup import InstrumentSetup
from simulators.serving.serve import DelayedAnswers
from simulators.world import World

DEFAULT_RATE_DPS = 10.0
COUNTS_PER_UNIT = "1000000"
VERSION = "5.06.001"
_HOME, _HOME_AT_ONCE = "HOME", "HOMEASYNC"
_ACCEPTED = ("WAIT MODE NOWAIT", "RAMP MODE RATE", "ACKNOWLEDGEALL", "VERSION", "ABSOLUTE", "INCREMENTAL")
_MOVING = (
    "ENABLE",
    "DISABLE",
    "MOVEABS",
    "MOVEINC",
    "LINEAR",
    "FREERUN",
    "ABORT",
    "SETPARM",
)  # further commands that change a setting
_PARAMETERS = {  # number: name, in capitals
    2: "COUNTSPERUNIT", 37: "SOFTWARELIMITLOW", 38: "SOFTWARELIMITHIGH", 47: "POSITIONFEEDBACKTYPE",
    67: "ENCODERDIVIDER", 71: "DEFAULTSPEED", 72: "DEFAULTRAMPRATE", 75: "HOMESETUP", 76: "HOMESPEED",
    77: "HOMEOFFSET", 213: "EMULATEDQUADRATUREDIVIDER",
}  # fmt: skip
_DONE, _INVALID, _FAULT = Reply(Outcome.DONE), Reply(Outcome.INVALID), Reply(Outcome.FAULT)


class SimulatedEnsemble:
    """A controller with one axis, the head of the world or that of a `role`; energised until something disables it.

    Faults latch and disable the axis until they are acknowledged; a move beyond the software limits is one. `frozen`:
    the feedback does not change. `stuck`: a move is acknowledged and does not begin.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, axis: str = "X", homed: bool = True,
        software_limits_deg: tuple[float, float] = (-370.0, 370.0), role: str | None = None,
    ) -> None:  # fmt: skip
        self.faults = faults
        self._role, self._driven = role, world.axis_of(role)
        self.homed, self.enabled = homed, False
        self._world, self._axis = world, axis.upper()
        self._latched = AxisFault(0)
        self._feedback_deg = self._driven.encoder_deg(world.now())
        self._ramp_dps2: float | None = None  # number of the axis
        self._incremental = False  # unit of the distance of LINEAR
        low_deg, high_deg = software_limits_deg
        self._parameters = {
            **dict.fromkeys(_PARAMETERS.values(), "1"), wire.FINGERPRINT_PARAMETER.upper(): COUNTS_PER_UNIT,
            "SOFTWARELIMITLOW": f"{low_deg:g}", "SOFTWARELIMITHIGH": f"{high_deg:g}",
            "DEFAULTSPEED": f"{DEFAULT_RATE_DPS:g}", "DEFAULTRAMPRATE": f"{world.settings.axis_acceleration_dps2:g}",
        }  # fmt: skip
        self._words: dict[str, Callable[[Sequence[str]], Reply]] = {
            "ENABLE": self._enable,
            "DISABLE": self._disable,
            "MOVEABS": self._move,
            "MOVEINC": self._move_by,
            "LINEAR": lambda given: (self._move_by if self._incremental else self._move)(given),
            "FREERUN": self._run_free,
            "ABORT": self._abort,
            _HOME: self._home,
            _HOME_AT_ONCE: self._home,
            "BRAKE": lambda _: _DONE,
            "FAULTACK": self._acknowledge,
            "PFBK": lambda _: Reply(Outcome.DONE, f"{self._feedback():.6f}"),
            "AXISSTATUS": lambda _: Reply(Outcome.DONE, wire.signed(self._status())),
            "AXISFAULT": lambda _: Reply(Outcome.DONE, wire.signed(self._latched)),
            "CMDPOS": lambda _: Reply(Outcome.DONE, f"{self._commanded_deg():.6f}"),
            "PERR": lambda _: Reply(Outcome.DONE, f"{self._commanded_deg() - self._feedback():.6f}"),
            **dict.fromkeys(("VFBK", "VCMD"), lambda _: Reply(Outcome.DONE, f"{self._rate_dps():.6f}")),
            "GETPARM": self._parameter,
            "SETPARM": self._set_parameter,
        }

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        return cls(setup.world, setup.faults, axis=setup.options.axis, role=setup.axis)

    def session(self) -> EnsembleSession:
        """Open a connection."""
        return EnsembleSession(self)

    def trip(self, fault: AxisFault) -> None:
        """Raise a latching fault: the axis stops and is disabled."""
        self._latched |= fault
        self.enabled = False
        self._world.stop(self._role)

    def execute(self, line: bytes) -> bytes:
        """Execute one line; return its answer."""
        try:
            command = wire.parse_command(line)
            if (text := " ".join([command.word, *command.arguments])) in _ACCEPTED:
                return wire.render(self._of_the_controller(text))
            given = _apart(command.arguments, self._axis)
            if command.word == "RAMP":
                return wire.render(self._set_ramp(given))
            axis, *arguments = given
            if axis != self._axis:
                return wire.render(_INVALID)
            return wire.render(self._carried_out(command.word, arguments))
        except (KeyError, ValueError):
            return wire.render(_INVALID)

    def _carried_out(self, word: str, arguments: Sequence[str]) -> Reply:
        if word in _MOVING and self.faults.active("lag"):
            self.faults.do(lambda: self._words[word](arguments), ValueError)
            return _DONE
        return self._words[word](arguments)

    def left_s(self) -> float:
        """Remaining time of the current motion (s)."""
        return self._driven.left_s(self._world.now())

    @property
    def has_fault(self) -> bool:
        """True if a fault is latched."""
        return bool(self._latched)

    def _of_the_controller(self, text: str) -> Reply:
        """Execute a command without an axis."""
        if text == "ACKNOWLEDGEALL":
            self._latched = AxisFault(0)
        if text in ("ABSOLUTE", "INCREMENTAL"):
            self._incremental = text == "INCREMENTAL"
        return Reply(Outcome.DONE, VERSION if text == "VERSION" else "")

    def _set_ramp(self, arguments: Sequence[str]) -> Reply:
        match arguments:
            case ("RATE", self._axis, rate) if (ramp_dps2 := float(rate)) > 0:
                self._ramp_dps2 = ramp_dps2
                return _DONE
        return _INVALID

    def _enable(self, _: Sequence[str]) -> Reply:
        if self._latched:
            return _INVALID
        self.enabled = True
        return _DONE

    def _disable(self, _: Sequence[str]) -> Reply:
        self._world.stop(self._role)
        self.enabled = False
        return _DONE

    def _move(self, arguments: Sequence[str]) -> Reply:
        move = wire.parse_move((self._axis, *arguments))
        if self._latched or not self.enabled:
            return _INVALID
        low_deg, high_deg = (float(self._parameters[f"SOFTWARELIMIT{end}"]) for end in ("LOW", "HIGH"))
        if not low_deg <= move.angle_deg <= high_deg:
            above = move.angle_deg > high_deg
            self.trip(AxisFault.POSITIVE_SOFTWARE_LIMIT if above else AxisFault.NEGATIVE_SOFTWARE_LIMIT)
            return _FAULT
        if not self.faults.active("stuck"):
            self._world.move(move.angle_deg, move.rate_dps or DEFAULT_RATE_DPS, self._ramp_dps2, role=self._role)
        return _DONE

    def _move_by(self, arguments: Sequence[str]) -> Reply:
        by_deg, *rate = arguments
        return self._move([f"{self._driven.target_deg() + float(by_deg):.9f}", *rate])

    def _run_free(self, arguments: Sequence[str]) -> Reply:
        (rate,) = arguments
        if self._latched or not self.enabled:
            return _INVALID
        ramp_dps2 = self._ramp_dps2 or self._world.settings.axis_acceleration_dps2
        self._world.turn(float(rate), ramp_dps2, role=self._role)
        return _DONE

    def _abort(self, _: Sequence[str]) -> Reply:
        self._world.stop(self._role)
        return _DONE

    def _home(self, _: Sequence[str]) -> Reply:
        if self._latched or not self.enabled:
            return _INVALID
        self.homed = True
        self._world.move(0.0, DEFAULT_RATE_DPS, role=self._role)
        return _DONE

    def _acknowledge(self, _: Sequence[str]) -> Reply:
        self._latched = AxisFault(0)
        return _DONE

    def _parameter(self, arguments: Sequence[str]) -> Reply:
        (name,) = arguments
        return Reply(Outcome.DONE, self._parameters[_named(name)])

    def _set_parameter(self, arguments: Sequence[str]) -> Reply:
        name, value = arguments
        name = _named(name)
        if name not in self._parameters:
            return _INVALID
        self._parameters[name] = f"{float(value):g}"
        return _DONE

    def _commanded_deg(self) -> float:
        """Commanded angle of the axis, which during a move is the present one."""
        now_s = self._world.now()
        return self._driven.encoder_deg(now_s) if self._driven.moving(now_s) else self._driven.target_deg()

    def _rate_dps(self) -> float:
        return self._driven.rate_dps(self._world.now())

    def _feedback(self) -> float:
        if not self.faults.active("frozen"):
            self._feedback_deg = self._driven.encoder_deg(self._world.now())
        return self._feedback_deg

    def _status(self) -> AxisStatus:
        status = AxisStatus(0)
        if self.enabled:
            status |= AxisStatus.ENABLED
        if self.homed:
            status |= AxisStatus.HOMED
        if self._driven.moving(self._world.now()):
            status |= AxisStatus.MOVING
        elif self.enabled:
            status |= AxisStatus.IN_POSITION
        return status

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **MEASUREMENT_AND_COMMAND_FAULTS,
        "emergency_stop": FaultEffect(lambda head: head.trip(AxisFault.EMERGENCY_STOP)),
        "tripped": FaultEffect(lambda head: head.trip(AxisFault.POSITION_ERROR)),
    }


class EnsembleSession(DelayedAnswers):
    """One connection: lines end with LF, and those after a HOME wait until it is finished."""

    def __init__(self, controller: SimulatedEnsemble) -> None:
        self._controller = controller
        self._rest = b""
        self._lines: deque[bytes] = deque()
        self._homes = False

    def feed(self, data: bytes) -> bytes:
        """Receive bytes in any portions; return the answers to completed lines."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._lines.extend(lines)
        return self._next_replies()

    def _next_replies(self) -> bytes:
        text = b""
        while self._lines and not self._homes:
            line = self._lines.popleft()
            answer = self._controller.execute(line)
            self._homes = answer == wire.render(_DONE) and line.upper().split()[:1] == [_HOME.encode()]
            if self._homes:
                self._later(self._controller.left_s(), self._home_is_over)
            else:
                text += answer
        return text

    def _home_is_over(self) -> bytes:
        self._homes = False
        return wire.render(_FAULT if self._controller.has_fault else _DONE) + self._next_replies()


@lru_cache(maxsize=256)
def _apart(arguments: tuple[str, ...], axis: str) -> tuple[str, ...]:
    """Normalise arguments, axis by name and separate from its number: `X1.0 XF10.0` equals `@0 1.0 F 10.0`."""
    text = " ".join(arguments).replace("@0", axis)
    text = re.sub(rf"\b{axis}(?=[+-]?[.\d])", f"{axis} ", text)
    return tuple(re.sub(rf"\b(?:{axis})?F\s*(?=[.\d])", "F", text).split())


def _named(parameter: str) -> str:
    """Parameter by name or number; ValueError."""
    return _PARAMETERS.get(int(parameter), "") if parameter.isdecimal() else parameter
