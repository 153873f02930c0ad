"""Libraries that only some formats of output need."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from bench.errors import InputError


def imported(module: str, extra: str, packages: str = "", what: str = "") -> ModuleType:
    """Import an optional library; InputError with advice on installation if that fails.

    `packages` are the Debian packages of its system libraries, `what` is what needs it, by default a format.
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
        hint = f"; on Debian: sudo apt install {packages}" if packages else ""
        raise InputError(f"{what}: {library} lacks a library of the system ({problem}){hint}") from None
