"""An indexing head on an Ensemble controller: one axis, its servo, its faults, its ASCII port."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Self

from drivers.aerotech_ensemble import wire
from drivers.aerotech_ensemble.wire import AxisFault, AxisStatus, Outcome, Reply
from simulators.faults import MEASURES_AND_OBEYS, FaultKind, FaultPlan, Mishap
from simulators.setup import InstrumentSetup
from simulators.world import World

DEFAULT_RATE_DPS = 10.0
_DONE, _INVALID, _FAULT = Reply(Outcome.DONE), Reply(Outcome.INVALID), Reply(Outcome.FAULT)


class SimulatedEnsemble:
    """A controller with one axis, the head of the world or that of a `role`; energised until something disables it.

    Faults latch and disable the axis until they are acknowledged; a move beyond the software limits is such a fault.
    `frozen`: the feedback stands still. `stuck`: a move is acknowledged and does not begin.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, axis: str = "X", homed: bool = True, counts_per_unit: int = 1_000_000,
        software_limits_deg: tuple[float, float] = (-370.0, 370.0), role: str | None = None,
    ) -> None:  # fmt: skip
        self.faults = faults
        self._role, self._driven = role, world.axis_of(role)
        self.homed, self.enabled = homed, False
        self._world, self._axis = world, axis.upper()
        self._counts_per_unit, self._software_limits_deg = counts_per_unit, software_limits_deg
        self._latched = AxisFault(0)
        self._feedback_deg = self._driven.encoder_deg(world.now())
        self._words: dict[str, Callable[[Sequence[str]], Reply]] = {
            "ENABLE": self._enable,
            "DISABLE": self._disable,
            "MOVEABS": self._move,
            "ABORT": self._abort,
            "HOMEASYNC": self._home,
            "FAULTACK": self._acknowledge,
            "PFBK": lambda _: Reply(Outcome.DONE, f"{self._feedback():.6f}"),
            "AXISSTATUS": lambda _: Reply(Outcome.DONE, wire.signed(self._status())),
            "AXISFAULT": lambda _: Reply(Outcome.DONE, wire.signed(self._latched)),
            "GETPARM": self._parameter,
        }

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """As a bench file has it."""
        return cls(setup.world, setup.faults, axis=setup.options.axis, role=setup.axis)

    def session(self) -> EnsembleSession:
        """A new connection."""
        return EnsembleSession(self)

    def trip(self, fault: AxisFault) -> None:
        """A fault comes up: it latches, the axis stops and is disabled."""
        self._latched |= fault
        self.enabled = False
        self._world.stop(self._role)

    def execute(self, line: bytes) -> bytes:
        """Carries one line out; its answer."""
        try:
            command = wire.parse_command(line)
            if command == wire.parse_command(wire.NO_WAIT.encode()):
                return wire.render(_DONE)
            axis, *arguments = command.arguments
            if axis != self._axis:
                return wire.render(_INVALID)
            return wire.render(self._words[command.word](arguments))
        except (KeyError, ValueError):
            return wire.render(_INVALID)

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
        low_deg, high_deg = self._software_limits_deg
        if not low_deg <= move.angle_deg <= high_deg:
            above = move.angle_deg > high_deg
            self.trip(AxisFault.POSITIVE_SOFTWARE_LIMIT if above else AxisFault.NEGATIVE_SOFTWARE_LIMIT)
            return _FAULT
        if not self.faults.active("stuck"):
            self._world.move(move.angle_deg, move.rate_dps or DEFAULT_RATE_DPS, role=self._role)
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
        if list(arguments) != [wire.FINGERPRINT_PARAMETER.upper()]:
            return _INVALID
        return Reply(Outcome.DONE, str(self._counts_per_unit))

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

    MISHAPS: ClassVar[Mapping[FaultKind, Mishap]] = {
        **MEASURES_AND_OBEYS,
        "emergency_stop": Mishap(lambda head: head.trip(AxisFault.EMERGENCY_STOP)),
        "tripped": Mishap(lambda head: head.trip(AxisFault.POSITION_ERROR)),
    }


class EnsembleSession:
    """One connection: lines end with LF."""

    def __init__(self, controller: SimulatedEnsemble) -> None:
        self._controller = controller
        self._rest = b""

    def feed(self, data: bytes) -> bytes:
        """Takes bytes in any portions; the answers to the lines that they complete."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        return b"".join(self._controller.execute(line) for line in lines)
