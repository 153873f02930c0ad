"""The YAML in the how-to pages and the README, as files that can be checked and run."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.support.runs import ROOT

FOLDER = ROOT / "docs" / "how-to"
PAGES = sorted(FOLDER.glob("*.md"))
_FENCE = re.compile(r"^```\w+\n.*?^```$", re.DOTALL | re.MULTILINE)
_BLOCK = re.compile(r"^```yaml\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_ANSWERS = "schema: itb-answers/1\n"
STATION, LABORATORY = "schema: itb-station/1\n", "schema: itb-laboratory/1\n"
FOLLOWED = {
    "rehearse_a_bad_night",
    "add_a_driver",
    "add_a_method",
    "add_a_step",
    "continuous_integration",
    "certificates",
}  # whose every command is run by a test of their own
_OF_A_BENCH = ("alert:", "devices:", "places:", "power:", "readings:")
_KEYS = re.compile(r"^(\w+):", re.MULTILINE)
# What a piece of a sequence leaves out: it stands in a file like the first one of its page.
_FRAME = {
    "schema": "schema: itb-sequence/1\n",
    "title": "title: A piece of a page\n",
    "needs": """\
needs:
  chamber: thermal_chamber
  head: positioner
  counter: pulse_counter
  supply: power_supply
  unit_temperature: thermometer
""",
    "steps": """\
steps:
  - set: supply
    voltage: 15 V
    current_limit: 120 mA
    output: on
  - ramp: chamber
    to: 25 °C
    at: 3 °C/min
  - for_each: position
    in: [1°, 91°, 181°, 271°]
    steps:
      - move: head
        to: ${position}
      - acquire: counter
        for: 5 s
        label: tumble
""",
    "teardown": """\
teardown:
  - set: supply
    output: off
  - move: head
    to: 0°
  - ramp: chamber
    to: 25 °C
    at: 3 °C/min
""",
}


@dataclass(frozen=True)
class Example:
    """A block of YAML in line `line` of a page: a whole sequence, or a piece of one."""

    page: Path
    line: int
    yaml: str

    def __str__(self) -> str:
        return f"{self.page.stem}:{self.line}"

    @property
    def is_whole(self) -> bool:
        return self.yaml.startswith("schema: ")

    @property
    def bench(self) -> Path:
        """The shipped bench that has what it needs."""
        return ROOT / "config" / ("rate_table.yaml" if "rate_table" in self.yaml else "simulated.yaml")

    @property
    def has_questions(self) -> bool:
        return "- prompt:" in self.yaml

    def write_answers(self, folder: Path) -> Path:
        """The answers that its page gives to its questions, in a file."""
        (answers,) = (yaml for _, yaml in blocks(self.page) if yaml.startswith(_ANSWERS))
        path = folder / "answers.yaml"
        path.write_text(answers, "utf-8")
        return path

    def write(self, folder: Path) -> Path:
        """The sequence in a file, beside every whole sequence of its page, under a name made of its title."""
        for other in examples():
            if other.page == self.page and other.is_whole:
                (folder / f"{_name(other.yaml)}.yaml").write_text(other.yaml, "utf-8")
        text = self.yaml if self.is_whole else _framed(self.yaml)
        path = folder / f"{_name(text)}.yaml"
        path.write_text(text, "utf-8")
        return path


def examples() -> list[Example]:
    """Every sequence in the pages, and every piece of one."""
    return [
        Example(page, line, yaml)
        for page in (ROOT / "README.md", *PAGES) if page.stem not in FOLLOWED for line, yaml in blocks(page)
        if not yaml.startswith((_ANSWERS, STATION, LABORATORY, *_OF_A_BENCH))
    ]  # fmt: skip


def bench_pieces() -> list[Example]:
    """Every piece of a bench file in the pages, but those with a certificate file, which have tests of their own."""
    return [
        Example(page, line, yaml)
        for page in PAGES
        for line, yaml in blocks(page)
        if yaml.startswith(_OF_A_BENCH) and "dcc: " not in yaml
    ]


def commands(page: Path) -> list[list[str]]:
    """The commands of a page, which stand indented by four spaces in paragraphs of their own, in order."""
    text = _FENCE.sub("", page.read_text("utf-8"))
    return [shlex.split(line) for line in re.findall(r"^    (\S.*)$", text, re.MULTILINE)]


def follow(words: Sequence[str], folder: Path, site: Path, env: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
    """Run a command of a page in `folder`, with the programs of this environment.

    What it installs is built as a wheel, and installed into the folder `site`, from no network.
    """
    program, *rest = words
    if "pip" in rest:
        built = folder / "dist" / rest[-1]
        _done([sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", built, folder / rest[-1]], env)
        (wheel,) = built.glob("*.whl")
        rest = ["-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", str(site), str(wheel)]
    known = {"bench": [sys.executable, "-m", "bench"], "python": [sys.executable]}
    return subprocess.run(
        [*known.get(program, [program]), *rest], cwd=folder, env=env, capture_output=True, text=True, check=False
    )


def _done(command: Sequence[object], env: Mapping[str, str]) -> None:
    done = subprocess.run(list(map(str, command)), env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def files_of(page: Path) -> dict[str, str]:
    """The files that a page gives whole, by the first name in the paragraph before each block."""
    named = re.compile(r"^`([\w/.]+)`[^\n]*(?:\n[^\n]+)*\n\n```\w+\n(.*?)^```$", re.DOTALL | re.MULTILINE)
    return dict(named.findall(page.read_text("utf-8")))


def blocks(page: Path) -> list[tuple[int, str]]:
    """Every block of YAML in a page, and the line that it begins in."""
    text = page.read_text("utf-8")
    return [(text.count("\n", 0, block.start(1)) + 1, block.group(1)) for block in _BLOCK.finditer(text)]


def _framed(piece: str) -> str:
    if piece.startswith("- "):
        piece = "steps:\n" + "".join(f"  {line}" for line in piece.splitlines(keepends=True))
    given = set(_KEYS.findall(piece))
    return piece + "".join(text for key, text in _FRAME.items() if key not in given)


def _name(yaml: str) -> str:
    title = re.search(r"^title: (.*)$", yaml, re.MULTILINE)
    assert title is not None, yaml
    return re.sub(r"[^a-z0-9]+", "_", title.group(1).lower())
