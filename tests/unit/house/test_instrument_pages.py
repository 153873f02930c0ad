"""Pages about instruments: one structure, examples that can be used as they stand, errors that the program has."""

import ast
import re
from functools import lru_cache
from pathlib import Path

import pytest

from bench.config.devices import DeviceEntry
from bench.config.document import parse_document
from bench.config.load import load_file
from drivers.description import known_drivers
from drivers.dialects.framed.profile import FrameProfile
from drivers.dialects.modbus_chamber.profile import ChamberProfile

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "docs/instruments"
PROFILES = {  # each stands for the one that a page names
    ChamberProfile: ROOT / "config/chambers/fictional.yaml", FrameProfile: ROOT / "config/tables/fictional.yaml",
}  # fmt: skip
PAGES = sorted(page for page in FOLDER.glob("*.md") if page.stem in known_drivers())
SECTIONS = ["Wiring and settings", "Bench file", "What the driver does", "Limits", "Errors", "Verification"]
ERRORS = re.compile(r"^## Errors\n(.*?)(?:^## Verification|\Z)", re.MULTILINE | re.DOTALL)
EXAMPLE = re.compile(r"^```yaml\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_every_driver_has_a_page_and_a_line_in_the_index() -> None:
    written = {page.stem for page in FOLDER.glob("*.md")} - {"README"}
    assert written == {*known_drivers()}
    index = (FOLDER / "README.md").read_text("utf-8")
    assert [page.stem for page in PAGES if f"[{page.stem}]({page.name})" not in index] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_example_is_a_device_of_this_driver(page: Path) -> None:
    examples = EXAMPLE.findall(page.read_text("utf-8"))
    assert examples
    context = {"folder": FOLDER, "files_needed": False, "load": lambda _path, model: load_file(PROFILES[model], model)}
    for example in examples:
        for device in parse_document(example, page).value.values():
            assert DeviceEntry.model_validate(device, context=context).driver == page.stem


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_page_has_the_same_sections(page: Path) -> None:
    assert re.findall(r"^## (.*)$", page.read_text("utf-8"), re.MULTILINE) == SECTIONS


@lru_cache(maxsize=1)
def messages() -> str:
    """Text constants of the drivers, one on each line; a value within an f-string is NUL."""
    found = []
    for path in sorted((ROOT / "drivers").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.JoinedStr):
                parts = (part.value if isinstance(part, ast.Constant) else "\0" for part in node.values)
                found.append("".join(map(str, parts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    return "\n".join(found)


@pytest.mark.parametrize("page", [FOLDER / "README.md", *PAGES], ids=lambda page: page.stem)
def test_every_quoted_error_is_one_of_the_drivers(page: Path) -> None:
    (section,) = ERRORS.findall(page.read_text("utf-8"))
    quoted = [each for row in re.findall(r"^\| (.*?) \|", section, re.MULTILINE) for each in re.findall("`(.+?)`", row)]
    parts = [part.strip(" '°,:") for each in quoted for part in re.split(r"…|\d+ ", each)]
    assert parts
    assert [part for part in parts if len(part) > 3 and part not in messages()] == []
