"""Libraries that only some formats of output need."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from bench.errors import InputError


def imported(module: str, extra: str, what: str = "") -> ModuleType:
    """Import an optional library; InputError with advice on installation if that fails.

    `what` is what needs it, by default a format.
    """
    what = what or f"--format {extra}"
    library = module.partition(".")[0]
    try:
        return import_module(module)
    except ImportError:
        raise InputError(
            f"{what}: {library} is not installed; install it with: pip install 'inertial-test-bench[{extra}]'"
        ) from None
    except OSError as problem:
        raise InputError(f"{what}: {library} lacks a library of the system ({problem})") from None
