"""Bad input on the command line: exit 2, every problem on stderr as one line, nothing on stdout and nothing done."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys

import pytest

from bench.cli.main import main
from tests.support.sequences import ELSEWHERE, ROOT, TAIL, steps

DIALECTS = ROOT / "drivers/dialects"
HEAD = "schema: itb-sequence/1\ntitle: T\n"
SEQUENCES = sorted(path.stem for path in (ROOT / "sequences").glob("*.yaml"))
ON_THEIR_BENCHES = [
    (sequence, bench) for sequence in SEQUENCES for bench in ELSEWHERE.get(sequence, ("simulated", "simulated_wires"))
]


@pytest.fixture
def bench(tmp_path, monkeypatch, capsys):
    """The command in this process, in a folder of its own: arguments in; exit code, lines of stdout and stderr out."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("BENCH_FILE", raising=False)

    def command(*arguments: str) -> tuple[int, list[str], list[str]]:
        code = main(arguments)
        message = capsys.readouterr()
        return code, message.out.splitlines(), message.err.splitlines()

    return command


# What is shipped


@pytest.mark.parametrize(("sequence", "name"), ON_THEIR_BENCHES)
def test_everything_shipped_is_checked_in_one_line(bench, sequence, name):
    code, out, err = bench("check", sequence, "--bench", name)
    (line,) = out
    assert (code, err) == (0, [])
    assert line.startswith(f"{ROOT / 'sequences' / sequence}.yaml: ")
    assert line.endswith(f", no problem on {ROOT / 'config' / name}.yaml")
    assert re.search(r": [1-9]\d* steps?, no problem", line)


def test_a_preset_and_wishes_are_checked_too(bench):
    code, (line,), _ = bench("check", "tumble_static", "--preset", "quick", "--set", "cycles=2", "--set", "gate=10 s")
    assert code == 0
    assert "tumble_static.yaml: 331 steps, no problem on" in line  # 2 cycles of 9 dwells of 18 steps, and 7


def test_a_plan_lists_when_each_step_begins_how_long_it_takes_and_the_bench_after_it(bench):
    code, out, err = bench("plan", "smoke")
    assert (code, err) == (0, [])
    assert [line.rstrip() for line in out] == [
        "   begins        takes  chamber  head  supply   resumed  step",
        "  0:00:00          0 s    20 °C    0°    15 V  restored  setup/set",
        "  0:00:00          0 s    20 °C    0°    15 V  restored  steps/temperature=20/ramp",
        "  0:00:00         10 s    20 °C    0°    15 V   in full  steps/temperature=20/soak",
        "  0:00:10          3 s    20 °C    1°    15 V  restored  steps/temperature=20/position=0/move",
        "  0:00:13          5 s    20 °C    1°    15 V      anew  steps/temperature=20/position=0/acquire",
        "  0:00:18          7 s    20 °C   91°    15 V  restored  steps/temperature=20/position=90/move",
        "  0:00:25          5 s    20 °C   91°    15 V      anew  steps/temperature=20/position=90/acquire",
        "  0:00:30          7 s    20 °C  181°    15 V  restored  steps/temperature=20/position=180/move",
        "  0:00:37          5 s    20 °C  181°    15 V      anew  steps/temperature=20/position=180/acquire",
        "  0:00:42          7 s    20 °C  271°    15 V  restored  steps/temperature=20/position=270/move",
        "  0:00:49          5 s    20 °C  271°    15 V      anew  steps/temperature=20/position=270/acquire",
        "  0:00:54          0 s    20 °C  271°     off  restored  teardown/set",
        "  0:00:54         15 s    20 °C    0°     off  restored  teardown/move",
        "",
        "Made safe at the end, or if the run fails:",
        "  chamber  set point 25 °C      within 10 s",
        "  head     at rest where it is  within 5.75 s",
        "  supply   off                  within 5 s",
        "  source   0 A, then off        within 5 s",
        "",
        "13 steps, about 70 s, about 0.04 MB",
    ]


# Bad files


def write(folder, body, name="s.yaml"):
    (folder / name).write_text(body + TAIL, "utf-8")


