"""The examples on the pages about instruments are entries of a bench file that can be used as they stand."""

import re
from pathlib import Path

import pytest

from bench.config.devices import DeviceEntry
from bench.config.document import parse_document
from drivers.description import known_drivers

FOLDER = Path(__file__).parents[2] / "docs/instruments"
PAGES = sorted(page for page in FOLDER.glob("*.md") if page.stem in known_drivers())
EXAMPLE = re.compile(r"^```yaml\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_example_is_a_device_of_this_driver(page: Path) -> None:
    examples = EXAMPLE.findall(page.read_text("utf-8"))
    assert examples
    for example in examples:
        for device in parse_document(example, page).value.values():
            assert DeviceEntry.model_validate(device, context={"folder": FOLDER}).driver == page.stem
