"""Rules on tests on a rate table: data that the requested results need."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from bench.config.models import BenchFile
from bench.methods.rate_table.method import ACCELEROMETERS, GYROS, scales_of
from bench.sequence.checks.acquired import results_by
from bench.sequence.checks.remarks import Found, Rule
from bench.sequence.checks.swings import acquired_inside, place_of
from bench.sequence.document.model import ResultEntry
from bench.sequence.method import known_methods
from bench.sequence.plan.plan import Plan
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.stimulus import Oscillate
from drivers.can.sent_frames import WITH_THE_COUNTS

LEAST_STEPS = 30.0  # minimum pulses or codes of an oscillation: with fewer, quantisation dominates its uncertainty
COUNT_SD = 0.29  # of a pulse: standard deviation of the remainder in a converter
CODE_PART = 0.1  # relative change of a sine of one code by rounding
SWEPT = (0.5, 2.0)  # of the expected bandwidth, stated by the source
RANGE_METHODS, RESPONSE_METHODS = ("gyro_range", "accelerometer_range"), ("gyro_response", "accelerometer_response")
METHODS = (*RANGE_METHODS, *RESPONSE_METHODS)


def no_encoder(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A test on a table whose angle is not latched together with the output."""
    for place, entry in results_by(plan, *METHODS):
        distinct = dict.fromkeys(
            (planned.step.role, motion.role, isinstance(motion, Oscillate))
            for planned, motion in acquired_inside(plan, entry.data)
            if motion is not None and isinstance(planned.step, Acquire)
        )
        found = (
            misfit
            for role, device, swings in distinct
            for misfit in _without_encoder(bench, bench.acquired_from(role), device, swings)
        )
        if (first := next(found, None)) is not None:
            yield (*place, "method"), *first


def _without_encoder(bench: BenchFile, devices: Sequence[str], moved: str, swings: bool) -> Iterator[tuple[str, str]]:
    """Problem and advice for each unit whose output has no encoder of `moved` on a clock as close as its motion needs.

    `devices` record the output; a motion swings or turns at a rate.
    """
    all_encoders = [bench.devices[role].encoders for role in devices]
    latched_with = [encoders[moved].channel for encoders in all_encoders if moved in encoders]
    for name, place in bench.places.items():
        if place.channels is not None and bench.sent_units(place):
            if not bench.sampled_together(place, latched_with):
                yield (
                    f"it needs all channels of the inertial unit in place '{name}' sampled together, and the encoder "
                    f"of '{moved}' latched with the samples of one of them",
                    "Let one device send all of its channels with one period and one clock, and add the encoder to "
                    "options.positions of this device in the bench file, with one of the channels",
                )
        elif place.is_counted:
            if WITH_THE_COUNTS not in latched_with:
                yield (
                    f"it needs the encoder of '{moved}' latched with the pulses, and the counter latches no encoder",
                    "Add the encoder to options.positions of the counter in the bench file, or run it on another bench",
                )
        elif swings and place.voltmeter is not None:
            yield (
                f"a swing needs the encoder of '{moved}' latched with the output; in place "
                f"'{name}' the voltmeter '{place.voltmeter}' shares no clock with it, and integrates for longer than "
                "a swing",
                "Use a bench where a counter or telemetry records the unit together with the encoder",
            )
        elif swings and place.telemetry not in latched_with:
            yield (
                f"a swing needs the encoder of '{moved}' latched with the samples of channel '{place.telemetry}'",
                "Add the encoder to options.positions of the telemetry in the bench file, with that channel, or run it "
                "on another bench",
            )
        elif not latched_with:
            yield (
                f"it needs the encoder of '{moved}', and nothing on the bench latches it",
                "Add the encoder to options.positions of a counter or of the telemetry in the bench file",
            )