@pytest.mark.parametrize("command", ["check", "plan", "run"])
def test_every_problem_is_a_line_with_its_place_and_the_exit_code_is_2(bench, tmp_path, command):
    write(tmp_path, steps("mov: head", "{move: head, too: 5°}", "{ramp: chamber, to: 200 °C, at: 1 °C/min}"))
    code, out, err = bench(command, "s.yaml", "--bench", "simulated")
    assert (code, out) == (2, [])
    assert err == [
        "s.yaml:2:5: unknown step 'mov'; did you mean 'move'?",
        "s.yaml:3:18: too: unknown key; did you mean 'to'?",
        "s.yaml:4:21: to: 200 °C is above the 100 °C that the bench file allows 'chamber' (step steps/ramp)",
    ]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.yaml"]


def test_the_problems_of_the_bench_file_and_of_the_sequence_are_told_together(bench, tmp_path):
    write(tmp_path, steps("mov: head"))
    text = (ROOT / "config/simulated.yaml").read_text("utf-8").replace("driver: watlow_f4t", "driver: watlow_f4tt")
    (tmp_path / "b.yaml").write_text(text, "utf-8")
    (tmp_path / "if_counter.dbc").write_bytes((ROOT / "config/if_counter.dbc").read_bytes())
    (tmp_path / "uut").mkdir()
    (tmp_path / "uut/quartz_flexure.yaml").write_bytes((ROOT / "config/uut/quartz_flexure.yaml").read_bytes())
    line = next(index for index, found in enumerate(text.splitlines(), 1) if "watlow_f4tt" in found)
    code, _, err = bench("check", "s.yaml", "--bench", "b.yaml")
    assert code == 2
    assert err == [
        f"b.yaml:{line}:5: driver: there is no driver 'watlow_f4tt'; did you mean 'watlow_f4t'?",
        "s.yaml:2:5: unknown step 'mov'; did you mean 'move'?",
    ]


# Warnings

JUDGED = "{measure: chamber.process_value, limits: {min: -60 °C}}"
COLD = steps("{ramp: chamber, to: -40 °C, at: 1 °C/min}", JUDGED) + "needs: {chamber: thermal_chamber}\n" + HEAD
LEFT_COLD = (
    "the last ramp goes to -40 °C; on a unit colder than the room water condenses when the door opens. "
    "End the teardown with a ramp to 15 °C or above"
)
NO_TEARDOWN = (
    "there is no teardown that takes 'chamber' back after the steps end or fail. "
    "Add a teardown that returns the head to 0° and the chamber to room temperature"
)
WARNED = [
    f"s.yaml:2:5: warning: {NO_TEARDOWN} [no-teardown]",
    f"s.yaml:2:21: warning: {LEFT_COLD} [left-cold]",
]


@pytest.fixture
def cold(tmp_path):
    (tmp_path / "s.yaml").write_text(COLD, "utf-8")


def test_warnings_are_told_on_stderr_and_counted(bench, cold):
    code, (line,), err = bench("check", "s.yaml")
    assert (code, err) == (0, WARNED)
    assert line == f"s.yaml: 2 steps, 2 warnings on {ROOT / 'config/simulated.yaml'}"


def test_one_warning_is_no_plural(bench, tmp_path):
    (tmp_path / "s.yaml").write_text(COLD + "teardown: [wait: 1 s]\n", "utf-8")
    code, (line,), err = bench("check", "s.yaml")
    assert (code, err) == (0, WARNED[1:])
    assert " 3 steps, 1 warning on " in line


def test_strict_takes_warnings_for_errors(bench, cold):
    assert bench("check", "s.yaml", "--strict") == (2, [], [line.replace("warning: ", "") for line in WARNED])
    code, _, err = bench("check", "smoke", "--strict")
    assert (code, err) == (0, [])


def test_plan_and_run_go_on_after_their_warnings(bench, cold):
    code, out, err = bench("plan", "s.yaml")
    assert (code, err) == (0, WARNED)
    assert out[-1].startswith("2 steps, about 60 min")
    code, _, err = bench("run", "s.yaml", "--bench", "simulated")
    assert code == 0
    assert err[:2] == WARNED


