"""Rules on channels over temperature: the source, the thermometer and the ramp of a converter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from bench.config.document import Place
from bench.config.models import BenchFile
from bench.methods.channel.planned_levels import planned_levels
from bench.sequence.checks.acquired import acquired_under, ramps_during, results_by
from bench.sequence.checks.remarks import Found, Rule
from bench.sequence.document.model import ResultEntry
from bench.sequence.plan.plan import Plan
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.talk import Prompt

if TYPE_CHECKING:
    from bench.methods.channel.method import ChannelSettings

METHOD = "channel_temperature"
ROUNDING = 1e-9
LEAST_POINTS = 2  # points at rest around a ramp


def no_converter(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A channel over the temperature of its converter, on a bench that does not measure it."""
    for place, _, _ in _channels(plan):
        for name, unit in bench.places.items():
            if unit.converter_temperature is None:
                yield (
                    (*place, "method"),
                    f"the bench file names no thermometer for the converter in place '{name}'",
                    f"Add to the bench file: places.{name}.converter_temperature: READING",
                )


def no_ammeter(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A channel whose current must be measured by an ammeter that the bench lacks or that is not recorded."""
    for place, entry, settings in _channels(plan):
        if settings.current_from != "meter":
            continue
        for name, unit in bench.places.items():
            if unit.ammeter is None:
                yield (
                    (*place, "settings", "current_from"),
                    f"the bench has no ammeter in the cable of the source of place '{name}'",
                    f"Add to the bench file: places.{name}.ammeter: DEVICE, or here current_from: source",
                )
            else:
                yield from _unread(plan, entry.data, unit.ammeter, bench)


def _unread(plan: Plan, label: str, ammeter: str, bench: BenchFile) -> Iterator[Found]:
    for planned in plan:
        step = planned.step
        if isinstance(step, Acquire) and step.label == label and ammeter not in bench.acquired_from(step.role):
            yield (
                (*planned.place, "acquire"),
                f"'{step.role}' alone is recorded here, without '{ammeter}', which must measure the current",
                "Acquire an output role, which includes every instrument that measures it",
            )


def unsuited_ramp(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A ramp of a channel that is too short for a decision, or faster than the method allows."""
    for _, entry, settings in _channels(plan):
        for planned, ramp, from_c in ramps_during(plan, entry.data):
            rate_c_per_h, span_c = 60 * ramp.rate_c_per_min, abs(ramp.temperature_c - from_c)
            if rate_c_per_h > settings.max_ramp_c_per_h * (1 + ROUNDING):
                yield (
                    (*planned.place, "at"),
                    f"{rate_c_per_h:g} °C/h is faster than {settings.max_ramp_c_per_h:g} °C/h, the setting max_ramp",
                    "Ramp more slowly",
                )
            if span_c < settings.min_span_c * (1 - ROUNDING):
                yield (
                    (*planned.place, "to"),
                    f"the ramp spans {span_c:g} °C; below {settings.min_span_c:g} °C, the setting min_span, "
                    "no decision is made",
                    f"Ramp over at least {settings.min_span_c:g} °C",
                )


def no_ramp(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A channel over temperature that is not acquired during a ramp, so that nothing is found."""
    for place, entry, _ in _channels(plan):
        if not list(ramps_during(plan, entry.data)):
            yield (
                (*place, "data"),
                f"no acquisition of '{entry.data}' has a ramp of the chamber in 'during': nothing is found",
                "Acquire with 'during: [ramp: chamber …]'",
            )


def no_points(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A channel without points at rest before and after its ramp, so that its drift is part of the result."""
    for place, entry, _ in _channels(plan):
        during = {planned.id.rpartition("/")[0] for planned, _, _ in ramps_during(plan, entry.data)}
        at_rest = [step_id for step_id in acquired_under(plan, entry.data) if step_id not in during]
        if during and len(at_rest) < LEAST_POINTS:
            yield (
                (*place, "data"),
                f"'{entry.data}' has {len(at_rest)} of {LEAST_POINTS} acquisitions at rest around its ramp: the drift "
                "of the channel is in the result",
                "Acquire at rest before the ramp, and again at the same temperature after it",
            )


def channel_left_out(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A channel of an inertial unit without a set-up at an input level that another of its channels has."""
    if bench.axes:
        return  # attitudes on a table
    for place, entry, _ in _channels(plan):
        for name, unit in bench.places.items():
            levels = planned_levels(plan, bench, unit, entry.data) if unit.channels is not None else {}
            every = set[str]().union(*levels.values())
            lacking = [f"{sensor}/{level}" for sensor, own in levels.items() for level in sorted(every - own)]
            if lacking:
                yield (
                    (*place, "data"),
                    f"the unit in place '{name}' is incomplete: no ramp of {', '.join(lacking)}",
                    "Add a set-up with the axis of the channel up (expect: {mount: …}), or with the source in it "
                    "(expect: {input: source, channel: …})",
                )


def source_without_channel(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A prompt that plugs the source into an inertial unit without naming the channel."""
    fed = [name for name, unit in bench.places.items() if unit.channels is not None and unit.source is not None]
    if not fed or not any(True for _ in _channels(plan)):
        return
    for planned in plan:
        expect = planned.step.expect if isinstance(planned.step, Prompt) else None
        if expect is not None and expect.input == "source" and not expect.fed_channel:
            yield (
                (*planned.place, "expect"),
                f"the unit in place '{fed[0]}' has a converter for each accelerometer; the prompt does not name the "
                "one for the cable of the source",
                "Name it: expect: {input: source, channel: acc_x}",
            )


def _channels(plan: Plan) -> Iterator[tuple[Place, ResultEntry, ChannelSettings]]:
    """Results of this method: place, entry and settings."""
    for place, entry in results_by(plan, METHOD):
        from bench.methods.channel.method import ChannelSettings  # imported only if a sequence uses the method

        yield place, entry, ChannelSettings.model_validate(entry.settings)


RULES = (
    Rule("no-ammeter", "error", "a bench has the ammeter that a method uses", no_ammeter),
    Rule("no-converter", "error", "the temperature of a channel's converter is measured", no_converter),
    Rule("channel-left-out", "warning", "each channel of an inertial unit has every input level", channel_left_out),
    Rule("source-without-channel", "error", "a prompt names the channel that a source feeds", source_without_channel),
    Rule("no-ramp", "error", "a channel over temperature is acquired during a ramp", no_ramp),
    Rule("no-points", "warning", "a channel is acquired at rest before and after its ramp", no_points),
    Rule("unsuited-ramp", "warning", "a ramp for a channel is long enough and slow enough", unsuited_ramp),
)
