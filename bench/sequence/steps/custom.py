"""Steps that plug-ins bring: `custom: NAME` with settings of the plug-in's own.

The entry-point group `inertial_test_bench.steps` finds their descriptions; what does the step is imported when it runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

from pydantic import BaseModel, Field

from bench.sequence.language.expressions import Value
from bench.sequence.steps.fields import Resumed, StepBase
from drivers.installed import Installed
from drivers.schema.fields import Name

ENTRY_POINTS = "inertial_test_bench.steps"
SHIPPED: Mapping[str, str] = {"compare_ends": "bench.methods.indexing.method:COMPARE_ENDS"}


def _no_time(_: Any) -> float:
    return 0.0


class StepDescription(NamedTuple):
    """A plug-in's step as a sequence sees it.

    `settings` validates the block `with`. `target` is "module:function", an
    `async def function(settings, bench: bench.engine.context.Bench) -> Mapping[str, Any]` whose result goes into the
    journal; `bench.role` is the role that the step names. "value" in the result, with "unit" of a number, is what `as`
    names in later expressions. `capability` is what the step's role must be, "" when it needs no device. `takes_s` is
    how long it takes, from the settings. `example` is a value such as it gives, for checking expressions; None when it
    gives none. Only a `repeatable` step is done again when a run is resumed that was interrupted in it.
    """

    name: str
    title: str
    target: str
    settings: type[BaseModel]
    capability: str = ""
    takes_s: Callable[[Any], float] = _no_time
    example: Value | None = None
    repeatable: bool = False


class Custom(StepBase):
    """A step of a plug-in, with the settings that it takes; `role` is the device that it acts on, if it does.

    `as` is the name that expressions in later steps know by what it found.
    """

    name: Name = Field(alias="custom")
    value_name: Name | None = Field(None, alias="as", description="the name of the value in later expressions")
    role: Name | None = Field(None, description="the device that it acts on")
    settings: Mapping[str, Any] = Field(
        default_factory=dict, alias="with", description="the settings of the plug-in's step"
    )

    @property
    def resumed(self) -> Resumed:  # type: ignore[override]  # of a plug-in, which its description declares
        """What a resumed run does with it."""
        return "again" if known_steps()[self.name].repeatable else "never"


@lru_cache(maxsize=1)
def known_steps() -> Mapping[str, StepDescription]:
    """Every installed plug-in's step by name."""
    return Installed(ENTRY_POINTS, SHIPPED)
