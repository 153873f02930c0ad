"""Reference pages on problems: rules of the checker, and codes of errors."""

from __future__ import annotations

import inspect
from types import ModuleType

import bench.errors
import drivers.errors
from bench.app.reference.keys import Blocks, table
from bench.errors import BenchError
from bench.sequence.checks.rules import every_rule
from drivers.errors import DriverError


def rules_page() -> Blocks:
    """Rules that `bench check` applies to a whole sequence."""
    rows = (
        (f"`{rule.name}`", rule.severity, f"{rule.title[:1].upper()}{rule.title[1:]}", inspect.getdoc(rule.find) or "")
        for rule in every_rule()
    )
    return [
        "# Rules",
        "When each single step is valid, `bench check` and `bench run` apply these rules to the whole sequence. "
        "A sequence with an error is not run, one with a warning is; `bench check --strict` treats a warning as an "
        "error.",
        table(("rule", "severity", "requirement", "reported"), rows),
    ]


def errors_page() -> Blocks:
    """Stable codes of errors."""
    return [
        "# Errors",
        "Every error has a stable code, for programs and for the `on` of a retry.",
        "## Of the bench",
        _errors(bench.errors, BenchError),
        "## Of a device",
        "The message names the device, what was sent, what was received, and what to do.",
        _errors(drivers.errors, DriverError),
    ]


def _errors(module: ModuleType, base: type[BenchError | DriverError]) -> str:
    found = (kind for kind in vars(module).values() if inspect.isclass(kind) and issubclass(kind, base))
    return table(("code", "what happened"), ((f"`{kind.code}`", inspect.getdoc(kind) or "") for kind in found))
