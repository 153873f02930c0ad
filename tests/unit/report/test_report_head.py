"""The head of a report: its number and revision, what it is for, and what was not as planned."""

import datetime as dt
import json
import re
import shutil
import sqlite3
from contextlib import closing

import pytest

from bench.app.request import RunRequest, prepare
from bench.errors import InputError, StoreError
from bench.figures.times_and_sizes import instant
from bench.reduce.stored_run import open_run
from bench.report.write import write_report
from tests.support.runs import ROOT, copy_bench, read_json, run_short, sealed_anew

AMBIENT = (
    ("time_zone: Asia/Shanghai\n", "time_zone: Asia/Shanghai\n  ambient: [room_temperature]\n"),
    ("readings:\n", "readings:\n  room_temperature: {from: chamber.process_value}\n"),
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("head")
    bench = copy_bench(folder / "config", *AMBIENT)
    options = {"operator": "A. Technician", "order": "2026-117", "procedure": "TP-017 rev. C"}
    return run_short(folder, bench=bench, sequence="smoke", no_report=False, **options)


@pytest.fixture
def folder(run, tmp_path):
    """A copy of the run's directory that may be changed."""
    shutil.copytree(run.path, tmp_path / run.path.name)
    return tmp_path / run.path.name


def head_of(folder):
    """The facts in the head of the page as it is."""
    page = (folder / "report.html").read_text("utf-8")
    facts = page.partition('<div class="head">')[2].partition("</div>")[0]
    return dict(re.findall("<dt>(.*?)</dt><dd>(.*?)</dd>", facts))


def written(folder, form="html", lang="en"):
    with open_run(sealed_anew(folder)) as stored:
        return write_report(stored, form, lang)


def revisions(folder):
    return json.loads((folder / "report_revisions.json").read_text("utf-8"))["revisions"]


def change(folder, **manifest):
    path = folder / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text("utf-8")), **manifest}), "utf-8")


def test_it_names_order_procedure_method_rule_and_the_air_in_the_room(run):
    head = head_of(run.path)
    with open_run(run.path) as stored:
        room_c = stored.reader.series("room_temperature").values
    assert head["Order"] == "2026-117"
    assert head["Procedure"] == "TP-017 rev. C"
    assert head["Method"].endswith("(method M4a), after IEEE Std 1293, IEEE Std 530, IEEE Std 1554")
    assert head["Decision rule"] == "simple acceptance: a value inside its limits passes"
    assert head["Ambient conditions"] == (
        f"room temperature {room_c.min():.1f} to {room_c.max():.1f} °C (uncertainty not stated)"
    )
    assert head["Deviations"] == "see below"
    manifest = read_json(run, "manifest.json")
    assert (manifest["order"], manifest["procedure"]) == ("2026-117", "TP-017 rev. C")
    assert '<th scope="row">Tested</th><td>A. Technician</td>' in (run.path / "report.html").read_text("utf-8")


def test_its_number_is_that_of_the_run_and_its_first_revision(run):
    assert f"<p>Report {run.path.name}, revision 1</p>" in (run.path / "report.html").read_text("utf-8")
    (first,) = revisions(run.path)
    assert first["revision"] == 1
    assert re.fullmatch("sha256:[0-9a-f]{64}", first["content"])


def test_what_is_written_again_with_the_same_content_is_the_same_revision(folder):
    before, known = (folder / "report.html").read_bytes(), revisions(folder)
    written(folder, "html", "zh")
    assert written(folder).read_bytes() == before
    assert revisions(folder) == known


def test_another_content_is_another_revision_and_the_hash_of_the_one_before_is_kept(folder):
    before = revisions(folder)
    change(folder, order="2026-118")
    assert f"{folder.name}, revision 2<" in written(folder).read_text("utf-8")
    change(folder, order="2026-117")
    assert f"{folder.name}, revision 3<" in written(folder).read_text("utf-8")
    known = revisions(folder)
    assert known[:1] == before
    assert [each["revision"] for each in known] == [1, 2, 3]
    assert known[0]["content"] == known[2]["content"] != known[1]["content"]


def test_a_list_of_revisions_that_is_damaged_is_not_begun_anew(folder):
    (folder / "report_revisions.json").write_text("[{}]")
    with pytest.raises(StoreError, match="is damaged"):
        written(folder)


