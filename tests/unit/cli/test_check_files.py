"""`bench check` of many files: which are found, as what they are checked, and in which formats the result is."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tests.support.commands import invoked
from tests.support.junit import cases, problems
from tests.support.runs import ROOT
from tests.support.sequences import TAIL, steps

SMOKE = (ROOT / "sequences/smoke.yaml").read_text("utf-8")
WITHOUT_LIMITS = steps("move: head") + TAIL
OFF_BENCH = steps("{move: head, to: 400°}") + TAIL
WARM_UP = steps("{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}") + TAIL
TURNING = "schema: itb-sequence/1\ntitle: T\nneeds: {table: rate_table}\nsteps:\n  - {move: table, to: 90°}\n"
OTHERS = {
    "scenario": "schema: itb-scenario/1\ntitle: S\nfaults: [{fault: silent, device: chamber, at: 1 min}]\n",
    "answers": "schema: itb-answers/1\nanswers: {steps/prompt: {answer: done}}\n",
    "station": "schema: itb-station/1\nbenches: {one: {file: simulated}}\n",
}


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """The folder from which the command is called."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, "utf-8")
    return path


def told(*words: str, code: int) -> dict:
    done = invoked("check", *words, "--format", "json")
    assert (done.returncode, done.stderr) == (code, "")
    return json.loads(done.stdout)


def kinds(content: dict) -> dict[str, str]:
    return {check["file"]: check["kind"] for check in content["checks"]}


def test_files_in_a_folder_are_recognised_by_their_schema_and_others_are_counted(folder):
    write(folder / "lab/a.yaml", SMOKE)
    write(folder / "lab/deep/b.yml", SMOKE)
    for kind, text in OTHERS.items():
        write(folder / f"lab/{kind}.yaml", text)
    shutil.copy(ROOT / "config/uut/imu_calibration.json", folder / "lab")
    shutil.copy(ROOT / "config/chambers/fictional.yaml", folder / "lab/chamber.yaml")
    shutil.copy(ROOT / "config/uut/quartz_flexure.yaml", folder / "lab/uut.yaml")
    write(folder / "lab/parameters.yaml", "soak: 30 min\n")
    write(folder / "lab/pipeline.yaml", "script:\n  - |\n    schema: itb-sequence/1\n")
    write(folder / "lab/notes.txt", "schema: itb-sequence/1\n")
    write(folder / "lab/.hidden/c.yaml", "schema: itb-sequence/1\n")
    write(folder / "lab/runs/one/run.db", "")
    write(folder / "lab/runs/one/sequence.yaml", "schema: itb-sequence/1\n")
    content = told("lab", "lab/a.yaml", code=0)
    assert kinds(content) == {
        "lab/a.yaml": "sequence", "lab/deep/b.yml": "sequence", "lab/imu_calibration.json": "calibration",
        "lab/chamber.yaml": "chamber", "lab/uut.yaml": "uut", **{f"lab/{kind}.yaml": kind for kind in OTHERS},
    }  # fmt: skip
    assert content["ignored"] == 3


@pytest.mark.parametrize(
    ("kind", "wrong", "problem"),
    [
        ("scenario", ("silent", "slient"), "fault: is 'slient'"),
        ("answers", ("answer:", "anser:"), "anser: unknown key"),
        ("station", ("simulated", "nowhere"), "nowhere: there is no such bench"),
        ("bench", ("driver: watlow_f4t", "driver: watlow_f5t"), "watlow_f5t"),
    ],
)
def test_each_kind_is_checked_as_what_it_is(folder, kind, wrong, problem):
    text = OTHERS.get(kind) or (ROOT / "config/simulated.yaml").read_text("utf-8")
    path = write(folder / f"lab/{kind}.yaml", text.replace(*wrong))
    assert path.read_text("utf-8") != text
    for word in ("lab", str(path)):
        content = told(word, code=2)
        assert list(kinds(content).values()) == [kind]
        assert problem in content["found"][0]["text"]


def test_a_file_that_is_no_valid_yaml_has_a_kind_as_well(folder):
    write(folder / "lab/s.yaml", "schema: itb-sequence/1\nsteps: [\n")
    (found,) = told("lab", code=2)["found"]
    assert found["file"] == "lab/s.yaml"
    assert "is not YAML" in found["text"]


def test_a_folder_without_any_such_file_is_no_success(folder):
    write(folder / "lab/notes.txt", "nothing")
    done = invoked("check", "lab")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("lab: no sequence or bench or ")


def test_a_called_sequence_in_a_folder_is_judged_as_a_whole_with_its_caller_only(folder):
    write(folder / "lab/part.yaml", WARM_UP)
    caller = steps("call: part.yaml", "{wait: 1 s}") + "teardown:\n  - {set: supply, output: off}\n"
    write(folder / "lab/whole.yaml", caller + "schema: itb-sequence/1\ntitle: W\nneeds: {}\n")
    files = {found["file"] for found in told("lab", code=0)["found"]}
    assert files == {"lab/whole.yaml"}, "nothing is judged in it"
    assert "left-energised" in {found["rule"] for found in told("lab/part.yaml", code=2)["found"]}
    write(folder / "lab/part.yaml", WARM_UP.replace("15 V", "15 kg"))
    assert "lab/part.yaml" in {found["file"] for found in told("lab", code=2)["found"]}


