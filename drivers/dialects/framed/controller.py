"""Dialogue about one axis with a controller with a frame protocol, head or table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.description import Setup
from drivers.dialects.framed.description import FramedOptions
from drivers.dialects.framed.line import FramedLine
from drivers.dialects.framed.parts import Number
from drivers.dialects.framed.status import Status
from drivers.dialects.framed.wire import NumberFormat, Raw
from drivers.errors import BeyondLimit, CannotConnect, InstrumentFault, Refused
from drivers.recognised import Recognised
from drivers.timing.readback import read_back
from drivers.values import Identity


class FramedAxis:
    """Common part of head and table axes: reads the status and sends commands, each proved by the status after it.

    Lifetime: `open`, then `close`; `reopen` when the wire was lost. Concurrency: callers queue for the line.
    """

    def __init__(self, setup: Setup[Any, Any, Any], options: FramedOptions) -> None:
        profile = options.profile.content
        if profile is None:
            raise CannotConnect(
                setup.name, f"the profile {options.profile.path} of its controller is gone",
                remedy="Put the file back beside the bench file.",
            )  # fmt: skip
        self._device, self.profile, self._pin = setup.name, profile, setup.identity
        self._recognised = Recognised(setup.name, setup.identity)
        self._last: Status | None = None
        self.line = FramedLine(setup, profile, answer_s=options.answer_timeout, check=self._take)

    async def open(self) -> None:
        """Connect and identify; raises CannotConnect, NoAnswer, WrongIdentity."""
        await self.line.open()

    async def reopen(self) -> None:
        """Connect again if the wire was lost; else nothing."""
        await self.line.reopen()

    def close(self) -> None:
        """Close the wire; closing twice is harmless."""
        self.line.close()

    async def identify(self) -> Identity:
        """Query the identity: names as stated, the status compared with them. Raises WrongIdentity."""
        return self._recognise(await self._status())

    async def _status(self) -> Status:
        """State of the axis; raises WrongIdentity if the status comes from another controller."""
        status = await self.line.status()
        self._take(status)
        return status

    def _check_faults(self, status: Status, sent: str = "") -> None:
        """Raise InstrumentFault with the names of the present faults, met by `sent`; clears nothing."""
        if status.faults:
            raise self._fault(", ".join(status.faults), sent, str(status))

    def _fault(self, names: str, sent: str, received: str) -> InstrumentFault:
        """Exception for a fault reported by the controller."""
        return InstrumentFault(
            self._device, f"the controller reports a fault: {names}", sent=sent, received=received,
            remedy="Remove the cause, clear the fault at the controller, then run again.",
        )  # fmt: skip

    async def enable(self) -> Status:
        """Energise the motor, if there is a command for it; Refused unless the status confirms it."""
        if self.profile.commands.enable is not None:
            await self.line.send_command("enable")
        status = await read_back(self._status, lambda status: status.enabled or status.faults)
        self._check_faults(status, "enable")
        if not status.enabled:
            raise Refused(
                self._device, "the motor stays off", sent="enable", received=str(status),
                remedy="Check the emergency stop and the amplifier, then run again.",
            )  # fmt: skip
        return status

    async def _send_command(self, name: str, **values: float) -> None:
        """Send a command once, with those values that its frame has a field for.

        If the status reports the active command, it must not differ from the one sent; a command that seems lost is not
        repeated: the motion of the axis decides. Raises BeyondLimit, Refused, InstrumentFault.
        """
        self._check_limits(values)
        commanded = self._raw(name, values)
        echo = {"move": ("angle", "target_angle"), "rate": ("rate", "target_rate")}.get(name)
        before = self._last  # waiting here would let a stop be sent before the command
        await self.line.send_command(name, commanded.values())
        if before is None or echo is None:
            return
        after = await self._status()
        self._check_faults(after, name)
        self._check_taken(name, commanded[echo[0]], echo[1], before, after)

    def _check_limits(self, values: Mapping[str, float]) -> None:
        """Raise BeyondLimit if a motion exceeds the controller's limits in the profile."""
        allowed, rate_dps, angle_deg = self.profile.limits, values.get("rate"), values.get("angle")
        problem = ""
        if allowed.rate is not None and rate_dps is not None and abs(rate_dps) > allowed.rate.max:
            problem = f"the rate {rate_dps:g} °/s is above the {allowed.rate.max:g} °/s of the profile"
        angles = allowed.angle
        if angles is not None and angle_deg is not None and not angles.min <= angle_deg <= angles.max:
            problem = f"the angle {angle_deg:g}° is outside the {angles.min:g}° to {angles.max:g}° of the profile"
        if problem:
            raise BeyondLimit(
                self._device, problem, remedy="No motion was sent. Correct the sequence, or limits in the profile."
            )  # fmt: skip

    def _raw(self, name: str, values: Mapping[str, float]) -> dict[str, tuple[NumberFormat, Raw]]:
        """Convert values to wire units; Refused if one does not fit its field."""
        found = {}
        for key, value in values.items():
            number = getattr(self.profile.shape(name), key, None)
            if isinstance(number, Number):
                form = self.profile.number(number)
                try:
                    found[key] = (form, form.raw(value))
                except OverflowError as problem:
                    raise Refused(
                        self._device, f"this {key} does not fit its frame: {problem}; nothing was sent", sent=name,
                        remedy="Correct the sequence, or type and scale in the profile if they are wrong.",
                    ) from problem  # fmt: skip
        return found

    def _check_taken(
        self, name: str, commanded: tuple[NumberFormat, Raw], key: str, before: Status, after: Status
    ) -> None:  # fmt: skip
        """Raise Refused if the active command is neither the one sent nor the previous one."""
        number: Number | None = getattr(self.profile.status, key)
        if number is None:
            return
        form, (sent_form, sent) = self.profile.number(number), commanded
        wanted, kept = form.raw(sent_form.value(sent)), getattr(after, key)
        if kept not in (wanted, getattr(before, key)):
            raise Refused(
                self._device, f"the controller took another {key.replace('_', ' ')} than commanded",
                sent=f"{name} {sent_form.value(sent):g} ({wanted})", received=f"{form.value(kept):g} ({kept})",
                remedy="Look for a limit of the controller, or for another master.",
            )  # fmt: skip

    def _take(self, status: Status) -> None:
        self._recognise(status)
        self._last = status

    def _recognise(self, status: Status) -> Identity:
        """Compare the sender of a status with the bench file and with that of earlier connections."""
        serial, firmware = status.serial_number, status.firmware
        pin, profile = self._pin, self.profile
        found = Identity(
            maker=pin.maker or profile.maker, model=pin.model or profile.model,
            serial=pin.serial or "" if serial is None else str(serial),
            firmware=pin.firmware or "" if firmware is None else str(firmware),
            verified=serial is not None, fingerprint=profile.fingerprint(),
        )  # fmt: skip
        return self._recognised.check(found, f"{found.serial} {found.firmware}".strip())
