"""Kinds of steps. The first key of a step is its verb and names what it acts on.

In a document a value may be an expression `${…}`; a model made for running holds numbers only, in the unit that its
name states.
"""

from __future__ import annotations

from pydantic import BaseModel

from bench.sequence.steps.blocks import Call, ForEach, Group, If, Parallel, Repeat, Retry, While
from bench.sequence.steps.custom import Custom
from bench.sequence.steps.measuring import Acquire, Measure, Tare
from bench.sequence.steps.orienting import Orient
from bench.sequence.steps.stimulus import Move, Oscillate, Ramp, Rotate, SetOutput
from bench.sequence.steps.talk import Alarm, Note, Prompt
from bench.sequence.steps.waits import Soak, Wait, WaitUntil
from drivers.capabilities import MEASURES_OUTPUTS, THERMOMETER

Step = (
    Move | Orient | Rotate | Oscillate | SetOutput | Ramp | Soak | Wait | WaitUntil | Acquire | Measure | Tare | Prompt
    | Note | Alarm | Custom
)  # fmt: skip
STEPS: dict[str, type[Step]] = {
    "move": Move, "orient": Orient, "rotate": Rotate, "oscillate": Oscillate, "set": SetOutput, "ramp": Ramp,
    "soak": Soak, "wait": Wait, "wait_until": WaitUntil, "acquire": Acquire, "measure": Measure, "tare": Tare,
    "prompt": Prompt, "note": Note, "alarm": Alarm, "custom": Custom,
}  # fmt: skip
BLOCKS: dict[str, type[BaseModel]] = {
    **STEPS, "for_each": ForEach, "repeat": Repeat, "group": Group, "if": If, "while": While, "parallel": Parallel,
    "call": Call, "retry": Retry,
}  # fmt: skip

# Capability of its role that a verb needs.
NEEDS: dict[str, tuple[str, ...]] = {
    "move": ("positioner", "rate_table"),
    "rotate": ("rate_table",),
    "oscillate": ("rate_table",),
    "set": ("power_supply", "current_source"),
    "ramp": ("thermal_chamber",),
    "soak": (THERMOMETER,),
    "acquire": MEASURES_OUTPUTS,
}


def verb_of(step: Step) -> str:
    """Verb of a step in a document."""
    return next(verb for verb, model in STEPS.items() if isinstance(step, model))