@pytest.mark.parametrize(("options", "severity"), [((), "warning"), (("--strict",), "error")])
def test_every_other_format_stands_alone_on_stdout(bench, cold, options, severity):
    ended = 2 if severity == "error" else 0
    code, (line,), err = bench("check", "s.yaml", "--format", "json", *options)
    assert (code, err) == (ended, [])
    assert json.loads(line)["found"][1] == {
        "severity": severity, "rule": "left-cold", "file": "s.yaml", "line": 2, "column": 21, "text": LEFT_COLD,
    }  # fmt: skip
    assert bench("check", "s.yaml", "--format", "github", *options) == (
        ended,
        [
            f"::{severity} file=s.yaml,line=2,col=5::{NO_TEARDOWN} [no-teardown]",
            f"::{severity} file=s.yaml,line=2,col=21::{LEFT_COLD} [left-cold]",
        ],
        [],
    )
    code, (line,), err = bench("check", "s.yaml", "--format", "sarif", *options)
    assert (code, err) == (ended, [])
    (ran,) = json.loads(line)["runs"]
    assert [result["level"] for result in ran["results"]] == [severity] * 2


@pytest.mark.parametrize(
    ("format_", "nothing"), [("github", []), ("sarif", None)], ids=["github", "sarif"],
)  # fmt: skip
def test_nothing_found_is_told_in_each_format(bench, format_, nothing):
    code, out, err = bench("check", "smoke", "--format", format_)
    assert (code, err) == (0, [])
    assert out == nothing if nothing is not None else json.loads(out[0])["runs"][0]["results"] == []


def test_errors_of_files_and_wishes_are_told_in_the_format_asked_for(bench, tmp_path):
    write(tmp_path, steps("mov: head"))
    code, (line,), err = bench("check", "s.yaml", "--preset", "p", "--format", "json")
    assert (code, err) == (2, [])
    assert [(found["file"], found["line"], found["rule"]) for found in json.loads(line)["found"]] == [
        (None, 1, "input"),
        ("s.yaml", 2, "input"),
    ]


def test_an_unknown_format_is_exit_code_2(bench):
    code, out, err = bench("check", "smoke", "--format", "xml")
    assert (code, out) == (2, [])
    assert "argument --format: invalid choice: 'xml' (choose from " in "\n".join(err)


# Hostile files


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", ":1:1: is empty, expected a mapping"),
        (b"title: a\n\xff\xfe\n", ":2:1: is not UTF-8 text; save it as UTF-8"),
        (b"x" * 10_000_000, ": has 10000000 bytes, at most 32768 are read; is it the right file?"),
        (b"[" * 10_000, ":1:1: is nested more than 20 deep"),
        (b"title: a\ntitle: b\n", ":2:1: the key 'title' stands twice; it is already in line 1"),
        (b"steps: [wait: .nan s]\n", ":1:1: the key 'needs' is missing"),
    ],
)
def test_a_hostile_file_is_refused_with_its_place(bench, tmp_path, content, problem):
    (tmp_path / "s.yaml").write_bytes(content)
    code, out, err = bench("check", "s.yaml")
    assert (code, out) == (2, [])
    assert err[0] == f"s.yaml{problem}"
    assert all(line.startswith("s.yaml:") for line in err)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("check", "smok"), "smok: there is no such sequence; did you mean 'smoke'?"),
        (("check", "smoke.yml"), "smoke.yml: there is no such sequence; did you mean 'smoke'?"),
        (("check", "nothing/smoke"), "nothing/smoke: there is no such file"),
        (("check", "smoke", "--bench", "simulatd"), "simulatd: there is no such bench; did you mean 'simulated'?"),
        (("plan", "."), ".: is a folder"),
        (("check", "smoke", "--preset", "quick"), "there is no preset 'quick'; none is known here"),
        (("plan", "tumble_static", "--preset", "quik"), "there is no preset 'quik'; did you mean 'quick'?"),
        (("check", "smoke", "--set", "gate"), "--set gate: expected name=value"),
        (("check", "smoke", "--set", "gate=2 h"), "--set gate=2 h: 'gate' is 7200 s, expected at most 3600 s"),
        (("plan", "smoke", "--set", "gate=5 V"), "--set gate=5 V: 'gate' is 5 V, expected a quantity in s"),
    ],
)
def test_a_wrong_choice_is_told_in_one_line(bench, arguments, problem):
    assert bench(*arguments) == (2, [], [problem])


