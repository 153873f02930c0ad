"""Steps that measure single values and compare them with limits."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from bench.config.models import BenchFile
from bench.engine.context import Bench
from bench.engine.missed import Watch
from bench.engine.monitor import Monitor
from bench.engine.recording import outputs_of
from bench.engine.state import Tared
from bench.errors import StepError
from bench.metrology.outputs import mean_of
from bench.metrology.results.limits import judge
from bench.quality import Fresh, Window
from bench.sequence.language.readings import BY_NOMINAL, PULSE_RATE, is_pulse_rate, measured_place
from bench.sequence.steps.limits import limits_in
from bench.sequence.steps.measuring import Measure, Tare
from bench.store.decoder import Decoder
from drivers.can.frame_block import FrameBlock
from drivers.can.sorted_block import joined
from drivers.capabilities import PulseCounter

VALUE_LOOK_S = 0.1  # polling interval for a value newer than the beginning of the step
VALUE_WITHIN_S = 60.0  # longer than the polling period of any device


async def measure(step: Measure, step_id: str, bench: Bench) -> Mapping[str, Any]:
    """Measure one value, less the tare if requested, with its verdict and, if known, its standard uncertainty."""
    single = await _value(step.reading, step.duration_s, step_id, bench)
    if step.net:
        tares = bench.journal.state.tares
        if step.reading not in tares:
            raise StepError(f"{step.reading} has not been tared; put a tare step before this one")
        single = single.beyond(tares[step.reading])
    value, u, unit = single.value, single.u, single.unit
    found: dict[str, Any] = {"reading": step.reading, "value": value, "unit": unit, "u": u}
    if single.others:
        found["others"] = dict(single.others)
    if step.name is not None:
        found["as"] = step.name
    if step.limits is not None:
        limits = limits_in(step.limits, unit)
        judged = judge(value, u, limits)
        found |= {
            "limits": {
                "min": limits.low, "max": limits.high, "guard": limits.guard_k, "u_max": limits.u_allowed(value),
            },
            "verdict": judged.verdict, "marginal": judged.marginal,
        }  # fmt: skip
        if judged.verdict != "PASS":
            bench.notice(f"{step_id}: {step.reading} is {value:.6g} {unit}: {judged.verdict}")
    return found


async def tare(step: Tare, step_id: str, bench: Bench) -> Mapping[str, Any]:
    """Measure the mean that later measurements subtract."""
    single = await _value(step.reading, step.duration_s, step_id, bench)
    found = {"tare": step.reading, "value": single.value, "unit": single.unit, "u": single.u}
    return {**found, "scatter": single.scatter}


@dataclass(frozen=True, slots=True)
class _Single:
    """A measured value: standard uncertainties of its mean and, by a certificate, of offset and gain.

    The offset of an instrument is in the tare as well and cancels in the difference from it. `others` are the outputs
    of the other accelerometers of an inertial unit in the same time.
    """

    value: float
    unit: str
    scatter: float
    offset_u: float | None = 0.0
    gain_u: float = 0.0
    others: Mapping[str, float] = field(default_factory=dict)

    @property
    def u(self) -> float | None:
        """Standard uncertainty; None if unknown."""
        return None if self.offset_u is None else math.hypot(self.scatter, self.offset_u, self.gain_u * self.value)

    def beyond(self, tared: Tared) -> _Single:
        """Return the difference from the tare."""
        scatter, offset_u = math.hypot(self.scatter, tared.scatter), None if self.offset_u is None else 0.0
        return replace(self, value=self.value - tared.value, scatter=scatter, offset_u=offset_u)


async def _value(name: str, duration_s: float | None, step_id: str, bench: Bench) -> _Single:
    """Return the mean of a reading over a time, or its newest value."""
    name = bench.file.members(name)[0]
    if (place := measured_place(name, bench.file)) is not None:
        return await _output_in_g(place, name.partition(f".{place}")[2][1:], duration_s or 0.0, step_id, bench)
    if is_pulse_rate(name, bench.file):
        return await _pulse_rate(name, duration_s or 0.0, step_id, bench)
    unit = bench.monitor.unit_of(name)
    began_s = asyncio.get_running_loop().time()
    await asyncio.sleep(duration_s or 0.0)
    await _value_since(began_s, name, bench.monitor)
    window = bench.monitor.window(name, duration_s or 0.0, began_s)
    if not isinstance(window, Window):
        raise StepError(f"{name} {window.why}. Nothing is measured from it. Check the sensor and the device.")
    values = window.values
    mean = float(values.mean())
    scatter = float(values.std(ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else 0.0
    return _Single(mean, unit, scatter, *_certified(name, bench.file))


async def _value_since(began_s: float, name: str, monitor: Monitor) -> None:
    """Wait for a value that was read after the step began; StepError if none arrives."""
    loop = asyncio.get_running_loop()
    give_up_s = loop.time() + VALUE_WITHIN_S
    while True:
        await monitor.wait_for_fresh(name)
        latest = monitor.latest(name)
        if isinstance(latest, Fresh) and latest.reading.at_s >= began_s:
            return
        if loop.time() >= give_up_s:
            last = "" if isinstance(latest, Fresh) else f"; it {latest.why}"
            raise StepError(f"{name} has delivered no value for {VALUE_WITHIN_S:g} s{last}. Check the device.")
        await asyncio.sleep(VALUE_LOOK_S)


def _certified(name: str, file: BenchFile) -> tuple[float | None, float]:
    """Standard uncertainties of offset and gain from the certificate of a named reading; None without one."""
    entry = file.readings.get(name)
    if entry is None or entry.calibration is None:
        return None, 0.0
    certificate = entry.calibration
    return certificate.U.offset / certificate.k, certificate.U.gain / certificate.k


async def _output_in_g(place: str, sensor: str, duration_s: float, step_id: str, bench: Bench) -> _Single:
    """Mean output of a unit over a time, in g by its nominal scale factor; its zero offset is included.

    Of an inertial unit that of one accelerometer, a `sensor`.
    """
    outputs, per_g = await outputs_of(place, duration_s, step_id, bench), bench.file.nominal_per_g(place)
    found = outputs[sensor]
    if per_g is None:
        raise StepError(f"the bench file does not give the nominal output at 1 g of the unit in place {place}")
    if math.isnan(found.value):
        raise StepError(
            f"the output of the unit in place {place}: too little data in {duration_s:g} s; measure longer, or check "
            f"{bench.file.measured_by(place)}"
        )
    scatter = math.hypot(found.single_u, found.quantisation_u) / abs(per_g)
    others = {name: each.value / per_g for name, each in outputs.items() if name != sensor}
    return _Single(found.value / per_g, BY_NOMINAL, scatter, others=others)


async def _pulse_rate(name: str, duration_s: float, step_id: str, bench: Bench) -> _Single:
    """Net pulse rate of a counter channel over a time; the frames are stored with the step."""
    role, _, channel = name.partition(".")
    counter = bench.rig.counter(role)
    block = await frames_of(counter, duration_s)
    if len(block):
        bench.writer.frames(role, step_id, block)
        gaps = Watch(bench, step_id)
        gaps.frames(role, block)
        await gaps.report()
    found = mean_of(Decoder(bench.file.devices[role]).outputs(block)[channel])
    if math.isnan(found.value):
        raise StepError(f"{name}: too few latches arrived in {duration_s:g} s; count longer, or check the counter")
    return _Single(found.value, PULSE_RATE, found.single_u)


async def frames_of(counter: PulseCounter, duration_s: float) -> FrameBlock:
    """Return all frames that arrive within a time."""
    kept: list[FrameBlock] = []

    async def keep(blocks: AsyncIterator[FrameBlock]) -> None:
        async for block in blocks:
            kept.append(block)  # noqa: PERF401  a comprehension would lose what came before the end

    gate = asyncio.timeout(duration_s)
    async with counter.acquire() as blocks:
        try:
            async with gate:
                await keep(blocks)
        except TimeoutError:
            if not gate.expired():  # a silent counter is a TimeoutError too
                raise
    await keep(blocks)
    return joined(kept)
