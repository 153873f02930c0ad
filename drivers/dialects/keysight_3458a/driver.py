"""A Keysight 3458A as a meter: one range, settings verified before every measurement."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Self

from drivers.description import Nothing, Setup, check_identity
from drivers.dialects.keysight_3458a import wire
from drivers.dialects.keysight_3458a.description import MeterOptions
from drivers.dialects.keysight_3458a.wire import Setting
from drivers.errors import BeyondLimit, InstrumentFault, NoAnswer, Refused
from drivers.recognised import Recognised
from drivers.timing.readback import read_back
from drivers.transport.dialogue import Dialogue, retry_once
from drivers.transport.exchange import Pace, SyncQuery
from drivers.values import Identity, Reading

MAX_ERRORS = 32  # more than the bits of its two registers
MAX_READINGS = 10_000  # so that readings nobody polls do not accumulate
_SLOWEST_LINE_HZ = 45.0
_SLACK_S = 1.0
_LONGEST_S = wire.duration_s(wire.NPLCS[-1], _SLOWEST_LINE_HZ) + _SLACK_S


class Keysight3458A:
    """One meter, here for DC volts.

    A second master, a power failure or a front panel in use changes settings, which are read before every measurement:
    a change is a fault and is not corrected silently.

    Concurrency: measurements queue. A `poll` during a measurement returns its readings so far.
    """

    _function = wire.DC_VOLTS
    _channel = "voltage"

    def __init__(self, setup: Setup[MeterOptions, Nothing, Nothing]) -> None:
        self.name = setup.name
        self._options, self._pin = setup.options, setup.identity
        sync_query = SyncQuery(wire.IDENTITY_QUERY, self._recognise)
        # An abandoned reading may still arrive, so the line is silent only after the duration of the longest one.
        pace = Pace(quiet_s=_LONGEST_S)
        self._dialogue = Dialogue(setup, sync_query, end=wire.END, pace=pace)
        self._turn, self._note = asyncio.Lock(), setup.note
        self._recognised = Recognised(setup.name, setup.identity)
        self._set: Setting | None = None  # settings that were made and read back
        self._line_hz = _SLOWEST_LINE_HZ
        self._fresh: deque[Reading] = deque(maxlen=MAX_READINGS)

    async def __aenter__(self) -> Self:
        """Connect, identify, set up the instrument; raises CannotConnect, WrongIdentity, InstrumentFault."""
        await self._dialogue.open()
        try:
            await retry_once(self._errors, self._note)  # errors caused by other masters are discarded
            self._line_hz = await self._dialogue.query(wire.LINE_FREQUENCY_QUERY, wire.read_number)
            await self._set_up(self._setting(self._options.nplc))
        except BaseException:
            self._dialogue.close()
            raise
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Close the connection; the instrument keeps waiting for a trigger."""
        self._dialogue.close()

    async def identify(self) -> Identity:
        """Query the identity; the serial number is the stated one, because the wire does not report it.

        The fingerprint is the calibration count. Raises WrongIdentity, also when anything has changed.
        """
        async with self._turn:
            reported = await self._dialogue.query(wire.IDENTITY_QUERY, self._recognise)
            revision = await self._dialogue.query(wire.REVISION_QUERY, wire.read_numbers)
            calibrations = await self._dialogue.query(wire.CALIBRATIONS_QUERY, wire.read_number)
        found = reported._replace(
            serial=self._pin.serial or "", firmware=",".join(f"{number:g}" for number in revision),
            fingerprint=f"calibrated {calibrations:.0f} times",
        )  # fmt: skip
        return self._recognised.check(found, str(found))

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Take one reading, or return those of the running measurement; InstrumentFault as `measure`."""
        if not self._turn.locked():
            async with self._turn:
                await self._read(1)
        fresh = list(self._fresh)
        self._fresh.clear()
        return {self._channel: fresh}

    async def measure(self, count: int, *, nplc: float | None) -> Sequence[Reading]:
        """Take `count` consecutive readings (V, or A of an ammeter), each with its mid-integration time.

        Each integrates over `nplc` cycles of the power line, 1 to 10 or 20 to 100 in tens; None takes that of the bench
        file. Raises BeyondLimit before anything is sent, Refused if the setting is rejected, InstrumentFault if
        settings have changed, there is an error, or the input is over range.
        """
        wanted = self._setting(self._options.nplc if nplc is None else nplc)
        if wanted.nplc not in wire.NPLCS:
            raise BeyondLimit(
                self.name, f"{wanted.nplc:g} line cycles are not 1 to 10, or 20 to 100 in tens",
                remedy="Nothing was sent. Correct the sequence.",
            )  # fmt: skip
        async with self._turn:
            if wanted != self._set:
                await self._set_up(wanted)
            return await self._read(count)

    async def make_safe(self) -> None:
        """Do nothing: a meter energises nothing."""

    def _setting(self, nplc: float) -> Setting:
        return Setting(self._options.range, nplc, self._function)

    async def _set_up(self, setting: Setting) -> None:
        """Set up the instrument and read the settings back; raises Refused."""
        self._set = None
        message = wire.set_up(setting)
        await self._dialogue.send_command(message, wire.read_numbers)
        problem = "; ".join(await retry_once(self._errors, self._note))
        if problem := problem or await read_back(lambda: self._misfit(setting), lambda misfit: not misfit):
            raise Refused(
                self.name, "a setting was not executed", sent=message.decode(), received=problem,
                remedy="Look at its display, and check range and nplc in the bench file.",
            )  # fmt: skip
        self._set = setting

    async def _read(self, count: int) -> Sequence[Reading]:
        """Take readings, with settings verified before and after; raises InstrumentFault."""
        setting = self._set
        if setting is None or (misfit := await self._misfit(setting)):
            raise InstrumentFault(
                self.name, "its settings have changed", received="" if setting is None else misfit,
                remedy="Look for a power failure, a front panel in use, or another master; then run again.",
            )  # fmt: skip
        readings, errors = await self._verified(setting, count)
        if errors:
            raise InstrumentFault(self.name, "has errors after a measurement", received="; ".join(errors))
        return readings

    async def _verified(self, setting: Setting, count: int) -> tuple[Sequence[Reading], list[str]]:
        """Readings confirmed by an error query after them.

        An error is reported only once: if its answer is missing, the readings before it are rejected.
        """
        readings = [await self._reading(setting) for _ in range(count)]
        try:
            return readings, await self._errors()
        except NoAnswer as problem:
            self._note(f"measured again: {problem}")
        return [await self._reading(setting) for _ in range(count)], await self._errors()

    async def _reading(self, setting: Setting) -> Reading:
        duration_s = wire.duration_s(setting.nplc, self._line_hz)
        value = await self._dialogue.query(wire.TRIGGER, wire.read_number, answer_s=duration_s + _SLACK_S)
        if abs(value) >= wire.OVERLOAD:
            raise InstrumentFault(
                self.name, f"the input is beyond the {setting.full_scale:g} {setting.function.unit} range",
                received=f"{value:g}",
                remedy="Check what is connected to it, and its range in the bench file.",
            )  # fmt: skip
        now_s = asyncio.get_running_loop().time()
        reading = Reading(now_s - wire.middle_before_answer_s(setting.nplc, self._line_hz), value)
        self._fresh.append(reading)
        return reading

    async def _misfit(self, setting: Setting) -> str:
        """First answer with a different setting, "" if there is none."""
        for question, expected in wire.state_when(setting).items():
            found = await self._dialogue.query(question, wire.read_numbers)
            if found[: len(expected)] != expected:
                reported, wanted = (", ".join(f"{number:g}" for number in numbers) for numbers in (found, expected))
                return f"{reported} to {question.decode()}, expected {wanted}"
        return ""

    async def _errors(self) -> list[str]:
        """Read and clear all error registers; raises InstrumentFault for faults of the instrument itself."""
        errors: list[str] = []
        faults: list[str] = []
        for _ in range(MAX_ERRORS):
            entry = await self._dialogue.query_once(wire.ERROR_QUERY, wire.read_error)
            if not entry.code:
                break
            (faults if wire.is_own_fault(entry) else errors).append(str(entry))
        else:
            raise InstrumentFault(self.name, "its error registers do not become empty", received=str(entry))
        if faults:
            raise InstrumentFault(
                self.name, "the instrument reports a fault of its own", received="; ".join(faults),
                remedy="Look it up in its user's guide (ERR?, AUXERR?); it may need calibration or repair.",
            )  # fmt: skip
        return errors

    def _recognise(self, line: bytes) -> Identity:
        """Query maker and model; raises WrongIdentity if they are not those of the bench file."""
        found = wire.read_identity(line)
        check_identity(self.name, self._pin.model_copy(update={"firmware": None}), found)
        return found


class Keysight3458AAmmeter(Keysight3458A):
    """The same for DC current; its burden voltage loads the source."""

    _function = wire.DC_CURRENT
    _channel = "current"