def test_several_wrong_choices_are_told_at_once(bench):
    code, _, err = bench("check", "smoke", "--preset", "p", "--set", "gat=5 s", "--set", "soak=5 K", "--bench", "none")
    assert code == 2
    assert err[0].startswith("none: there is no such bench; expected ")
    assert err[1:] == [
        "there is no preset 'p'; none is known here",
        "--set gat=5 s: there is no parameter 'gat'; did you mean 'gate'?",
        "--set soak=5 K: kelvin is refused: write °C, for a difference too",
    ]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("check", "smoke", "--bnch", "simulated"), "bench check: there is no option --bnch; did you mean --bench?"),
        (("check",), "bench check: the following arguments are required: FILE"),
        (("plan", "smoke", "tumble_static"), "unrecognized arguments: tumble_static"),
        (("chek", "smoke"), "there is no command 'bench chek'; did you mean 'bench check'?"),
        (("check", "smoke", "--set"), "argument --set: expected one argument"),
        (("run", "smoke", "--seed", "one"), "argument --seed: invalid int value: 'one'"),
        (("runs", "verfy"), "there is no command 'bench runs verfy'; did you mean 'bench runs verify'?"),
        (("runs", "--last", "0"), "argument --last: 0 is not at least 1"),
        (("answer", "last", "-5mg"), "a value that begins with - is written as --option=VALUE, or after --"),
        (("new", "divers"), "did you mean 'bench new driver'?"),
        (("--verison",), "there is no command 'bench --verison'; did you mean 'bench --version'?"),
        (("frobnicate",), "there is no command 'bench frobnicate'; 'bench --help' lists all commands"),
    ],
)
def test_a_wrong_word_on_the_command_line_is_exit_code_2(bench, arguments, problem):
    code, out, err = bench(*arguments)
    assert (code, out) == (2, [])
    assert problem in "\n".join(err)


@pytest.mark.parametrize("arguments", [("reference", "steps"), ("check", "smoke"), ("schema", "bench"), ("--help",)])
def test_a_standard_output_that_is_full_is_named(bench_command, tmp_path, arguments):
    with open("/dev/full", "w") as full:
        done = bench_command(*arguments, cwd=tmp_path, stdout=full)
    assert (done.returncode, done.stderr) == (3, "standard output: No space left on device\n")


def test_a_reader_who_has_enough_is_no_error_to_tell(bench_command, tmp_path):
    read, write = os.pipe()
    os.close(read)
    with open(write, "w") as closed:
        done = bench_command("reference", "steps", cwd=tmp_path, stdout=closed)
    assert done.stderr == ""


def test_a_process_ends_with_exit_code_2_and_no_traceback(bench_command, tmp_path):
    write(tmp_path, steps("wait: '${(1)(2)}'"))
    done = bench_command("check", "s.yaml", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "s.yaml:2:5: wait: '${(1)(2)}': expected numbers, names, + - * /, comparisons, and, or, not, if else, "
        "abs, min, max, round, sqrt, sin, cos, len\n"
    )


# What is not loaded

UNMEASURED = {name: value for name, value in os.environ.items() if not name.startswith(("COVERAGE", "OPENBLAS"))}


def loaded(code: str, modules: str) -> list[str]:
    """Which of `modules` a fresh interpreter has loaded after `code`, unmeasured: coverage loads some of its own."""
    ask = f"import json, sys\nprint(json.dumps([name for name in {modules.split()} if name in sys.modules]))"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\n{ask}"], capture_output=True, text=True, check=True, cwd=ROOT, env=UNMEASURED
    )
    return json.loads(done.stdout.splitlines()[-1])


def after_command(*arguments: str) -> str:
    return (
        f"import sys\nfrom bench.cli.main import run\nsys.argv = {['bench', *arguments]}\n"
        "try:\n    run()\nexcept SystemExit as ended:\n    assert not ended.code, ended.code"
    )


HEAVY = "numpy scipy pymodbus can cantools serial matplotlib rich jinja2 fastapi starlette uvicorn"


def test_help_loads_next_to_nothing():
    assert loaded(after_command("--help"), f"{HEAVY} asyncio pydantic pydantic_core yaml simpleeval") == []


def test_a_station_begins_without_what_only_reports_and_reductions_need():
    assert loaded("import bench.web.server", "matplotlib scipy.special scipy.spatial.transform scipy.linalg h5py") == []


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_checking_a_sequence_loads_no_arithmetic_and_no_wires(sequence):
    bench = ELSEWHERE.get(sequence, ("simulated",))[0]
    command = after_command("check", sequence, "--bench", bench)
    found = loaded(command, f"{HEAVY} asyncio simulators pydantic_core yaml")
    assert found == ["pydantic_core", "yaml"]