def test_with_several_benches_a_sequence_is_for_those_that_meet_its_needs(folder):
    write(folder / "lab/smoke.yaml", SMOKE)
    write(folder / "lab/turning.yaml", TURNING)
    benches = ("--bench", "simulated", "--bench", "rate_table", "--bench", "three_units")
    content = told("lab", *benches, code=0)
    found = [(check["file"], Path(check["bench"]).stem) for check in content["checks"]]
    assert found == [
        ("lab/smoke.yaml", "simulated"), ("lab/smoke.yaml", "three_units"), ("lab/turning.yaml", "rate_table"),
    ]  # fmt: skip
    (error,) = told("lab/turning.yaml", "--bench", "simulated", "--bench", "three_units", code=2)["found"]
    assert (error["file"], error["line"]) == ("lab/turning.yaml", 3)
    assert error["text"].startswith("no given bench meets the needs of this sequence: simulated: the bench ")
    assert "; three_units: the bench " in error["text"]
    wrong = write(
        folder / "lab/far.yaml",
        TURNING.replace("table: rate_table", "head: positioner").replace("table, to: 90", "head, to: 400"),
    )
    errors = [each["text"] for each in told(str(wrong), *benches, code=2)["found"] if each["severity"] == "error"]
    assert [text.rpartition(" (")[2] for text in errors] == ["on the bench simulated)", "on the bench three_units)"]


def test_a_bench_that_cannot_be_used_is_told_once_for_all_sequences(folder):
    write(folder / "lab/a.yaml", SMOKE)
    write(folder / "lab/b.yaml", SMOKE)
    bench = write(folder / "bench.yaml", "schema: itb-bench/1\ntitle: B\n")
    content = told("lab", "--bench", str(bench), code=2)
    assert [check["errors"] > 0 for check in content["checks"]] == [True, True]
    assert len({found["text"] for found in content["found"]}) == len(content["found"])


def test_text_has_problems_on_stderr_and_a_count_at_the_end(folder):
    write(folder / "lab/bad.yaml", OFF_BENCH)
    write(folder / "lab/good.yaml", SMOKE)
    write(folder / "lab/notes.txt", "")
    done = invoked("check", "lab")
    assert done.returncode == 2
    assert done.stdout.splitlines()[0].startswith("lab/good.yaml: 13 steps, no problem on ")
    assert done.stdout.splitlines()[1:] == ["2 checks, 1 with errors; 1 other file ignored"]
    assert "lab/bad.yaml:2:18: to: 400 ° is above" in done.stderr


def test_a_warning_is_an_error_where_that_is_asked_for(folder):
    write(folder / "lab/a.yaml", WITHOUT_LIMITS.replace("move: head", "{wait: 1 s}"))
    write(folder / "lab/b.yaml", SMOKE)
    assert invoked("check", "lab").returncode == 0
    assert invoked("check", "lab", "--strict").returncode == 2


def test_junit_has_a_case_for_each_file_that_the_schema_of_jenkins_allows(folder):
    write(folder / "lab/bad.yaml", OFF_BENCH)
    write(folder / "lab/good.yaml", SMOKE)
    write(folder / "lab/warned.yaml", WITHOUT_LIMITS.replace("move: head", "{wait: 1 s}"))
    bench = str(ROOT / "config/simulated.yaml")
    done = invoked("check", "lab", bench, "--format", "junit")
    assert (done.returncode, done.stderr) == (2, "")
    found = cases(done.stdout)
    assert {name: case.attrib["classname"].split()[-1] for name, case in found.items()} == {
        "lab/bad.yaml": "sequence", "lab/good.yaml": "sequence", "lab/warned.yaml": "sequence", bench: "bench",
    }  # fmt: skip
    (failure,) = found["lab/bad.yaml"].iter("failure")
    assert failure.text.startswith("lab/bad.yaml:2:18: to: 400 ° is above")
    assert list(found["lab/good.yaml"]) == []
    (output,) = found["lab/warned.yaml"]
    assert output.tag == "system-out"
    assert "[nothing-judged]" in output.text
    assert all(float(case.attrib["time"]) >= 0 for case in found.values())


def test_junit_bears_hostile_texts(folder):
    write(folder / 'lab/a&"<]]>\x1b é.yaml', OFF_BENCH)
    done = invoked("check", "lab", "--format", "junit")
    (name,) = cases(done.stdout)
    assert name == 'lab/a&"<]]>\N{REPLACEMENT CHARACTER} é.yaml'


def test_the_schema_of_the_tests_sees_what_is_wrong():
    from xml.etree.ElementTree import fromstring

    wrong = '<testsuite name="a" tests="2" failures="0" errors="0"><testcase time="x" file="f"/>text<odd/></testsuite>'
    assert len(list(problems(fromstring(wrong)))) == 7


def test_sarif_has_a_place_for_every_problem_of_a_file(folder):
    write(folder / "lab/a.yaml", "schema: itb-sequence/1\n" + "#" * 40_000)
    write(folder / "lab/b.yaml", OFF_BENCH)
    done = invoked("check", "lab", "nowhere.yaml", "--format", "sarif")
    assert done.returncode == 2
    (run,) = json.loads(done.stdout)["runs"]
    places = [result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] for result in run["results"]]
    assert {"lab/a.yaml", "lab/b.yaml", "nowhere.yaml"} == set(places)
    github = invoked("check", "lab", "--format", "github").stdout.splitlines()
    assert github[0].startswith("::error file=lab/a.yaml,line=1,col=1::has 4")