def test_a_run_of_which_nothing_is_stated_says_so(folder):
    change(folder, order="", procedure="")
    bench = folder / "bench.yaml"
    bench.write_text(bench.read_text("utf-8").replace("  ambient: [room_temperature]\n", ""), "utf-8")
    written(folder)
    head = head_of(folder)
    assert (head["Order"], head["Procedure"], head["Ambient conditions"]) == (
        "not stated",
        "not stated",
        "not recorded",
    )


def test_steps_that_were_done_again_are_deviations(folder):
    with closing(sqlite3.connect(folder / "run.db")) as database, database:
        add = "INSERT INTO journal(at_s, kind, step, data) VALUES (1, ?, 'steps/move', ?)"
        database.execute(add, ("retried", '{"attempt": 2, "text": "it did not arrive"}'))
        database.execute(add, ("operator", '{"action": "repeat"}'))
        database.execute(add, ("operator", '{"action": "skip"}'))
    database.close()
    page = written(folder).read_text("utf-8")
    assert "<li>Repeated: step steps/move. it did not arrive</li>" in page
    assert page.count("<li>Repeated by the operator: step steps/move.</li>") == 1


def test_every_rule_that_a_limit_is_judged_by_is_told(folder):
    sequence = folder / "sequence.yaml"
    text = sequence.read_text("utf-8")
    assert "max: 5 mg}" in text
    sequence.write_text(text.replace("max: 5 mg}", "max: 5 mg, guard: 2, u_max: 1 mg}"), "utf-8")
    written(folder)
    assert head_of(folder)["Decision rule"].split("; ") == [
        "guarded acceptance: a value passes that is inside its limits by 2 u",
        "simple acceptance: a value inside its limits passes",
        "where a limit has u_max: a value passes only if its standard uncertainty is at most that",
    ]


@pytest.mark.parametrize(
    ("zone", "shown"),
    [
        ("Asia/Shanghai", "2026-06-30 20:00:00 UTC+08:00 (Asia/Shanghai)"),
        ("America/St_Johns", "2026-06-30 09:30:00 UTC-02:30 (America/St_Johns)"),
        ("UTC", "2026-06-30 12:00:00 UTC"),
    ],
)
def test_times_are_those_of_the_laboratory_with_their_distance_from_utc(zone, shown):
    assert instant(dt.datetime(2026, 6, 30, 12, tzinfo=dt.UTC).isoformat(), zone) == shown


@pytest.mark.parametrize("option", ["order", "procedure"])
@pytest.mark.parametrize("text", ["x" * 201, "two\nlines"])
def test_an_order_is_a_line(option, text):
    with pytest.raises(InputError, match=f"--{option}: expected up to 200 printable characters"):
        prepare(RunRequest("smoke", bench=str(ROOT / "config/simulated.yaml"), **{option: text}))


def test_the_room_has_readings_that_the_bench_has(tmp_path):
    bench = copy_bench(tmp_path, (AMBIENT[0][0], AMBIENT[0][1].replace("room_", "unti_")))
    with pytest.raises(InputError, match="there is no reading 'unti_temperature'; did you mean 'unit_temperature'"):
        prepare(RunRequest("smoke", bench=str(bench)))


def test_a_specified_drift_is_in_the_head_and_beside_each_result(folder):
    sequence = folder / "sequence.yaml"
    text = sequence.read_text("utf-8")
    assert "Specified drift" not in head_of(folder)
    changed, count = re.subn(r"(?m)^( +)limits:", r"\g<1>monthly_drift: {K0: 50 µg, K1: 20 ppm}\n\g<0>", text)
    assert count == 1
    sequence.write_text(changed, "utf-8")
    written(folder)
    assert head_of(folder)["Specified drift"].startswith("K0 50 µg, K1 per local g 20 ppm a month")
    with open_run(folder) as run:
        findings = run.evaluate().to_json()["findings"]
    for quantity, allowed in (("K0", lambda _: 50e-6), ("K1", lambda value: 20e-6 * value), ("K2", lambda _: None)):
        found = [each for each in findings if each["quantity"] == quantity]
        assert found
        assert [each["monthly_drift"] for each in found] == [pytest.approx(allowed(each["value"])) for each in found]
