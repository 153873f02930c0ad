"""Steps of plug-ins: `custom: NAME` with the settings of the plug-in.

The entry-point group `inertial_test_bench.steps` provides their descriptions; the code of a step is imported when it
runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, BaseModel, Field

from bench.sequence.language.expressions import Value
from bench.sequence.language.values import bare
from bench.sequence.steps.fields import Resumed, StepBase
from drivers.installed import Installed
from drivers.schema.fields import Name

ENTRY_POINTS = "inertial_test_bench.steps"
SHIPPED: Mapping[str, str] = {
    "compare_ends": "bench.methods.indexing.method:COMPARE_ENDS",
    "manual_control": "bench.sequence.steps.manual:MANUAL_CONTROL",
}


def _no_time(_: Any) -> float:
    return 0.0


class StepDescription(NamedTuple):
    """Description of a plug-in's step for sequences.

    `settings` validates the block `with`. `target` is "module:function", an `async def function(settings, bench:
    bench.engine.context.Bench) -> Mapping[str, Any]` whose result goes into the journal; `bench.role` is the role that
    the step names. "value" in the result, with "unit" of a number, is the value that `as` names in later expressions.
    `capability` is that of the step's role, "" if it needs no device. `takes_s` computes its duration from the
    settings. `example` is an example of its value, for checking expressions; None if it has none. If a run was
    interrupted in the step, the resumed run repeats it only if it is `repeatable`.
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
    """Run a step of a plug-in, with its settings; `role` is the device that it acts on, if any.

    `as` is the name of its value in later expressions.
    """

    name: Name = Field(alias="custom")
    value_name: Name | None = Field(None, alias="as", description="the name of the value in later expressions")
    role: Name | None = Field(None, description="the device that it acts on")
    settings: Annotated[Mapping[str, Any], AfterValidator(bare)] = Field(
        default_factory=dict, alias="with", description="the settings of the plug-in's step"
    )

    @property
    def resumed(self) -> Resumed:  # type: ignore[override]  # of a plug-in, which its description declares
        """Treatment of the step by a resumed run."""
        return "again" if known_steps()[self.name].repeatable else "never"


@lru_cache(maxsize=1)
def known_steps() -> Mapping[str, StepDescription]:
    """Every installed plug-in's step by name."""
    return Installed(ENTRY_POINTS, SHIPPED)
