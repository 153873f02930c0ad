"""Pages name commands, options and make targets that there are, and the tables of the README are complete."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bench.cli.main import GROUPS
from bench.cli.table import COMMANDS
from drivers.description import known_drivers
from tests.support.runs import ROOT

README = ROOT / "README.md"
PAGES = sorted([
    README, ROOT / "CONTRIBUTING.md", ROOT / "simulators/README.md", ROOT / "docs/glossary.md",
    *(ROOT / "bench").rglob("README.md"),
    *(page for folder in ("how-to", "explanation", "instruments") for page in (ROOT / "docs" / folder).glob("*.md")),
])  # fmt: skip
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"`([^`]+)`")
BENCH = re.compile(r"(?:^|/|[|&] )bench ([a-z][a-z-]*(?:\|[a-z-]+)*(?: [^;&#\n]*)?)")
RULES = re.findall(r"^([a-z][a-z -]*):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
TARGETS = {target for targets in RULES for target in targets.split()}
MAKE = re.compile(r"^(?:\$ )?(?:[A-Z_]+=\S+ )*make ([a-z-]+)")


def typed(page: Path) -> list[str]:
    """What a page gives to be typed: the lines of blocks without a language, and code in sentences."""
    text = page.read_text("utf-8")
    blocks = [block for language, block in FENCE.findall(text) if language in ("", "console")]
    indented = re.findall(r"^    (?! )(.*)$", text, re.MULTILINE)
    inline = [" ".join(code.split()) for code in INLINE.findall(FENCE.sub("", text))]
    return [line for block in blocks for line in block.splitlines()] + indented + inline


def commands(page: Path) -> list[str]:
    """What stands after each `bench` that a page gives to be typed."""
    return [found for line in typed(page) if not line.startswith("- ") for found in BENCH.findall(line)]


def unknown(typed: str) -> list[str]:
    """Words of a command line that are no command, and options that the command has not."""
    first, _, others = typed.partition(" ")
    words = [word.strip("[]") for word in others.split()]
    wrong = []
    for name in first.split("|"):
        longer = f"{name} {words[0]}" if words else name
        if longer in COMMANDS or name in COMMANDS:
            command = COMMANDS.get(longer) or COMMANDS[name]
            known = {argument.name for argument in command.arguments} | {"--help"}
            wrong += [f"{name}: {word}" for word in words if word.startswith("--") and word.split("=")[0] not in known]
        elif name not in GROUPS:
            wrong.append(longer)
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_and_options_of_a_page_exist(page: Path) -> None:
    assert [(command, wrong) for command in commands(page) if (wrong := unknown(command))] == []


def test_many_commands_are_named() -> None:
    assert sum(len(commands(page)) for page in PAGES) > 150
    assert len({command.split()[0] for command in commands(ROOT / "docs/how-to/first_steps.md")}) > 20


@pytest.mark.parametrize("wrong", ["rnu smoke", "run smoke --uot A", "runs verify last --uut A", "pause|resuem last"])
def test_a_wrong_one_is_seen(wrong: str) -> None:
    assert unknown(wrong)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_make_targets_of_a_page_exist(page: Path) -> None:
    assert {target for line in typed(page) for target in MAKE.findall(line)} - TARGETS == set()


def test_the_first_steps_lead_through_every_command() -> None:
    named = {command.split()[0] for command in commands(ROOT / "docs/how-to/first_steps.md")}
    every = {words.split()[0] for words in COMMANDS}
    mentioned = (ROOT / "docs/how-to/first_steps.md").read_text("utf-8")
    assert [word for word in sorted(every - named) if not re.search(rf"\b{word}\b", mentioned)] == []


def test_the_readme_lists_every_sequence_and_every_driver() -> None:
    text = README.read_text("utf-8")
    sequences = [path.stem for path in (ROOT / "sequences").glob("*.yaml")]
    assert sequences
    assert [name for name in sequences if f"`{name}`" not in text] == []
    assert [driver for driver in known_drivers() if f"](docs/instruments/{driver}.md)" not in text] == []


def test_the_benches_of_its_table_are_shipped() -> None:
    rows = re.findall(
        r"^\|.*\|(.*)\|$", README.read_text("utf-8").partition("## Methods")[2].partition("## Inst")[0], re.M
    )
    named = {name for row in rows[2:] for name in INLINE.findall(row)}
    assert len(named) > 15
    assert [name for name in sorted(named) if not (ROOT / "config" / f"{name}.yaml").is_file()] == []