def test_checking_files_of_every_kind_but_units_and_calibrations_loads_no_wires_and_no_server(tmp_path):
    (tmp_path / "station.yaml").write_text("schema: itb-station/1\nbenches: {one: {file: simulated}}\n", "utf-8")
    files = ("sequences/smoke.yaml", "config/simulated.yaml", "config/scenarios", "config/chambers", str(tmp_path))
    assert loaded(after_command("check", *files), f"{HEAVY} simulators bench.web pydantic_core") == ["pydantic_core"]


def test_checking_loads_no_results_no_scan_and_no_methods_that_the_sequence_does_not_name():
    never = (
        "bench.metrology.results.finding bench.metrology.results.curves bench.figures.numbers "
        "drivers.discovery.recognition"
    )
    methods = "bench.sequence.method bench.methods.imu.method bench.methods.rate_table.method"
    assert loaded(after_command("check", "smoke"), f"{never} {methods}") == ["bench.sequence.method"]


def test_checking_a_sequence_without_mistakes_loads_nothing_for_other_files_and_for_mistakes():
    others = "bench.config.laboratory bench.offline.calibration_file bench.certificates.certificate difflib sqlite3"
    assert loaded(after_command("check", "smoke", "--bench", "simulated"), others) == []


def test_a_run_without_a_report_loads_no_page_no_plot_no_server_and_no_archive(tmp_path):
    never = "matplotlib jinja2 fastapi starlette uvicorn httpx deltalake h5py lxml scipy.optimize scipy.stats"
    ours = "bench.report.page bench.report.html bench.station bench.web bench.archive bench.campaign"
    cases = "bench.offline.case_file bench.offline.calibration_form"
    command = after_command("run", "smoke", "--bench", "simulated", "--no-report", "--runs", str(tmp_path))
    assert loaded(command, f"{never} {ours} {cases} rich.console bench.reduce.stored_run") == [
        "bench.reduce.stored_run"
    ]


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="numpy has no other threads on one processor")
def test_threads_of_numpy_without_work_take_no_processor_time():
    spent = "import time\nimport numpy\ntime.sleep(0.2)\nprint(time.process_time() - time.thread_time())"
    plain = subprocess.run([sys.executable, "-c", spent], capture_output=True, text=True, check=True, env=UNMEASURED)
    code = f"{after_command('--version')}\n{spent}"
    ours = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT, env=UNMEASURED
    )
    assert float(ours.stdout.splitlines()[-1]) <= float(plain.stdout) / 4 + 0.005


def test_what_a_run_needs_until_its_end_loads_no_part_of_scipy():
    parts = "scipy.linalg scipy.spatial scipy.special numpy.f2py numpy.testing"
    assert loaded("import bench.app.execute", f"{parts} simulators.physics.thermal") == ["simulators.physics.thermal"]


def test_checking_loads_what_is_known_of_the_drivers_of_the_bench_and_of_no_others():
    every = " ".join(
        sorted(f"drivers.dialects.{path.parent.name}.description" for path in DIALECTS.glob("*/description.py"))
    )
    found = loaded(after_command("check", "smoke", "--bench", "simulated"), every)
    named = {
        line.split()[-1]
        for line in (ROOT / "config/simulated.yaml").read_text("utf-8").splitlines()
        if "driver:" in line
    }
    assert {f"drivers.dialects.{name}.description" for name in named} <= set(found)
    assert not {
        "drivers.dialects.cts.description",
        "drivers.dialects.framed.description",
        "drivers.dialects.fluke_5700a.description",
    } & set(found)


@pytest.mark.parametrize("path", sorted(DIALECTS.glob("*/wire.py")), ids=lambda path: path.parent.name)
def test_a_wire_format_loads_nothing_that_opens_a_wire(path):
    wire = f"drivers.dialects.{path.parent.name}.wire"
    assert loaded(f"import {wire}", f"{wire} asyncio socket serial pymodbus can drivers.transport") == [wire]


def test_a_mistake_of_the_program_is_never_taken_for_a_unit_that_fails(bench, monkeypatch):
    def broken(*_: object) -> None:
        raise ZeroDivisionError("planted")

    monkeypatch.setattr("bench.app.request.load_checked", broken)
    code, _, err = bench("check", "smoke")
    assert code == 3
    assert err[0] == "an internal error of this program:"
    assert err[-1] == "ZeroDivisionError: planted"
