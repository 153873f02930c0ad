"""Rule on oscillations sampled at few phases, and the acquisitions that a plan makes during a motion."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from functools import cache

from bench.config.models import BenchFile
from bench.sequence.checks.remarks import Found
from bench.sequence.plan.plan import Plan, PlannedStep
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.stimulus import Oscillate, Rotate

FEW_PHASES = 100  # maximum number of repeated phases; encoder errors are reduced by their number only
Inside = tuple[PlannedStep, Oscillate | Rotate | None]  # an acquisition and the motion of the table during it


def commensurate_swing(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """An oscillation sampled at only a few phases, so that the quantisation of the encoder does not average out."""

    @cache
    def periods_s(role: str, device: str) -> tuple[float, ...]:
        return tuple(_periods_s(bench, role, device))

    for planned, motion in acquired_inside(plan, None):
        step = planned.step
        if not isinstance(step, Acquire) or not isinstance(motion, Oscillate) or step.duration_s is None:
            continue
        if motion.chirp is not None:
            continue
        for period_s in periods_s(step.role, motion.role):
            turns = motion.highest_hz * period_s  # periods of the oscillation from sample to sample
            near = Fraction(turns).limit_denominator(FEW_PHASES)
            drift = abs(turns - near) * step.duration_s / period_s
            if drift * near.denominator < 1:
                yield (
                    (*place_of(plan, motion), "frequency"),
                    f"{motion.highest_hz:.6g} Hz and a sample every {period_s * 1e3:g} ms meet "
                    f"at only {near.denominator} phases of the swing, at which the encoder has always the same errors",
                    "Change the frequency by 0.1 to 0.3 Hz",
                )


def _periods_s(bench: BenchFile, role: str, device: str) -> Iterator[float]:
    """Periods (s) of the devices that latch the encoder of a device in an acquisition."""
    for each in bench.acquired_from(role):
        encoders = bench.devices[each].encoders
        if device in encoders:
            yield encoders[device].period_s


def acquired_inside(plan: Plan, label: str | None) -> Iterator[Inside]:
    """Acquisitions under a label, or all, each with the motion of the table during it, of several the outermost."""
    motion: Oscillate | Rotate | None = None
    inside = ""  # beginning of the ids of all steps during the motion, which follow it
    for planned in plan:
        if motion is not None and not planned.id.startswith(inside):
            motion = None
        if isinstance(planned.step, Acquire):
            if label in (None, planned.step.label):
                yield planned, motion
        elif motion is None and isinstance(planned.step, (Oscillate, Rotate)):
            motion, inside = planned.step, f"{planned.id}/"


def place_of(plan: Plan, motion: Oscillate) -> tuple[str | int, ...]:
    """Place of an oscillation in the document."""
    return next(planned.place for planned in plan if planned.step is motion)
