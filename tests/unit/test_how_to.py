"""The how-to pages: their YAML fits a shipped bench, and what they point to is there."""

import re

import pytest
import typer

from bench.cli.main import app
from bench.config.bench import load_bench
from bench.sequence.load import load_judged_plan
from tests.support.how_to import FOLDER, PAGES, examples

LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")
CODE = re.compile(r"^```$.*?^```$|`[^`\n]+`", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"^`?bench ([a-z]+)", re.MULTILINE)
NOT_USED_IN_A_PIECE = {"unused-need"}  # a piece stands in a file that needs more than the piece does


@pytest.mark.parametrize("example", examples(), ids=str)
def test_yaml_in_a_page_fits_a_shipped_bench_without_a_warning(example, tmp_path):
    plan, warnings = load_judged_plan(example.write(tmp_path), load_bench(example.bench).bench)
    allowed = set() if example.is_whole else NOT_USED_IN_A_PIECE
    assert len(plan) > 0
    assert [warning.text for warning in warnings if warning.rule not in allowed] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_of_a_page_lead_to_files(page):
    links = LINK.findall(page.read_text("utf-8"))
    assert links
    assert [link for link in links if not (page.parent / link).is_file()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_names_commands_that_there_are(page):
    known = set(typer.main.get_command(app).commands)
    code = "\n".join(CODE.findall(page.read_text("utf-8")))
    assert set(COMMAND.findall(code)) <= known


def test_the_index_lists_every_page():
    linked = set(LINK.findall((FOLDER / "README.md").read_text("utf-8")))
    assert {page.name for page in PAGES} - {"README.md"} <= linked
