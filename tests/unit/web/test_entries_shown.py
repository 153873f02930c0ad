"""Entries of the journal on the page of a run, and flags of results, in words."""

import ast
from html import unescape

import pytest

from bench.figures.languages import catalogue_of, language
from bench.station.runs.findings import FindingView
from bench.web.news import NEWS
from bench.web.pages.entries_shown import facts_in_words, kind_in_words
from bench.web.pages.results_shown import ShownFinding
from tests.support.runs import ROOT

WRITING = ("journal.write", "journal.try_to_write", "self._record")  # ends of calls that write an entry
WRITERS = ("engine", "runner", "app")
OTHERS = {"run_resumed", "gaps", "doubted", "fault_begins", "fault_ends"}  # kinds that stand in variables


def written() -> tuple[set[str], set[str]]:
    """Kinds of the entries that the program writes, and names of their facts."""
    kinds, facts = set(OTHERS), set()
    for path in (path for folder in WRITERS for path in (ROOT / "bench" / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(WRITING):
                match node.args:
                    case [ast.Constant(kind), *_]:
                        kinds.add(kind)
                        facts.update(keyword.arg for keyword in node.keywords if keyword.arg)
    return kinds, facts


def chinese(text: str) -> str:
    with language("zh"):
        return str(facts_in_words(text))


def test_kinds_of_entries_and_names_of_their_facts_have_a_translation():
    kinds, facts = written()
    assert len(kinds) > 35
    assert len(facts) > 25
    known = catalogue_of("zh")
    with language("zh"):
        assert [kind for kind in sorted(kinds | set(NEWS)) if kind_in_words(kind).isascii()] == []
    assert [name for name in sorted(facts) if f"{name}: " not in known] == []


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("by: interlock warm", "操作者：联锁 warm"),
        ("how: error; seed: 1", "结果：因错误结束；随机种子：1"),
        ("action: stop; by: Anna", "操作：stop；操作者：Anna"),
        (
            'unsafe: {"binder": "binder: the controller has an alarm; received 1"}',
            '未转入安全状态：{"binder": "binder：控制器有报警；收到 1"}',
        ),
        ('lines: [["no answer", "the disk is f', '检查项：[["无应答", "the disk is f'),
        ("problem: <b>", "问题：<b>"),
    ],
)
def test_facts_are_in_words_and_names_and_numbers_stay(text, shown):
    assert unescape(chinese(text)) == shown
    assert "<b>" not in chinese(text)
    assert unescape(str(facts_in_words(text))) == text.replace("error", "ended with an error")


def test_the_release_of_a_hold_is_no_release_of_a_file():
    assert (kind_in_words("released"), kind_in_words("step_failed")) == ("hold released", "step failed")
    with language("zh"):
        assert kind_in_words("released") == "解除保持"


def test_a_flag_of_a_result_is_in_words():
    finding = FindingView(
        id="K0", uut="QF-1", quantity="K0", name="K0", value=1.0, unit="g", u=0.1, expanded=0.2, verdict="INVALID",
        flags=["guard_bands_meet", "contains:K3", "of a plug-in"],
    )  # fmt: skip
    assert ShownFinding(finding).flags.startswith("its uncertainty is so large")
    with language("zh"):
        assert ShownFinding(finding).flags == "不确定度过大，考虑保护带后任何数值都无法判为合格，含 K3，of a plug-in"
