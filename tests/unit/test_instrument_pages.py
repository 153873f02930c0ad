"""The examples on the pages about instruments are entries of a bench file that can be used as they stand."""

import re
from pathlib import Path

import pytest

from bench.config.devices import DeviceEntry
from bench.config.document import parse_document
from bench.config.load import load_file
from drivers.description import known_drivers

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs/instruments"
PROFILE = ROOT / "config/chambers/fictional.yaml"  # stands for the one that a page names
PAGES = sorted(page for page in FOLDER.glob("*.md") if page.stem in known_drivers())
EXAMPLE = re.compile(r"^```yaml\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_example_is_a_device_of_this_driver(page: Path) -> None:
    examples = EXAMPLE.findall(page.read_text("utf-8"))
    assert examples
    context = {"folder": FOLDER, "files_needed": False, "load": lambda _path, model: load_file(PROFILE, model)}
    for example in examples:
        for device in parse_document(example, page).value.values():
            assert DeviceEntry.model_validate(device, context=context).driver == page.stem
