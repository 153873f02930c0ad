"""The how-to pages: their YAML fits a shipped bench, and what they point to is there."""

import re

import pytest

from bench.cli.main import COMMANDS
from bench.config.bench import load_bench
from bench.sequence.load import load_judged_plan
from tests.support.how_to import FOLDER, PAGES, examples

LINK = re.compile(r"\]\(([^)#:]*)#?([^)]*)\)")
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"^`?bench ([a-z][a-z-]*)", re.MULTILINE)
INLINE = re.compile(r"`[^`\n]+`")
COMING = {"rehearse"}  # to be taken out when the command is there
NOT_USED_IN_A_PIECE = {"unused-need"}  # a piece stands in a file that needs more than the piece does


@pytest.mark.parametrize("example", examples(), ids=str)
def test_yaml_in_a_page_fits_a_shipped_bench_without_a_warning(example, tmp_path):
    plan, warnings = load_judged_plan(example.write(tmp_path), load_bench(example.bench).bench)
    allowed = set() if example.is_whole else NOT_USED_IN_A_PIECE
    assert len(plan) > 0
    assert [warning.text for warning in warnings if warning.rule not in allowed] == []


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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_names_commands_that_there_are(page):
    known = {words.partition(" ")[0] for words in COMMANDS}
    text = page.read_text("utf-8")
    typed = [block for language, block in FENCE.findall(text) if not language]
    named = set(COMMAND.findall("\n".join([*typed, *INLINE.findall(FENCE.sub("", text))])))
    assert named - known - COMING == set()


def test_the_index_lists_every_page():
    linked = {path for path, _ in LINK.findall((FOLDER / "README.md").read_text("utf-8"))}
    assert {page.name for page in PAGES} - {"README.md"} <= linked
