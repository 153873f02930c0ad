"""The examples on the pages about instruments are entries of a bench file that can be used as they stand."""

import re
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
