"""The pages on problems: the rules of the checker, and the kinds of errors."""

from __future__ import annotations

import inspect
from types import ModuleType

import bench.errors
import drivers.errors
from bench.app.reference.keys import Blocks, table
from bench.errors import BenchError
from bench.sequence.rules import RULES
from drivers.errors import DriverError


def rules_page() -> Blocks:
    """What `bench check` looks for in a sequence as a whole."""
    rows = (
        (f"`{rule.name}`", rule.severity, f"{rule.title[:1].upper()}{rule.title[1:]}", inspect.getdoc(rule.find) or "")
        for rule in RULES
    )
    return [
        "# Rules",
        "Once each step is right by itself, `bench check` and `bench run` hold the sequence as a whole against these. "
        "A sequence with an error is not run, one with a warning is; `bench check --strict` takes it for an error.",
        table(("rule", "severity", "what should hold", "what is told"), rows),
    ]


def errors_page() -> Blocks:
    """The stable codes of errors."""
    return [
        "# Errors",
        "Every error has a code that stays the same, for programs and for the `on` of a retry.",
        "## Of the bench",
        _errors(bench.errors, BenchError),
        "## Of a device",
        "The message names the device, what was sent, what came back, and what to do.",
        _errors(drivers.errors, DriverError),
    ]


def _errors(module: ModuleType, base: type[BenchError | DriverError]) -> str:
    found = (kind for kind in vars(module).values() if inspect.isclass(kind) and issubclass(kind, base))
    return table(("code", "what happened"), ((f"`{kind.code}`", inspect.getdoc(kind) or "") for kind in found))
