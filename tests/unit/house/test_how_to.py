"""The how-to pages: their YAML fits a shipped bench, and what they point to is there."""

import re
import shutil

import pytest
import yaml

from bench.config.bench import load_bench
from bench.sequence.load import load_judged_plan
from tests.support.how_to import FOLDER, PAGES, bench_pieces, examples
from tests.support.runs import ROOT

LINK = re.compile(r"\]\(([^)#:]*)#?([^)]*)\)")
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
NOT_USED_IN_A_PIECE = {"unused-need"}  # a piece stands in a file that needs more than the piece does


@pytest.mark.parametrize("example", examples(), ids=str)
def test_yaml_in_a_page_fits_a_shipped_bench_without_a_warning(example, tmp_path):
    plan, warnings = load_judged_plan(example.write(tmp_path), load_bench(example.bench).bench)
    allowed = set() if example.is_whole else NOT_USED_IN_A_PIECE
    assert len(plan) > 0
    assert [warning.text for warning in warnings if warning.rule not in allowed] == []


@pytest.mark.parametrize("piece", bench_pieces(), ids=str)
def test_a_piece_of_a_bench_file_fits_the_shipped_bench(piece, tmp_path):
    shutil.copytree(ROOT / "config", tmp_path / "config")
    path = tmp_path / "config/simulated.yaml"
    merged = merge(yaml.safe_load(path.read_text("utf-8")), yaml.safe_load(piece.yaml))
    path.write_text(yaml.safe_dump(merged, allow_unicode=True), "utf-8")
    assert load_bench(path)


def merge(whole, piece):
    """A piece in its place: what both have is that of the piece."""
    if not (isinstance(whole, dict) and isinstance(piece, dict)):
        return piece
    return whole | {key: merge(whole.get(key), value) for key, value in piece.items()}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_of_a_page_lead_to_files_and_their_headings(page):
    links = LINK.findall(page.read_text("utf-8"))
    assert links
    assert [link for link in links if not leads_somewhere(page, *link)] == []


def leads_somewhere(page, path, anchor):
    file = page.parent / path if path else page
    if not file.is_file():
        return False
    headings = HEADING.findall(file.read_text("utf-8")) if anchor else [""]
    return anchor in [re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings]


def test_the_index_lists_every_page():
    linked = {path for path, _ in LINK.findall((FOLDER / "README.md").read_text("utf-8"))}
    assert {page.name for page in PAGES} - {"README.md"} <= linked
