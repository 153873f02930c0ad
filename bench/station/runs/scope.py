"""The newest acquired samples of a run, each of them, for a view as on an oscilloscope."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.metrology.acquisition import Counts
from bench.metrology.pulse_counts import steps_of
from bench.station.runs.series import Array, angle_of, angles_deg, decoders_in, rates_of, units_of
from bench.store.blocks import unpack_all
from bench.store.database import FILE_NAME
from bench.store.decoder import Decoder
from bench.store.tail import Begins, Tail

MOST = 20_000  # samples of a channel
MOST_BLOCKS = 100


class Samples(NamedTuple):
    """Samples of a channel: instants of bench time in s, and values in a unit, both (N,)."""

    unit: str
    at_s: Array
    values: Array


class Scope(NamedTuple):
    """Newest samples of a run, of the step in which they were acquired; `begins` is the instant and bench time in s."""

    step: str
    until_s: float
    channels: Mapping[str, Samples]
    begins: Begins


NOTHING = Scope("", 0.0, {}, None)


def newest_samples(run: Path, over_s: Callable[[str], float]) -> Scope:
    """Return the samples of the newest acquisition over a time in s before its end, which depends on its step.

    Pulse rates are those between consecutive latches, encoders are in degrees. Raises InputError and StoreError.
    """
    if not (run / FILE_NAME).exists():
        return NOTHING  # it has just begun
    with Tail(run) as tail:
        newest, begins = tail.blocks(0.0, 1), tail.begins()
        if not newest:
            return NOTHING
        step, until_s = newest[0].step, newest[0].last_s
        blocks = [each for each in tail.blocks(until_s - over_s(step), MOST_BLOCKS) if each.step == step]
    found: dict[str, Samples] = {}
    for stream, decoder in decoders_in(run).items():
        frames = [each.packed for each in blocks if each.stream == stream]
        if frames:
            found |= dict(_samples(stream, decoder, unpack_all(frames), units_of(run)))
    since_s = max((each.at_s[-1] for each in found.values()), default=until_s) - over_s(step)
    return Scope(
        step, until_s, {name: _newest(each, since_s) for name, each in found.items() if len(each.at_s)}, begins
    )


def period_s(steps: Iterable[Mapping[str, Any]], step: str) -> float | None:
    """Return the period in s of the oscillation of a plan in which a step is, the longest one of a sweep; or None."""
    for each in steps:
        facts = each["facts"]
        if facts["verb"] == "oscillate" and step.startswith(f"{each['id']}/"):
            sweep = facts.get("sweep") or {}
            known = (facts.get("frequency_hz"), sweep.get("from_hz"), sweep.get("to_hz"))
            return max((1 / each for each in known if each), default=None)
    return None


def _samples(stream: str, decoder: Decoder, block: Any, units: Mapping[str, str]) -> Iterator[tuple[str, Samples]]:
    for channel, output in decoder.outputs(block).items():
        name = f"{stream}.{channel}"
        at_s = _instants(output.host_s, output.tick, output.tick_bits, output.tick_period_s)
        if isinstance(output, Counts):
            yield name, Samples(units[name], at_s[1:], rates_of(output))
        else:
            yield name, Samples(units[name], at_s, output.values)
    for role, position in decoder.positions(block).items():
        at_s = _instants(position.host_s, position.tick, position.tick_bits, position.tick_period_s)
        yield angle_of(role), Samples("°", at_s, angles_deg(position))


def _instants(host_s: Array, tick: Any, bits: int, period_s: float) -> Array:
    """Return the instants of latches by the clock of the device, which arrive with the last one."""
    since_s = np.concatenate([[0.0], np.cumsum(steps_of(tick, bits) * period_s)]) if len(tick) else np.empty(0)
    return since_s + (host_s[-1] - since_s[-1]) if len(tick) else since_s


def _newest(found: Samples, since_s: float) -> Samples:
    kept = np.flatnonzero((found.at_s >= since_s) & np.isfinite(found.values))[-MOST:]
    return Samples(found.unit, found.at_s[kept], found.values[kept])
