"""Messages of runs and of checks on Chinese pages: all that people see are translated whole."""

import ast
import asyncio
import re
from collections.abc import Iterator
from functools import lru_cache
from html import unescape
from pathlib import Path

import pytest

from bench.app.resume import prepare_again, read_interrupted, summary_lines
from bench.config.bench import load_bench
from bench.errors import InputError
from bench.figures.languages import catalogue_of, language
from bench.figures.sayings import said
from bench.station.runs.course import USUAL
from bench.store.reader import RunReader
from bench.web.news import news
from tests.support.killed import interrupted
from tests.support.runs import ROOT, copy_bench, run_short
from tests.support.sequences import TAIL, steps
from tests.support.station_pages import HTML, asked
from tests.unit.web.test_sayings import text_of

# Folders and modules all of whose messages are seen on pages.
SEEN = (
    "drivers", "bench/engine", "bench/runner", "bench/guardian", "bench/sequence", "bench/config", "bench/store",
    "bench/certificates", "bench/report/dcc",
    "bench/reduce", "bench/rig.py", "bench/files.py", "bench/errors.py", "bench/quality.py", "bench/app/resume.py",
    "bench/app/credited.py", "bench/app/clock_record.py", "bench/methods/*/rules.py", "bench/methods/*/doubts.py",
    "bench/metrology/plausibility.py", "bench/methods/*/reduction/plausibility.py", "bench/offline/doubts.py",
    "bench/app/beginning.py", "bench/app/can_nodes.py", "bench/app/drawn.py", "bench/app/laboratory.py",
    "bench/app/pending.py", "bench/app/scenario.py", "bench/station/queue", "bench/station/signoff",
    "bench/station/worker.py", "bench/station/alerts/route.py", "bench/web/guards.py", "bench/web/identity.py",
    "bench/web/limits.py", "bench/web/patience.py",
)  # fmt: skip
SQL = re.compile(r"\s*(?:BEGIN|CREATE|DELETE|INSERT|PRAGMA|REPLACE|SELECT|UPDATE|WHERE)\b|run = \?|default-src ")
DESCRIBING = {"Field", "Rule"}  # calls with texts of the reference
# Texts that stay in terminals and logs, and those that are no sentences.
ELSEWHERE = {
    "Held before step Q by the Q.", "HELD by the Q", "No longer needed: Q", "opening the bench", "bench check",
    "stop after step", "switch off Q", "take in Q", "stop --after-step", "no complete line within Q s", "look at it",
    "\x07QQ\nAnswer with 'bench answer RUN ANSWER': Q", "commits of the record", ", or an expression ${…}",
    "Aborting: no teardown; all devices are made safe (Q).", "A step or a loop; its first key is its verb.",
    "Stopping: teardown runs now and takes about Q min. Ctrl-C again skips it and makes the devices safe at once.",
    "Ending Q, which has instruments of this bench.", "Q did not release them within Q s and is killed.",
    "Q hands the bench over.", "Manual control: the run obeys orders of an engineer until the session is ended",
    "<stream end>", "cannot start any token", "could not find expected ':'", "expected <block end>",
    "expected alphabetic or numeric character", "expected the node content", "found unexpected end of stream",
    "mapping values are not allowed", "sequence entries are not allowed", "unexpected end of stream",
    "self::si:real | self::dcc:quantity/si:real", "self::si:realListXMLList | self::dcc:quantity/si:realListXMLList",
    "si:hybrid/si:real | si:hybrid/si:realListXMLList", "si:unit | si:unitXMLList",
    "Q, without uncertainty", "as expected", "whose certificate was not compared with any",
    "signed by Q (SHA-256 Q), Q; unchanged since", "g: local gravity at the place of the calibration",
    "t, Q degrees of freedom",
    "Approval of the report Q", "dbc sha256:Q", "a stream needs an asyncio.Protocol", "# bench trace 1",
    "import json, os, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from bench.guardian.main import main; os._exit(main(*sys.argv[2:]))",
}  # fmt: skip
# Parts of sentences that are translated as a whole.
PARTS = {
    " in mount 'Q'", " of user Q", ". It is made safe before the first step.", "Measure at Q temperatures, or ",
    "Q Q, its cable, and the instrument that reads it.", "Q is not stable after Q h: ", "Q was found energised: Q; ",
    "The output of the unit in place Q still changed by Q Q Q", "the plan has more than Q Q",
    ": see the signs of the output, and whether rows are displaced", "the connection to Q Q",
    "the question was withdrawn: Q The angle of the head is not confirmed.",
}  # fmt: skip
ENGLISH = 'lang="en"'


def chinese(text: str) -> str:
    with language("zh"):
        return str(said(text))


