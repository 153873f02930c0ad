"""Rules on tests on a rate table: whether what is done there can give what is asked for (methods.md 5)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

from bench.config.models import BenchFile
from bench.sequence.measuring import Acquire
from bench.sequence.methods import known_methods
from bench.sequence.model import ResultEntry
from bench.sequence.plan import Plan, PlannedStep
from bench.sequence.remarks import Found
from bench.sequence.stimulus import Oscillate, Rotate
from drivers.can_counter.description import CounterOptions

LEAST_PULSES = 30.0  # of a swing: with fewer the steps of counting are a large part of it
FEW_PHASES = 100  # of a swing that the samples come back to; their number divides the errors of the encoder
RANGE_METHODS, RESPONSE_METHODS = ("gyro_range", "accelerometer_range"), ("gyro_response", "accelerometer_response")
Inside = tuple[PlannedStep, Oscillate | Rotate | None]  # an acquisition, and what turns the table meanwhile


def no_encoder(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A test on a table whose counter does not latch the table's encoder."""
    for index, entry in _on_a_table(plan):
        for planned, motion in _acquired(plan, entry.data):
            counter: Any = bench.devices[planned.step.role] if isinstance(planned.step, Acquire) else None
            options = counter.options if counter is not None else None
            if motion is None or not isinstance(options, CounterOptions) or motion.role in options.positions:
                continue
            yield (
                ("results", index, "method"),
                f"it needs the encoder of '{motion.role}' on the clock of the pulses, and the counter latches none",
                "Add the encoder to options.positions of the counter in the bench file, or run it on another bench",
            )
            break


def incomplete_table_test(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A range without a reading at rest, a response without a swing, or an accelerometer's without the slow one."""
    for index, entry in _on_a_table(plan):
        motions = [motion for _, motion in _acquired(plan, entry.data)]
        swings_hz = [motion.highest_hz for motion in motions if isinstance(motion, Oscillate)]
        place = ("results", index, "data")
        if entry.method in RANGE_METHODS and None not in motions:
            yield (
                place,
                f"nothing under '{entry.data}' is acquired at rest: the bias is unknown",
                ("Acquire under that label while the table stands, before or after the rates"),
            )
        elif entry.method in RESPONSE_METHODS and not swings_hz:
            yield (
                place,
                f"nothing under '{entry.data}' is acquired while the table swings",
                ("Acquire in the 'during' of an oscillate"),
            )
        elif entry.method == "accelerometer_response":
            lever_hz = known_methods()[entry.method].settings.model_validate(entry.settings).model_dump()["lever_hz"]
            if not any(math.isclose(hz, lever_hz, rel_tol=1e-6) for hz in swings_hz):
                yield (
                    place,
                    f"no swing is at {lever_hz:g} Hz, at which the arms are found",
                    ("Add that swing, or set lever_frequency to the slowest one"),
                )


def too_few_pulses(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A swing on which an accelerometer pulses hardly to and fro; rate amplitude A makes A·r·S/g pulses at an arm r."""
    for _, entry in _on_a_table(plan):
        if entry.method != "accelerometer_response":
            continue
        for _, motion in _acquired(plan, entry.data):
            if not isinstance(motion, Oscillate):
                continue
            for name, place in bench.places.items():
                if place.arm is None or place.nominal is None or place.nominal.S is None or not place.arm.y:
                    continue
                rate_dps = motion.amplitude_deg * 2 * math.pi * motion.highest_hz
                per_rps = abs(place.arm.y) * place.nominal.amperes_per_g * place.nominal.S / bench.site.gravity.value
                pulses = math.radians(rate_dps) * per_rps
                if pulses < LEAST_PULSES:
                    yield (
                        (*_place_of(plan, motion), "amplitude"),
                        f"the swing by {rate_dps:.3g} °/s at {motion.highest_hz:.6g} Hz makes the unit in place "
                        f"'{name}' pulse {pulses:.3g} times to and fro, which is fewer than {LEAST_PULSES:g}",
                        f"Swing by at least {math.degrees(LEAST_PULSES / per_rps):.3g} °/s, or use a longer arm",
                    )
                    break


def commensurate_swing(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A swing of which the samples see a few phases only, again and again: the encoder's steps do not average out."""
    for planned, motion in _acquired(plan, None):
        step = planned.step
        if not isinstance(step, Acquire) or not isinstance(motion, Oscillate) or step.duration_s is None:
            continue
        options = bench.devices[step.role].options
        if not isinstance(options, CounterOptions) or motion.role not in options.positions:
            continue
        turns = motion.highest_hz * options.period  # of the swing, from sample to sample
        near = Fraction(turns).limit_denominator(FEW_PHASES)
        drift = abs(turns - near) * step.duration_s / options.period
        if drift * near.denominator < 1:
            yield (
                (*_place_of(plan, motion), "frequency"),
                f"{motion.highest_hz:.6g} Hz and a sample every {options.period * 1e3:g} ms meet at "
                f"{near.denominator} phases of the swing only, where the encoder has the same errors every time",
                "Swing 0.1 to 0.3 Hz beside it",
            )


def _on_a_table(plan: Plan) -> Iterator[tuple[int, ResultEntry]]:
    for index, entry in enumerate(plan.sequence.results):
        if entry.method in (*RANGE_METHODS, *RESPONSE_METHODS):
            yield index, entry


def _acquired(plan: Plan, label: str | None) -> Iterator[Inside]:
    """The acquisitions under a label, or all, each with what turns the table while it is done."""
    turning = {planned.id: planned.step for planned in plan if isinstance(planned.step, (Oscillate, Rotate))}
    for planned in plan:
        if isinstance(planned.step, Acquire) and label in (None, planned.step.label):
            outer = (motion for step_id, motion in turning.items() if planned.id.startswith(f"{step_id}/"))
            yield planned, next(outer, None)


def _place_of(plan: Plan, motion: Oscillate) -> tuple[str | int, ...]:
    return next(planned.place for planned in plan if planned.step is motion)
