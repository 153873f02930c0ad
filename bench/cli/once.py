"""Options that take one value are given once: a second one would take the place of the first without a word."""

from __future__ import annotations

from collections import Counter
from typing import Any

import typer
from typer.core import TyperCommand, TyperOption


class OnceEach(TyperCommand):
    """A command that refuses a repeated option, except repeatable ones and flags with the same value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; raise a usage error that names an option given twice."""
        _, _, given = self.make_parser(ctx).parse_args(args=list(args))
        for option, times in Counter(given).items():
            if times > 1 and isinstance(option, TyperOption) and _takes_one(option):
                ctx.fail(f"{_name_of(option)} is given {times} times; only the last would count. Give it once.")
        return super().parse_args(ctx, args)


def _takes_one(option: TyperOption) -> bool:
    says_the_same = option.is_flag and not option.secondary_opts
    return not (option.multiple or option.count or says_the_same)


def _name_of(option: TyperOption) -> str:
    return " or ".join([*option.opts, *option.secondary_opts])


def each_option_once(app: typer.Typer) -> None:
    """Makes all commands of a program, and those of its groups, refuse what is given again."""
    for command in app.registered_commands:
        command.cls = OnceEach
    for group in app.registered_groups:
        if group.typer_instance is not None:
            each_option_once(group.typer_instance)
