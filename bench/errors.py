"""What can go wrong, each with a stable code and one line that a technician can act on."""

from __future__ import annotations

import traceback

from drivers.errors import DriverError


class BenchError(Exception):
    """The bench is bad, not the unit. `code` is stable; the message says what, where, and what to do."""

    code = "bench"


class InputError(BenchError):
    """A file, an option or a name that cannot be used; nothing has moved. One line for each problem."""

    code = "input"

    def __init__(self, *problems: str) -> None:
        self.problems = tuple(" ".join(problem.splitlines()) for problem in problems)
        super().__init__("\n".join(self.problems))


class StepError(BenchError):
    """A step could not do what it says."""

    code = "step"


class WindowError(BenchError):
    """A reading left the window that the bench file allows it, or is too old to be believed."""

    code = "window"


class InUseError(BenchError):
    """Another program on this computer talks to an instrument; nothing was sent to it."""

    code = "in-use"


class StoreError(BenchError):
    """The run store cannot keep what it was given, or cannot be read."""

    code = "store"


class TimeError(BenchError):
    """Virtual time cannot go on: nothing is left to wait for, or one instant never ends."""

    code = "time"


# Of what may be tried again in a sequence: a step that did not get there, a reading out of its window.
CODES = tuple(error.code for error in (StepError, WindowError))


def in_words(problem: BaseException) -> str:
    """What a person is told of an error: its text, and of one that nobody foresaw where in the program it happened."""
    if isinstance(problem, BenchError | DriverError):
        return str(problem)
    return "an internal error of this program: " + "".join(traceback.format_exception(problem))
