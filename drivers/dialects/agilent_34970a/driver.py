"""An Agilent 34970A or 34972A as thermometers: every poll scans all sensors."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Self

from drivers.description import Nothing, Setup
from drivers.dialects.agilent_34970a import wire
from drivers.dialects.agilent_34970a.description import ScannerOptions
from drivers.errors import InstrumentFault, Refused
from drivers.timing.readback import read_back
from drivers.transport.dialogue import retry_once
from drivers.transport.scpi import ScpiLink
from drivers.values import Identity, Reading

_SCAN_S, _CHANNEL_S = 3.0, 0.6  # time limit of a scan: its answer, and each sensor with its relay


class Agilent34970A:
    """One scanner. Every poll reads the scan list, then scans once.

    A changed scan list, sensor or unit, or a running scan of another master, is a fault and is not corrected silently.
    An open or overloaded sensor has no reading.

    Concurrency: polls are queued.
    """

    def __init__(self, setup: Setup[ScannerOptions, Nothing, Nothing]) -> None:
        self.name = setup.name
        self._pin, self._on_serial_line = setup.identity, setup.address.is_serial_line
        self._names, self._sensors = setup.options.names(), setup.options.sensors()
        end = b"\r\n" if self._on_serial_line else b"\n"
        self._link = ScpiLink(setup, end=end, read_identity=wire.read_identity)
        self._turn, self._note, self._begun_s = asyncio.Lock(), setup.note, 0.0

    async def __aenter__(self) -> Self:
        """Connect, identify and set up the scan; raises CannotConnect, WrongIdentity, Refused."""
        await self._link.open()
        try:
            await self._set_up()
        except BaseException:
            self._link.close()
            raise
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Close the connection; the scan list remains."""
        self._link.close()

    async def identify(self) -> Identity:
        """Query the identity, with the cards in the slots as fingerprint; raises WrongIdentity.

        A 34970A does not report its serial number: it is then the one stated in the bench file, unverified.
        """
        found = await self._link.identify()
        cards = [await self._link.query(f":SYST:CTYP? {slot}".encode(), wire.read_card) for slot in wire.SLOTS]
        serial = found.serial if found.verified else self._pin.serial or ""
        return found._replace(serial=serial, fingerprint=f"cards {', '.join(cards)}")

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Scan once; readings (°C) by name, each with its time, None if a sensor is open or overloaded.

        Raises InstrumentFault if the setup has changed or another master scans, BadAnswer if the scan has other
        channels.
        """
        async with self._turn:
            state, wanted = await self._state(), wire.state_when(self._sensors)
            if state != wanted:
                raise InstrumentFault(
                    self.name, f"its setup has changed; expected a scan of {wire.listed(wanted.channels)}",
                    received=_state_text(state),
                    remedy="Look for a power failure, a front panel in use, or another master; then run again.",
                )  # fmt: skip
            samples = await self._link.double_read.confirmed(
                "a scan", self._scan, repeat=self._stored_scan, describe=_samples_text
            )
        return {
            self._names[sample.channel]: (
                [] if sample.temperature_c is None else [Reading(self._begun_s + sample.since_s, sample.temperature_c)]
            )
            for sample in samples
        }

    async def make_safe(self) -> None:
        """Do nothing: a thermometer energises nothing."""

    async def _set_up(self) -> None:
        """Set up the scan, message by message, and read it back; raises Refused."""
        messages = wire.set_up(self._sensors)
        for message in [wire.REMOTE, *messages] if self._on_serial_line else messages:
            await self._link.write(message)
        wanted = wire.state_when(self._sensors)
        state = await read_back(self._state, lambda state: state == wanted)
        if state != wanted:
            raise Refused(
                self.name, "a setting was not executed", sent=messages[-1], received=_state_text(state),
                remedy="Check the cards in its slots, and channels and sensors in the bench file.",
            )  # fmt: skip
        for sensor in self._sensors:
            found = await self._link.query(question := wire.type_query(sensor), wire.read_type)
            if found != sensor.type:
                raise Refused(
                    self.name, f"channel {sensor.channel} is not of type {sensor.type}", sent=question.decode(),
                    received=found, remedy="Check its sensor in the bench file, and for another master of the scanner.",
                )  # fmt: skip

    async def _scan(self) -> list[wire.Sample]:
        return await retry_once(self._scan_once, self._note)

    async def _scan_once(self) -> list[wire.Sample]:
        timeout_s = _SCAN_S + _CHANNEL_S * len(self._sensors)
        self._begun_s = asyncio.get_running_loop().time()  # reference of the times of its readings
        return await self._link.query_once(wire.SCAN_ONCE, self._read_scan, answer_s=timeout_s)

    async def _stored_scan(self) -> list[wire.Sample]:
        """Read the last scan from memory."""
        return await self._link.query(wire.SCANNED, self._read_scan)

    async def _state(self) -> wire.State:
        return await self._link.query(wire.state_query(self._sensors), wire.read_state)

    def _read_scan(self, line: bytes) -> list[wire.Sample]:
        samples = wire.read_scan(line)
        if [sample.channel for sample in samples] != list(self._names):
            raise ValueError(f"readings of other channels than {wire.listed(list(self._names))}")
        return samples


def _state_text(state: wire.State) -> str:
    running = ", a scan running" if state.scanning else ""
    return f"{wire.listed(state.channels)} as {','.join(state.kinds)} in {','.join(state.units)}{running}"


def _samples_text(samples: Sequence[wire.Sample]) -> str:
    return ", ".join(
        f"{sample.channel}: " + ("open" if sample.temperature_c is None else f"{sample.temperature_c:.3f} °C")
        for sample in samples
    )
