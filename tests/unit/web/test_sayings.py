"""Sentences of the program on Chinese pages: those that technicians meet are translated, all others are marked."""

import ast
import asyncio
import re
import string
from collections.abc import Iterator

import pytest

from bench.figures.languages import catalogue_of, language
from bench.figures.sayings import PLACE, said, sayings_of
from tests.support.runs import ROOT
from tests.support.station_pages import HTML, asked

SAYINGS = sayings_of("zh")
# Modules whose refusals and reasons a technician meets on a page.
MET = (
    "station/leases.py", "station/jobs.py", "station/signoff/decisions.py", "station/queue/table.py",
    "station/queue/resuming.py", "station/queue/scheduler.py", "station/prepare/releases.py",
    "station/prepare/texts.py", "station/prepare/versions.py", "web/api/sequences.py", "web/pages/editing.py",
    "station/runs/catalogue.py", "station/alerts/table.py", "station/alerts/alerts.py", "web/api/results.py",
    "web/api/runs.py", "web/api/alerts.py", "web/pages/start.py", "web/pages/runs.py", "runner/commands.py",
    "app/preflight.py",
)  # fmt: skip
REASONS = {"InputError", "StaleError", "LeasedError", "InUseError", "Line"}
PARTS = {"queue", "live view", "alerts", "snapshots", "jobs", "alert route {}"}  # "{name}: {problem}" of the daemon


def text_of(node: ast.expr) -> str | None:
    """The text of a literal, with {} for each value in it."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(each.value if isinstance(each, ast.Constant) else "{}" for each in node.values)
    return None


def literals(node: ast.AST) -> Iterator[str]:
    for each in ast.walk(node):
        if isinstance(each, ast.expr) and (text := text_of(each)) is not None:
            yield text


def places_left_out(text: str) -> str:
    return PLACE.sub("{}", text).replace("{{", "{").replace("}}", "}")


KNOWN = {places_left_out(text) for text in SAYINGS}


@pytest.fixture(scope="module")
def program() -> str:
    """All texts of the program, one after the other."""
    files = [path for folder in ("bench", "drivers") for path in (ROOT / folder).rglob("*.py")]
    return "\0".join(text for path in files for text in literals(ast.parse(path.read_text("utf-8"))))


def test_every_sentence_is_one_of_the_program(program):
    lacking = []
    for text in sorted(KNOWN):
        part, colon, rest = text.partition(": ")
        if not (part in PARTS and colon and rest == "{}") and not all(piece in program for piece in text.split("{}")):
            lacking.append(text)
    assert lacking == []
    assert len(KNOWN) > 100


@pytest.mark.parametrize("module", MET)
def test_every_refusal_that_a_technician_meets_has_a_translation(module):
    lacking = []
    for node in ast.walk(ast.parse((ROOT / "bench" / module).read_text("utf-8"))):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in REASONS:
            texts = filter(None, map(text_of, node.args))
            # A text that is nothing but values is put together elsewhere; one word is no sentence.
            wanted = [each for each in texts if " " in each and any(map(str.isalpha, each.replace("{}", "")))]
            lacking += [each for each in wanted if each not in KNOWN and each not in catalogue_of("zh")]
    assert lacking == [each for each in lacking if each in ("left on", "safe end")]


def test_translations_have_the_places_of_their_sentence():
    def names(text):
        # Chinese has no plural: it may leave out the letter s.
        return sorted(name for _, name, _, _ in string.Formatter().parse(text) if name and name != "tail_s")

    assert [text for text, found in SAYINGS.items() if names(text) != names(found)] == []


def chinese(text):
    with language("zh"):
        return str(said(text))


def test_values_stay_and_sentences_within_are_translated():
    assert chinese("there is no run 'abc'") == "没有试验“abc”"
    assert chinese("item 3 is ended") == "项目 3 的状态为：已结束"
    assert chinese("20260101T000000Z_smoke: this run is not running; its state is completed").startswith(
        "20260101T000000Z_smoke：此试验未在运行；状态为："
    )
    assert chinese("nobody would learn how the run ends: the bench is not locked out") == (
        "将无人得知试验如何结束：试验台未被锁定"
    )


def test_what_is_not_known_is_marked_as_english_and_nothing_is_markup():
    assert chinese("own.yaml:3: error: the <b>axis</b> moves") == (
        '<span lang="en">own.yaml:3: error: the &lt;b&gt;axis&lt;/b&gt; moves</span>'
    )
    assert chinese("there is no run '<b>{x}</b>'") == "没有试验“&lt;b&gt;{x}&lt;/b&gt;”"
    assert chinese("bench a: its file cannot be read (No such file)") == (
        '试验台 a：无法读取其文件（<span lang="en">No such file</span>）'
    )
    assert str(said("there is no run '<i>'")) == "there is no run &#39;&lt;i&gt;&#39;"
    assert chinese("QF-1\nthere is no run 'a'") == "QF-1\n没有试验“a”"


def test_answers_of_instruments_stay_and_are_no_english_text():
    refused = (
        """supply: the instrument refused a command; received -222,"Data out of range"; -113,"Undefined header\"."""
    )
    assert "lang=" not in chinese(refused)
    assert "received" not in chinese(refused)
    assert "Data out of range" in chinese(refused)


def test_of_several_readings_the_one_that_leaves_least_in_english_is_taken():
    text = "a.yaml: more than one line was received; sent 'x'; received what nobody knows"
    assert chinese(text) == ('a.yaml：收到多于一行；已发送 &#39;x&#39;；收到 <span lang="en">what nobody knows</span>')


def test_refusals_and_preflight_lines_of_pages_are_chinese(tmp_path):
    async def main():
        async with asked(tmp_path, tmp_path / "runs") as station:
            headers = {**HTML, "accept-language": "zh"}
            refused = await station.client.get("/runs/nothing", headers=headers)
            ready = "/start?sequence=smoke&bench=demo&unit.a=QF-1&units_done=1&parameters_done=1"
            return refused.text, (await station.client.get(ready, headers=headers)).text

    refused, checks = asyncio.run(main())
    assert "没有试验“nothing”" in refused
    assert "所有仪器均为模拟：仅检查了模拟试验的条件" in checks
    assert re.search(r"试验台时间约 \d+ (s|min)", checks)