def messages(node: ast.AST) -> Iterator[str]:
    """Texts of a module with Q for each value, except docstrings and those of the reference."""
    for each in ast.iter_child_nodes(node):
        if isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant):
            continue
        if isinstance(each, ast.Call) and getattr(each.func, "id", "") in DESCRIBING:
            continue
        if isinstance(each, ast.expr) and (text := text_of(each)) is not None:
            yield text.replace("{}", "Q") if isinstance(each, ast.JoinedStr) else text
        else:
            yield from messages(each)


@lru_cache
def messages_of(path: Path) -> frozenset[str]:
    return frozenset(messages(ast.parse(path.read_text("utf-8"))))


def is_translated(text: str) -> bool:
    """Return True for a message that leaves no English, by itself or without the values at its ends."""
    inner = re.sub(r"^(?:Q[ :]*)+|[ :]*Q$", "", text).strip(" :,")
    return any(ENGLISH not in chinese(each) for each in (text, text.strip(), inner))


@pytest.mark.parametrize("where", SEEN)
def test_every_message_has_a_translation(where):
    paths = sorted(ROOT.glob(where) if "." in where else (ROOT / where).rglob("*.py"))
    assert paths
    found = {text for path in paths for text in messages_of(path) if not SQL.match(text)}
    assert sorted(text for text in found - ELSEWHERE - PARTS if not is_translated(text)) == []


def test_texts_that_stay_english_are_those_of_the_program():
    paths = [path for folder in ("bench", "drivers") for path in (ROOT / folder).rglob("*.py")]
    texts = set().union(*map(messages_of, paths))
    assert sorted((ELSEWHERE | PARTS) - texts) == []


def test_what_a_check_says_of_broken_sequences_is_chinese():
    files = sorted((ROOT / "tests/broken").rglob("*.yaml"))
    lines = [line[2:] for path in files for line in path.read_text("utf-8").splitlines() if line.startswith("# ")]
    said_of = [line for line in lines if re.match(r"(?:[\w.]+:)?\d+:\d+: ", line)]
    assert len(said_of) > 350
    assert [line for line in said_of if ENGLISH in chinese(line)] == []


def test_a_warning_keeps_its_file_its_rule_and_what_is_to_be_written():
    text = "a.yaml:4:5: warning: no step uses the parameter 'rate'. Remove it, or write ${rate} where it belongs"
    assert chinese(f"{text} [unused-parameter]") == (
        "a.yaml:4:5：警告：没有步骤使用参数“rate”。请将其删除，或在应使用处写入 ${rate} [unused-parameter]"
    )
    assert chinese("steps: unknown key; expected call or with") == "steps：未知的键；应为 call、with"


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("title:", "tilte:", "tilte：未知的键；是否指“title”？"),
        ("driver: watlow_f4t", "driver: watlow_f5t", "没有驱动程序 'watlow_f5t'；是否指“watlow_f4t”？"),
        (
            "sim+tcp://127.0.0.1:8000",
            "sim+slcan:///tmp/x",
            "aerotech_ensemble 通过 serial、socket、tcp 连接，而不是 slcan",
        ),
        ("Latch.Tick", "Latch.Tock", "if_counter.dbc 没有信号“Latch.Tock”；是否指“Latch.Tick”？"),
        ("min: -50 °C, max: 100 °C", "min: 150 °C, max: 100 °C", "min 不小于 max"),
        ("channel: x", "channel: w", "没有计数器有通道“w”；应为 x、y、z"),
    ],
)
def test_a_refused_bench_file_is_chinese(tmp_path, old, new, problem):
    with pytest.raises(InputError) as refused:
        load_bench(copy_bench(tmp_path, (old, new)))
    found = [chinese(each) for each in refused.value.problems]
    assert [each for each in found if ENGLISH in each] == []
    assert problem in unescape("\n".join(found))


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        (
            "scanner: its setup has changed; expected a scan of (@101,102); received (@101) as TC in C, a scan running",
            "scanner：其设置已更改；应为扫描 (@101,102)；收到 (@101)，类型 TC，单位 C，扫描正在进行",
        ),
        (
            "table: the controller reports a fault: overspeed; received disabled, moving, mode off",
            "table：控制器报告故障：overspeed；收到已停用，运动中，模式关闭",
        ),
        (
            "93° was typed, 90° was asked for: it is +3° off, at most ±0.5° may be. Turn head by hand to 90°, from "
            "30° up by 60°, coming to it from below. When it is there and locked, type the angle that it shows, in "
            "° or deg.",
            "输入了 93°，要求的是 90°：偏差 +3°，最多允许 ±0.5°。请手动将 head 转至 90°，从 30° 增大 60°，从下方接近。"
            "到位并锁紧后，请输入其显示的角度，单位 ° 或 deg。",
        ),
        ("/r/results.json: .units.0 is not an object", "/r/results.json：.units.0 不是对象"),
    ],
)
def test_messages_of_many_parts_are_chinese(text, shown):
    assert unescape(chinese(text)) == shown