def no_scale(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A test on a table without a scale factor that converts the output of a unit to a rate or an acceleration."""
    for place, entry in results_by(plan, *METHODS):
        settings = _settings(entry)
        of_gyros = entry.method.startswith("gyro")
        per, sensors = ("°/s", GYROS) if of_gyros else ("g", ACCELEROMETERS)
        for name, unit in bench.places.items():
            output = bench.gyro_output_unit(name) if of_gyros else bench.output_unit(name)
            exempt = entry.method in RESPONSE_METHODS and unit.voltmeter is not None  # not with a voltmeter
            named = sensors if unit.channels is not None else ("",)
            lacking = next((each for each in named if output not in scales_of(settings["scale"], each)), None)
            if lacking is not None and not exempt:
                yield (
                    (*place, "settings"),
                    f"no scale factor is stated for the output of {lacking} of the unit in place '{name}', which is in "
                    f"{output}"
                    if lacking
                    else (
                        f"no scale factor is stated for the output of the unit in place '{name}', which is in {output}"
                    ),
                    f"Add it to the setting scale, in {output}/({per}); a list has one scale factor for each kind of "
                    "output",
                )


def incomplete_table_test(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A range without a reading at rest, a response without a swing, or an accelerometer's without the slow swing."""
    for place, entry in results_by(plan, *METHODS):
        motions = [motion for _, motion in acquired_inside(plan, entry.data)]
        swings_hz = [motion.highest_hz for motion in motions if isinstance(motion, Oscillate)]
        if entry.method in RANGE_METHODS and None not in motions:
            yield (
                (*place, "data"),
                f"no acquisition of '{entry.data}' is at rest, so that the bias is unknown",
                ("Acquire with that label while the table stands still, before or after the rates"),
            )
        elif entry.method in RESPONSE_METHODS and not swings_hz:
            yield (
                (*place, "data"),
                f"no acquisition of '{entry.data}' is during a swing",
                ("Acquire in 'during' of an oscillate step"),
            )
        elif entry.method == "accelerometer_response":
            lever_hz = _settings(entry)["lever_hz"]
            if not any(math.isclose(hz, lever_hz, rel_tol=1e-6) for hz in swings_hz):
                yield (
                    (*place, "data"),
                    f"no swing is at {lever_hz:g} Hz, from which the lever arms are determined",
                    ("Add that swing, or set lever_frequency to the slowest one"),
                )


def swept_band(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A response whose frequencies do not reach from half of the expected bandwidth to twice that."""
    for place, entry in results_by(plan, *RESPONSE_METHODS):
        settings = _settings(entry)
        expected_hz, lever_hz = settings["expected_hz"], settings.get("lever_hz")
        swings = [motion for _, motion in acquired_inside(plan, entry.data) if isinstance(motion, Oscillate)]
        swept_hz = [
            hz
            for swing in swings
            for hz in ((swing.chirp.from_hz, swing.chirp.to_hz) if swing.chirp else (swing.highest_hz,))
            if hz != lever_hz
        ]
        if expected_hz is None or not swept_hz:
            continue
        low_hz, high_hz = (factor * expected_hz for factor in SWEPT)
        if min(swept_hz) > low_hz or max(swept_hz) < high_hz:
            yield (
                (*place, "settings"),
                f"frequencies from {min(swept_hz):g} to {max(swept_hz):g} Hz are swept, for an expected bandwidth of "
                f"{expected_hz:g} Hz",
                f"Sweep from {low_hz:g} Hz or less to {high_hz:g} Hz or more, or correct expected_bandwidth",
            )


def too_few_pulses(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """An oscillation of only a few pulses or codes, with the resulting uncertainty."""
    for _, entry in results_by(plan, "accelerometer_response"):
        for planned, motion in acquired_inside(plan, entry.data):
            for_s = planned.step.duration_s if isinstance(planned.step, Acquire) else None
            found = _small_swings(bench, motion, for_s or 0.0) if isinstance(motion, Oscillate) else iter(())
            if isinstance(motion, Oscillate) and (small := next(found, None)) is not None:
                yield (*place_of(plan, motion), "amplitude"), *small


def _small_swings(bench: BenchFile, motion: Oscillate, for_s: float) -> Iterator[tuple[str, str]]:
    """Cost and advice for each unit whose output oscillates by little over a time.

    A rate of amplitude A makes A·r·S/g pulses at an arm r, whatever the frequency f, and a sine of A·2πf·r·K/g codes.
    Rounding changes a sine of n codes by about 0.1 n^-3/2 of it, without noise that would hide the steps: 6e-4 of 30. A
    count has an error of 0.29 of a pulse, and another one after each of the 4 n f T pulses within T.
    """
    turn_hz = 2 * math.pi * motion.highest_hz
    rate_dps = motion.amplitude_deg * turn_hz
    for name, place in bench.places.items():
        per_g = bench.nominal_per_g(name)
        if place.arm is None or per_g is None or not place.arm.y or place.voltmeter is not None:
            continue
        counted = place.is_counted and not bench.sent_units(place)
        per_rps = abs(place.arm.y * per_g) / bench.site.gravity.value * (1 if counted else turn_hz)
        size = math.radians(rate_dps) * per_rps
        if size < LEAST_STEPS:
            does = f"give only {size:.3g} pulses per swing" if counted else f"send a sine of {size:.3g} codes"
            pulses = max(4 * size * motion.highest_hz * for_s, 1.0)
            cost = COUNT_SD * math.sqrt(2 / pulses) / size if counted else CODE_PART * size**-1.5
            yield (
                f"the swing by {rate_dps:.3g} °/s at {motion.highest_hz:.6g} Hz makes the unit in place "
                f"'{name}' {does}: steps of the output make its gain uncertain by about {100 * cost:.2g} %, and by "
                "more where they meet few phases of the swing",
                f"Swing by at least {math.degrees(LEAST_STEPS / per_rps):.3g} °/s for {LEAST_STEPS:g}, use a longer "
                "arm, or count for longer; the uncertainties of the results hold it",
            )


def _settings(entry: ResultEntry) -> dict[str, Any]:
    """Settings of a result by the names that its reduction reads."""
    return known_methods()[entry.method].settings.model_validate(entry.settings).model_dump()


RULES = (
    Rule("no-encoder", "error", "a test on a table latches its encoder", no_encoder),
    Rule("no-scale", "error", "a test on a table knows the scale factor of the output", no_scale),
    Rule(
        "incomplete-table-test",
        "error",
        "a test on a table has every acquisition that its method needs",
        incomplete_table_test,
    ),
    Rule("swept-band", "warning", "a response is swept from 0.5 to 2 times the expected bandwidth", swept_band),
    Rule("too-few-pulses", "warning", "an accelerometer resolves the swing", too_few_pulses),
)
