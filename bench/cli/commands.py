"""Commands: their names, arguments and functions.

Arguments are parsed by argparse. The parser of a command is created when it is called, so that it need not wait for the
parsers of all others.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, NoReturn

from bench.errors import InputError


class Argument(NamedTuple):
    """Argument, option or flag, and the parameter of the command's function that receives its value."""

    parameter: str
    words: str  # as typed, such as "--bench FILE"
    help: str
    settings: Mapping[str, Any]  # keyword arguments of add_argument
    default: Any = None
    variable: str = ""  # environment variable that supplies a default
    is_required: bool = False
    once: bool = False  # refuse a second value, which would replace the first

    @property
    def name(self) -> str:
        """Option or flag without its value, such as "--bench"; for an argument its name in messages."""
        return self.words.partition(" ")[0]

    @property
    def without(self) -> str:
        """Default as text, or ""."""
        return "" if self.default in (None, False, "", ()) else str(self.default)

    def add_to(self, parser: argparse.ArgumentParser) -> None:
        """Add the argument to a parser."""
        text = (f"{self.help} [default: {self.without}]" if self.without else self.help).replace("%", "%%")
        if self.name.startswith("-"):
            found = {"required": False} if os.environ.get(self.variable) else {}
            parser.add_argument(self.name, dest=self.parameter, help=text, **{**self.settings, **found})
        else:
            parser.add_argument(self.parameter, metavar=self.words, help=text, **self.settings)

    def value(self, found: Any) -> Any:
        """Return the value for the function. Raises InputError if an option is given twice."""
        if found is None or found == []:
            from_outside = os.environ.get(self.variable)
            return ((from_outside,) if self.default == () else from_outside) if from_outside else self.default
        if not self.once:
            return tuple(found) if isinstance(found, list) else found
        if len(found) > 1:
            raise InputError(f"{self.name} is given {len(found)} times; only the last would count. Give it once.")
        return found[0]


def argument(word: str, help_: str, *, to: str = "", read: Callable[[str], Any] = str, **default: Any) -> Argument:
    """Return a positional argument; with a `default` it is optional."""
    settings = {"type": read, **({"nargs": "?"} if default else {})}
    return Argument(to or word.lower(), word, help_, settings, is_required=not default, **default)


def arguments(word: str, help_: str, *, to: str, least: int, read: Callable[[str], Any] = str) -> Argument:
    """Return an argument for all remaining words, at least `least` (0 or 1), as a tuple."""
    settings = {"type": read, "nargs": "+" if least else "*"}
    return Argument(to, word, help_, settings, () if not least else None, is_required=bool(least))


def option(
    words: str,
    help_: str,
    *,
    to: str = "",
    read: Callable[[str], Any] = str,
    choices: Sequence[str] | None = None,
    default: Any = None,
    variable: str = "",
    is_required: bool = False,
) -> Argument:
    """Return an option with a value; `words` are "--name VALUE", `variable` names an environment variable."""
    name, _, metavar = words.partition(" ")
    settings = {"action": "append", "type": read, "metavar": metavar, "choices": choices, "required": is_required}
    return Argument(to or _parameter(name), words, help_, settings, default, variable, is_required, once=True)


def options(words: str, help_: str, *, to: str, read: Callable[[str], Any] = str, variable: str = "") -> Argument:
    """Return a repeatable option, whose values form a tuple; `variable` names an environment variable with one."""
    settings = {"action": "append", "type": read, "metavar": words.partition(" ")[2]}
    return Argument(to, words, help_, settings, (), variable)


def flag(name: str, help_: str, *, to: str = "") -> Argument:
    """Return an option without a value."""
    return Argument(to or _parameter(name), name, help_, {"action": "store_true"}, default=False)


def _parameter(name: str) -> str:
    return name.lstrip("-").replace("-", "_")


def whole_number(least: int, most: int | None = None) -> Callable[[str], int]:
    """Return a converter to whole numbers from `least` to `most`."""

    def read(text: str) -> int:
        number = int(text)
        if number < least or (most is not None and number > most):
            bounds = f"at least {least}" if most is None else f"from {least} to {most}"
            raise argparse.ArgumentTypeError(f"{number} is not {bounds}")
        return number

    read.__name__ = "whole number"  # shown in messages of argparse
    return read


class Command(NamedTuple):
    """Command; its function returns the exit code, or None for 0."""

    words: str
    do: Callable[..., int | None]
    arguments: Sequence[Argument] = ()

    @property
    def help(self) -> str:
        """Help text from the docstring of the function, in paragraphs."""
        paragraphs = (self.do.__doc__ or "").split("\n\n")
        return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs).strip()

    def called(self, given: Sequence[str], below: str = "") -> int:
        """Run the command with these arguments and return the exit code; `below` lists its subcommands in the help.

        Raises InputError, and Helped after --help.
        """
        parser = Parser(self, below)
        values = parser.values(given)
        return self.do(**values) or 0


class Helped(Exception):
    """Raised after --help has written the help."""


class Parser(argparse.ArgumentParser):
    """Parser of one command: options cannot be abbreviated, and errors raise InputError."""

    def __init__(self, command: Command, below: str = "") -> None:
        super().__init__(
            prog=f"bench {command.words}",
            description=command.help,
            formatter_class=argparse.RawDescriptionHelpFormatter if below else argparse.HelpFormatter,
            epilog=below or None,
            allow_abbrev=False,
        )
        self._command = command
        for each in command.arguments:
            each.add_to(self)

    def values(self, given: Sequence[str]) -> dict[str, Any]:
        """Return the values for the parameters of the function. Raises InputError for unknown words."""
        self._expect_known(given)
        of = self._command.arguments
        # parse_args would treat optional arguments as absent when an option precedes them
        may_lack = any(each.settings.get("nargs") in ("?", "*") for each in of)
        found = vars(self.parse_intermixed_args(given) if may_lack else self.parse_args(given))
        try:
            return {each.parameter: each.value(found[each.parameter]) for each in of}
        except InputError as problem:
            self.error(str(problem))

    def _expect_known(self, given: Sequence[str]) -> None:
        """Raise InputError for an unknown option, before argparse reports a missing argument instead."""
        known = ["-h", "--help", *(each.name for each in self._command.arguments)]
        for word in given:
            if word == "--":
                return
            if _is_option(word) and word.partition("=")[0] not in known:
                from drivers.schema.suggest import nearest

                close = nearest(word.partition("=")[0], known)
                self.error(
                    f"there is no option {word}" + (f"; did you mean {close}?" if close else "")
                    + ("" if close else "; a value that begins with - is written as --option=VALUE, or after --")
                )  # fmt: skip

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        """Raise Helped instead of ending the program."""
        raise Helped

    def error(self, message: str) -> NoReturn:
        """Raise InputError with the name of the command."""
        raise InputError(f"{self.prog}: {message}", f"'{self.prog} --help' lists its arguments and options")


def _is_option(word: str) -> bool:
    """Return True for words that argparse treats as options: not negative numbers or words with blanks."""
    if not word.startswith("-") or len(word) == 1 or " " in word:
        return False
    try:
        float(word)
    except ValueError:
        return True
    return False