def journal_texts(path) -> set[str]:
    with RunReader(path) as reader:
        entries = list(reader.events())
    return {str(entry.data[key]) for entry in entries for key in ("text", "why", "by") if key in entry.data}


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    """A run whose interlock pauses it and then ends it, as the temperature does not recover."""
    folder = tmp_path_factory.mktemp("failed")
    path = folder / "s.yaml"
    warm = "interlocks: {warm: {reading: unit_temperature, above: 10 °C, then: pause, give_up_after: 20 min}}\n"
    path.write_text(steps("wait: 1 min", "wait: 1 s") + warm + TAIL, "utf-8")
    return run_short(folder / "runs", sequence=str(path))


def test_an_interlock_and_the_end_of_its_run_are_chinese(failed):
    texts = journal_texts(failed.path) | set(failed.problems)
    assert any("has not recovered within 20 min" in text for text in texts)
    assert [text for text in texts if ENGLISH in chinese(text)] == []
    assert chinese(failed.problems[0]).startswith("联锁 warm 已触发：unit_temperature 为 ")
    assert chinese("interlock warm") == "联锁 warm"


def test_facts_of_all_entries_of_a_run_have_chinese_names(failed):
    with RunReader(failed.path) as reader:
        entries = [entry for entry in reader.events() if entry.kind not in USUAL]
    names = {name for entry in entries for name in entry.data}
    assert len(names) > 10
    assert [name for name in sorted(names) if f"{name}: " not in catalogue_of("zh")] == []


def test_news_of_a_run_are_chinese_and_what_people_say_stays(failed):
    with RunReader(failed.path) as reader:
        entries = list(reader.events())
    with language("zh"):
        lines = [str(line.text) for line in news(reversed(entries), None, {}, 20)]
    assert "由 联锁 warm 保持" in lines
    assert any(line.startswith("联锁 warm 已触发") for line in lines)
    assert not [line for line in lines if ENGLISH in line or "&lt;span" in line]
    asked_ = entries[0]._replace(kind="asked", data={"text": "<b>no answer</b> within 5 s"})
    with language("zh"):
        assert [str(line.text) for line in news([asked_], None, {}, 1)] == [
            "问题：&lt;b&gt;no answer&lt;/b&gt; within 5 s"
        ]


def test_the_page_of_a_failed_run_says_why_in_chinese(failed, tmp_path):
    async def main():
        async with asked(tmp_path, failed.path.parent) as station:
            page = await station.client.get(f"/runs/{failed.path.name}", headers={**HTML, "accept-language": "zh"})
            return unescape(page.text)

    page = asyncio.run(main())
    (reasons,) = re.findall(r'<ul class="reasons">(.*?)</ul>', page, re.DOTALL)[:1]
    assert "20 min 内未恢复；停止试验" in reasons
    assert ENGLISH not in reasons
    assert "内容：联锁 warm 已触发" in page
    assert "操作者：联锁 warm" in page


@pytest.mark.parametrize(
    ("faults", "reason"),
    [
        ("[{device: supply, kind: silent, at: 10 s}]", "无应答"),
        ("[{device: chamber, kind: heater_dead, at: 1 min}]", "温箱"),
        ("[{device: head, kind: emergency_stop, at: 1 min}]", "轴 X 有故障：急停"),
        ("[{device: chamber, kind: front_panel, at: 1 min}]", "控制回路 1 不在自动模式"),
    ],
)
def test_problems_of_instruments_are_chinese(tmp_path, faults, reason):
    path = tmp_path / "s.yaml"
    path.write_text(steps("{ramp: chamber, to: 60 °C, at: 2 °C/min}", "wait: 10 s") + TAIL, "utf-8")
    result = run_short(tmp_path / "runs", sequence=str(path), bench=copy_bench(tmp_path / "config", faults=faults))
    assert result.problems
    assert [text for text in (*journal_texts(result.path), *result.problems) if ENGLISH in chinese(text)] == []
    assert reason in chinese(result.problems[0])


def test_a_resumption_is_chinese_and_why_it_is_refused(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(steps("{move: head, to: 10°}", "wait: 10 s", "wait: 20 s") + TAIL, "utf-8")
    run = interrupted(tmp_path / "runs", 25.0, path, ROOT / "config" / "simulated.yaml")
    lines = list(summary_lines(read_interrupted(run), prepare_again(read_interrupted(run))))
    assert len(lines) == 3
    assert [line for line in lines if ENGLISH in chinese(line)] == []
    path.write_text(path.read_text("utf-8") + "# changed\n", "utf-8")
    with pytest.raises(InputError) as refused:
        prepare_again(read_interrupted(run))
    assert chinese(refused.value.problems[0]) == (f"{run.name}：sequence.yaml 自试验开始后已更改；其副本在试验目录中")
