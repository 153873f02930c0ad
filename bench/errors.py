"""Errors of the bench, each with a stable code and a message that a technician can act on."""

from __future__ import annotations

import traceback

from drivers.errors import DriverError


class BenchError(Exception):
    """Error of the bench, not of the unit. `code` is stable; the message states problem, place and remedy."""

    code = "bench"


class InputError(BenchError):
    """File, option or name that cannot be used; nothing has moved. One line for each problem."""

    code = "input"

    def __init__(self, *problems: str) -> None:
        self.problems = tuple(" ".join(problem.splitlines()) for problem in problems)
        super().__init__("\n".join(self.problems))


class StepError(BenchError):
    """Step that failed."""

    code = "step"


class WindowError(BenchError):
    """Reading outside the window of the bench file, or stale."""

    code = "window"


class InUseError(BenchError):
    """Instrument that another program on this computer uses; nothing was sent to it."""

    code = "in-use"


class StoreError(BenchError):
    """Failure of the run store to keep data or to read them."""

    code = "store"


class TimeError(BenchError):
    """Virtual time that cannot advance: deadlock, or one instant without end."""

    code = "time"


# errors after which a sequence may repeat a step
CODES = tuple(error.code for error in (StepError, WindowError))


def error_message(problem: BaseException) -> str:
    """Return the message of an error for a person; for an unexpected one, the traceback as well."""
    if isinstance(problem, BenchError | DriverError):
        return str(problem)
    return "an internal error of this program: " + "".join(traceback.format_exception(problem))
