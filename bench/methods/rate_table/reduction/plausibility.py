"""Records of a rate table that contradict its commands: units, exchanged columns (equations 5)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from bench.methods.rate_table.reduction.blocks import LEAST_SAMPLES, Block, TableRecord, cut_into_blocks
from bench.metrology.least_squares import Array
from bench.metrology.plausibility import Doubt, slip

FASTEST_DPS = 5000.0  # any table
LARGEST_ARM_M = 10.0
SMALLEST_RADIUS_M = 0.01  # a centrifuge
LEAST_OF_RANGE = 0.01  # minimum share of the full scale for the largest input of its test
LARGEST_LOW_G = 1.5  # low rates are those up to 1 g
WITHIN = (0.5, 2.0)  # ratio of a rate to its command
GAINS = (0.1, 10.0)  # gain of a gyro at the lowest frequency
OUT_OF_ORDER = 0.01  # share of the samples of a block
MOST_FALLING = 0.9  # share of its time steps
NAMED = 5  # blocks
BELOW_CLIP = 0.9  # of the clip level; below it a sensor is not at the end of its range
LIKE = 0.1  # relative difference of equal rates
SWINGS_HZ = (0.5, 2.0)  # ratio of a frequency to its command
INTERVALS = (0.5, 2.0)  # ratio of the time between samples to the interval of one


def _blocks(record: TableRecord) -> dict[str, Block]:
    return cut_into_blocks(record, Counter())


def _slope(block: Block, values: Array) -> float:
    """Mean slope from the first sample to the last."""
    return float((values[-1] - values[0]) / (block.time_s[-1] - block.time_s[0])) if len(block.time_s) > 1 else np.nan


def clock(record: TableRecord) -> Iterator[Doubt]:
    """Doubt about blocks with a clock that ran backwards or was set back; rows in another order do not count."""
    names, which = np.unique(record.block, return_inverse=True)
    of_blocks = np.split(np.argsort(which, kind="stable"), np.cumsum(np.bincount(which))[:-1])
    odd = [name for name, rows in zip(names.tolist(), of_blocks, strict=False) if _goes_back(record.time_s[rows])]
    if odd:
        named = ", ".join(f"{name:g} Hz" if isinstance(name, float) else name for name in odd[:NAMED])
        yield Doubt(
            "implausible_time",
            f"t_s goes backwards within {named}; sort the rows if only their order is wrong, and leave out a block "
            "whose clock ran backwards or was set back",
        )


def _goes_back(time_s: Array) -> bool:
    """True if times (n,) fall throughout, or in few places to earlier times; copies count once."""
    time_s = time_s[np.isfinite(time_s)]
    time_s = time_s[np.sort(np.unique(time_s, return_index=True)[1])]
    back = np.flatnonzero(np.diff(time_s) < 0) + 1
    if len(time_s) < LEAST_SAMPLES or OUT_OF_ORDER * len(time_s) < len(back) <= MOST_FALLING * (len(time_s) - 1):
        return False
    if len(back) > MOST_FALLING * (len(time_s) - 1):
        return True
    pieces = np.concatenate(sorted(np.split(time_s, back), key=lambda piece: float(piece[0])))
    late = pieces < np.maximum.accumulate(pieces)
    early = pieces > np.minimum.accumulate(pieces[::-1])[::-1]
    return min(int(np.sum(late)), int(np.sum(early))) > OUT_OF_ORDER * len(
        time_s
    )  # a single outlying time gives many deviations of one kind


def gyro_range(
    record: TableRecord, commands_dps: Mapping[str, float], clip_dps: float | None = None
) -> Iterator[Doubt]:
    """Doubt about a table rate, by its encoder, or an output that is far from its command."""
    blocks = _blocks(record)
    yield from _stuck(blocks, clip_dps)
    commanded = [(block, commands_dps[name]) for name, block in blocks.items() if name in commands_dps]
    commanded = [(block, rate_dps) for block, rate_dps in commanded if len(block.time_s) > 1]
    if not commanded:
        return
    turned = float(np.median([_slope(block, block.table) / rate_dps for block, rate_dps in commanded]))
    ramps = float(np.median([_slope(block, block.output) / rate_dps for block, rate_dps in commanded]))
    read = float(np.median([np.median(block.output) / rate_dps for block, rate_dps in commanded]))
    if abs(turned) < LIKE and abs(ramps - 1) < LIKE:
        yield Doubt("columns_exchanged", "enc_deg and out_dps: the output rises as an angle does, the encoder does not")
        return
    if abs(turned + 1) < LIKE:
        yield Doubt("", "the encoder turned the other way than the commands")
    elif not WITHIN[0] <= turned <= WITHIN[1]:
        yield _angle(f"by enc_deg and t_s the table turned at {turned:.4g} times the commands", turned)
    if abs(read + 1) < LIKE:
        yield Doubt("", "out_dps has the sign opposite to the commands")
    elif not WITHIN[0] <= read <= WITHIN[1]:
        yield Doubt("implausible_scale", f"out_dps is {read:.4g} times the commands{slip(read)}")


def _stuck(blocks: Mapping[str, Block], clip: float | None) -> Iterator[Doubt]:
    """Doubt about an output constant in a whole block, and to the end of another at a different rate.

    It may be 0 in a dead band, equal if its resolution is coarse compared with the difference of two rates, and
    constant at the end of the range of a sensor, which is the largest output if no clip level is stated.
    """
    seen = np.unique(np.concatenate([block.output for block in blocks.values()] or [np.empty(0)]))
    step = np.min(np.diff(seen), initial=np.inf)
    most = np.max(np.abs(seen), initial=0.0) if clip is None else BELOW_CLIP * clip
    still: dict[float, list[str]] = {}
    for name, block in blocks.items():
        last = float(block.output[-1]) if block.complete else 0.0
        if step / LIKE < abs(last) < most and not np.ptp(block.output[-LEAST_SAMPLES:]):
            still.setdefault(last, []).append(name)
    for names in still.values():
        rates_dps = [abs(_slope(blocks[name], blocks[name].table)) for name in names]
        whole = any(not np.ptp(blocks[name].output) for name in names)
        if whole and np.ptp(rates_dps) > LIKE * max(rates_dps):
            yield Doubt("implausible_output", f"the output is the same number in {', '.join(names[:NAMED])}: frozen")


def _angle(seen: str, ratio: float) -> Doubt:
    is_time = min(abs(abs(ratio) / each - 1) for each in (1e3, 1e-3, 60, 1 / 60)) < 0.02
    return Doubt("implausible_time" if is_time else "implausible_angle", seen + slip(ratio))


def of_range(largest: float, full_scale: float | None, setting: str) -> Iterator[Doubt]:
    """Doubt about a range whose largest input is next to zero."""
    if full_scale is not None and 0 < abs(largest) < LEAST_OF_RANGE * full_scale:
        seen = f"the largest input is {abs(largest):.4g}, and settings.{setting} is {full_scale:g}"
        yield Doubt("implausible_scale", f"{seen}: see the units of both")


def accelerometer_range(
    record: TableRecord, radius_m: float | None, bias_g: float | None, clip_g: float | None = None
) -> Iterator[Doubt]:
    """Doubts about readings beyond 1 g at low rates, an arm longer than any table, a table faster than any."""
    blocks = _blocks(record)
    yield from _stuck(blocks, clip_g)
    low_g = [abs(float(np.median(b.output)) - (bias_g or 0.0)) for name, b in blocks.items() if name.startswith("low")]
    rates_dps = [abs(_slope(block, block.table)) for block in blocks.values() if len(block.time_s) > 1]
    fastest_dps = max(rates_dps, default=0.0)
    if low_g and max(low_g) > LARGEST_LOW_G:
        yield Doubt(
            "implausible_scale",
            f"acc_g: {max(low_g):.4g} g at a low rate, which goes up to 1 g: m/s², or mg?",
        )
    if fastest_dps > FASTEST_DPS:
        yield Doubt(
            "implausible_angle",
            f"by enc_deg and t_s the table turned at {fastest_dps:.4g} °/s: see their units",
        )
    if radius_m is not None and np.isfinite(radius_m) and not SMALLEST_RADIUS_M <= abs(radius_m) <= LARGEST_ARM_M:
        yield Doubt(
            "implausible_scale",
            f"the radius is {radius_m:.4g} m: see the units of enc_deg (degrees), t_s (seconds) and acc_g (g)",
        )


def gyro_sweep(record: TableRecord) -> Iterator[Doubt]:
    """Doubt about an oscillation at another frequency, or else about an implausible gain of a gyro."""
    blocks = _swinging(record)
    off = [*_off_frequency(blocks), *_frozen(blocks)]
    yield from off or _gain(blocks)


def accelerometer_sweep(record: TableRecord, interval_s: float, arms_m: tuple[float, float] | None) -> Iterator[Doubt]:
    """Doubts about an oscillation at another frequency, samples of another interval, implausible arms."""
    blocks = _swinging(record)
    yield from (*_off_frequency(blocks), *_frozen(blocks))
    steps_s = [float(np.median(np.diff(block.time_s))) for _, block in blocks]
    ratio = float(np.median(steps_s)) / interval_s if steps_s else 1.0
    if not INTERVALS[0] <= ratio <= INTERVALS[1]:
        yield Doubt("implausible_time", f"t_s goes by {ratio:.4g} times Ts_s{slip(ratio)}")
    if arms_m is None or not np.all(np.isfinite(arms_m)):
        return
    longest_m = max(map(abs, arms_m))
    if longest_m > LARGEST_ARM_M:
        yield Doubt("implausible_scale", f"an arm is {longest_m:.4g} m: see the units of dtheta_rad, acc_g and Ts_s")


def _off_frequency(blocks: Sequence[tuple[float, Block]]) -> Iterator[Doubt]:
    """Doubt about a table frequency far from that of all blocks, as by another unit of time."""
    ratio = float(np.median([_frequency_hz(block) / nominal_hz for nominal_hz, block in blocks])) if blocks else 1.0
    if ratio > 0 and not SWINGS_HZ[0] <= ratio <= SWINGS_HZ[1]:
        seen = f"the table swung at {ratio:.4g} times f_Hz{slip(ratio)}"
        yield Doubt("implausible_time", f"{seen}: see the units of t_s (seconds) and f_Hz")


def _frozen(blocks: Sequence[tuple[float, Block]]) -> Iterator[Doubt]:
    """Doubt about an output constant in a whole block."""
    frozen = [f"{nominal_hz:g} Hz" for nominal_hz, block in blocks if not np.ptp(block.output)]
    if frozen:
        yield Doubt("implausible_output", f"the output does not change at {', '.join(frozen[:NAMED])}: it is frozen")


def _swinging(record: TableRecord) -> list[tuple[float, Block]]:
    found = cut_into_blocks(record, Counter()).items()
    return [(float(f_hz), block) for f_hz, block in found if f_hz > 0 and block.complete and len(block.time_s) > 8]


def _frequency_hz(block: Block) -> float:
    """Frequency of the largest line in the spectrum of the table, as for equidistant samples; coarse."""
    spectrum = np.abs(np.fft.rfft(_wave(block, block.table) * np.hanning(len(block.table))))
    return float((int(np.argmax(spectrum[1:])) + 1) / np.ptp(block.time_s))


def _wave(block: Block, values: Array) -> Array:
    """Values without their linear trend."""
    design = np.stack([np.ones_like(values), block.time_s - block.time_s[0]], axis=-1)
    return np.asarray(values - design @ np.linalg.lstsq(design, values, rcond=None)[0])


def _gain(blocks: Sequence[tuple[float, Block]]) -> Iterator[Doubt]:
    """Doubt about an implausible gain of a gyro at the lowest frequency, as of radians, or of exchanged columns."""
    if not blocks:
        return
    nominal_hz, block = blocks[0]
    angle, output = (
        float(np.std(_wave(block, values))) for values in (np.unwrap(block.table, period=360), block.output)
    )
    omega = 2 * np.pi * nominal_hz
    if not angle or not output:
        return
    gain, exchanged = output / (omega * angle), angle / (omega * output)
    if GAINS[0] <= gain <= GAINS[1]:
        return
    if GAINS[0] <= exchanged <= GAINS[1]:
        yield Doubt(
            "columns_exchanged", f"enc_deg and gyro_dps: the gain at {nominal_hz:g} Hz is {gain:.3g}, exchanged 1"
        )
    else:
        yield Doubt(
            "implausible_scale", f"the gain at {nominal_hz:g} Hz is {gain:.4g}{slip(gain)}: see enc_deg, gyro_dps"
        )
