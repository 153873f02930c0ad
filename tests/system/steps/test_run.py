"""A whole run on the simulated bench, in virtual time, through every wire."""

import hashlib
import json
import math
import os

import pytest

from bench.app import execute
from bench.app.request import RunRequest, prepare
from bench.errors import InUseError, StoreError
from bench.loop import BenchLoop
from bench.reduce.stored_run import StoredRun
from bench.runner.held import address_lock
from bench.runner.quiet import Quiet
from bench.store.reader import RunReader
from bench.store.runs import RunDirectory
from bench.store.writer import RunWriter
from campaigns.truth.campaign import compare_one
from drivers.transport.address import Address
from tests.support.flags import texts
from tests.support.runs import ROOT, SHORT, copy_bench, read_json, run_short


def test_it_completes_with_a_verdict_and_leaves_everything_behind(tumble_run):
    assert tumble_run.outcome.how == "completed"
    assert tumble_run.problems == []
    assert tumble_run.results.verdict == "PASS"
    left = {path.name for path in tumble_run.path.iterdir()}
    assert left >= {
        "results.json", "report.html", "manifest.json", "run.db", "truth.json", "sequence.yaml", "bench.yaml",
        "if_counter.dbc", "run.lock",
    }  # fmt: skip
    assert "reserve.bin" not in left


def test_the_manifest_says_who_what_when_and_on_what(tumble_run):
    manifest = read_json(tumble_run, "manifest.json")
    assert (manifest["state"], manifest["verdict"], manifest["operator"]) == ("completed", "PASS", "Ada")
    assert manifest["units"] == [
        {"place": "a", "uut": "QF-0001", "type": "accelerometer channel", "channel": "x", "mount_angle_deg": 0.0,
         "supply": "supply"}
    ]  # fmt: skip
    assert manifest["simulated"] == ["chamber", "head", "counter", "supply", "source"]
    assert manifest["parameters"]["soak"] == "30 min"  # as the sequence writes it
    head = manifest["instruments"]["head"]
    assert (head["serial"], head["serial_verified"]) == ("SIM-HEAD-01", False)
    assert head["calibration"]["certificate"] == "SIM-2026-0101"
    source = manifest["instruments"]["source"]
    assert (source["model"], source["serial"], source["serial_verified"]) == ("MODEL 6220", "SIM-6220-01", True)
    for name, stated in manifest["hashes"].items():
        assert stated == "sha256:" + hashlib.sha256((tumble_run.path / name).read_bytes()).hexdigest(), name
    with RunReader(tumble_run.path) as reader:
        assert manifest["digest"] == reader.digest()


def test_results_have_the_form_of_the_reference(tumble_run):
    results = read_json(tumble_run, "results.json")
    assert results["schema"] == "itb-results/1"
    quantities = [finding["quantity"] for finding in results["findings"]]
    for quantity in ("K0", "K1", "K1_si", "K2", "misalignment"):
        assert quantities.count(quantity) == 3
    for quantity in ("K0/hysteresis", "K1/hysteresis", "K0/temperature_coefficient", "K1/temperature_coefficient"):
        assert quantities.count(quantity) == 1
    first = results["findings"][0]
    assert first["id"] == "tumble/a/K0@cycle=1/temperature=20"
    assert first["steps"] == [
        f"steps/cycle=1/temperature=20/position={position}/acquire" for position in ("0", "180", "180#2", "0#2")
    ]
    assert first["at"] == {
        "cycle": 1, "dwell": 0, "leg": "up", "temperature_set_c": 20.0,
        "temperature_c": pytest.approx(25, abs=0.5), "temperature_u_c": pytest.approx(0.301, abs=0.001),
    }  # fmt: skip
    assert first["limits"] == {"min": -5e-3, "max": 5e-3}
    assert first["expanded"] == 2 * first["u"]
    assert math.isclose(first["u"], math.hypot(*(line["u"] for line in first["budget"])))
    assert {line["source"] for line in first["budget"]} >= {"head: harmonics", "readings: scatter pooled over the run"}
    k2 = next(finding for finding in results["findings"] if finding["quantity"] == "K2")
    assert k2["name"].startswith("K2 + asymmetry")
    assert [line["type"] for line in k2["budget"]].count("alias") == 1
    assert results["units"] == [
        {
            "place": "a",
            "uut": "QF-0001",
            "verdict": "PASS",
            "flags": ["K0:too_few_temperatures", "K1:too_few_temperatures"],
        }
    ]
    assert "NaN" not in json.dumps(results)


def test_the_results_agree_with_the_truth(tumble_run):
    for comparison in compare_one(tumble_run.path, read_json(tumble_run, "results.json")):
        assert abs(comparison.ratio) < 4, comparison


def test_the_journal_tells_every_step_in_order(tumble_run):
    with RunReader(tumble_run.path) as reader:
        begun = [event.step for event in reader.events("step_begins")]
        ended = [event.step for event in reader.events("step_ended")]
        kinds = [event.kind for event in reader.events()]
    assert begun == ended
    assert begun[0] == "setup/move"
    assert begun[-1] == "teardown/soak"
    assert kinds[0] == "run_begins"
    assert kinds[-2:] == ["made_safe", "run_ended"]
    assert kinds.count("identified") == 5


def test_named_readings_cover_the_whole_run_every_second(tumble_run):
    with RunReader(tumble_run.path) as reader:
        unit = reader.series("unit_temperature")
        chamber = reader.series("chamber.process_value")
    assert unit.unit == chamber.unit == "°C"
    steps = unit.at_s[1:] - unit.at_s[:-1]
    assert steps.max() < 1.5
    assert unit.at_s[-1] > tumble_run.bench_s - 3
    assert (chamber.at_s[1:] - chamber.at_s[:-1]).max() < 11


def test_frames_are_kept_only_during_acquisitions_and_none_is_missing(tumble_run):
    with RunReader(tumble_run.path) as reader:
        frames = reader.frames_by_step()
    assert set(frames) == {step for step in frames if step.endswith("/acquire")}
    assert len(frames) == 24
    for streams in frames.values():
        block = streams["counter"]
        assert 99 <= (block.ids == 0x100).sum() <= 101
        assert (block.ids == 0x101).sum() == (block.ids == 0x100).sum()


def test_the_same_seed_gives_the_same_bytes_in_two_processes(tmp_path, bench_command, bench_here):
    paths = []
    for name in ("one", "two"):
        words = ("run", "smoke", "--bench", "simulated", "--no-report", "--seed", "7")
        done = bench_command(*words, "--runs", tmp_path / name)
        assert done.returncode == 0, done.stderr
        paths.append(next((tmp_path / name).iterdir()))
    digests = [bench_here("runs", "digest", path).stdout for path in paths]
    assert digests[0] == digests[1]
    assert len(digests[0]) == 65
    assert (paths[0] / "results.json").read_bytes() == (paths[1] / "results.json").read_bytes()
    assert (paths[0] / "truth.json").read_bytes() == (paths[1] / "truth.json").read_bytes()


def test_a_run_is_the_same_to_the_byte_when_every_answer_is_waited_for_by_turns_of_the_loop(tmp_path, monkeypatch):
    at_once = run_short(tmp_path / "at_once", sequence="smoke", seed=7)
    monkeypatch.setattr(BenchLoop, "run_now", lambda _loop, _timer: False)
    in_turns = run_short(tmp_path / "in_turns", sequence="smoke", seed=7)
    assert read_json(at_once, "manifest.json")["digest"] == read_json(in_turns, "manifest.json")["digest"]


def test_another_seed_gives_other_data(tmp_path):
    digests = set()
    for seed in (1, 2):
        result = run_short(tmp_path, sequence="smoke", seed=seed)
        digests.add(read_json(result, "manifest.json")["digest"])
    assert len(digests) == 2


def test_a_limit_that_is_not_met_fails_the_unit_and_nothing_else(tmp_path):
    sequence = tmp_path / "strict.yaml"
    sequence.write_text(
        (ROOT / "sequences" / "smoke.yaml").read_text("utf-8").replace("min: -5 mg, max: 5 mg", "max: 5 µg")
    )
    result = run_short(tmp_path / "runs", sequence=str(sequence))
    assert result.outcome.how == "completed"
    assert result.results.verdict == "FAIL"
    assert result.results.units[0].verdict == "FAIL"


def test_another_truth_file_gives_another_unit(tmp_path):
    model = tmp_path / "unit.yaml"
    text = (ROOT / "config" / "uut" / "quartz_flexure.yaml").read_text("utf-8")
    model.write_text(text.replace("at_reference: 0.8 mg", "at_reference: {mean: -2 mg, sd: 0.5 mg}"), "utf-8")
    result = run_short(tmp_path / "runs", sequence="smoke", uut_model=model)
    bias = next(f for f in result.results.units[0].findings if f.quantity == "K0")
    assert -4e-3 < bias.value < -0.5e-3


def test_several_units_share_one_run_each_with_its_own_findings(tmp_path):
    place = "  b:\n    channel: y\n    mount_angle: 90°\n    temperature: unit_temperature\n    supply: supply\n"
    bench = copy_bench(
        tmp_path / "config",
        ("\nmonitor:\n", f"\n{place}\nmonitor:\n"),
        ("units: {a: uut/quartz_flexure.yaml}", "units: {a: uut/quartz_flexure.yaml, b: uut/quartz_flexure.yaml}"),
        ("supply_current: {min: 30 mA, max: 110 mA}", "supply_current: {min: 60 mA, max: 150 mA}"),
        ("current: {max: 200 mA}", "current: {max: 300 mA}"),
    )
    sequence = tmp_path / "two.yaml"
    text = (ROOT / "sequences" / "smoke.yaml").read_text("utf-8").replace("120 mA", "200 mA")
    sequence.write_text(text, "utf-8")
    result = run_short(tmp_path / "runs", bench=bench, sequence=str(sequence), units=("a=QF-1", "b=QF-2"))
    assert result.results.verdict == "PASS", result.problems
    assert [(unit.place, unit.uut) for unit in result.results.units] == [("a", "QF-1"), ("b", "QF-2")]
    for comparison in compare_one(result.path, read_json(result, "results.json")):
        assert abs(comparison.ratio) < 4, comparison
    assert "K1:temperature_slope_unknown" in texts(result.results.units[1].flags)
    assert result.path.name.endswith("_two_QF-1-QF-2")


def test_a_reading_in_the_dead_band_is_flagged_and_the_run_incomplete(tmp_path):
    """Without the angle offset and with a bias that cancels the converter's zero, two positions give no pulses."""
    model = tmp_path / "unit.yaml"
    text = (ROOT / "config" / "uut" / "quartz_flexure.yaml").read_text("utf-8")
    for old, new in (
        ("at_reference: 0.8 mg", "at_reference: 0 mg"), ("zero: 2 pulse/s", "zero: 0 pulse/s"),
        ("misalignment_o: 0.3 mrad", "misalignment_o: 0 mrad"), ("dead_band: 20 nA", "dead_band: 2 µA"),
    ):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    model.write_text(text, "utf-8")
    result = run_short(tmp_path / "runs", sequence="smoke", uut_model=model, settings=("angle_offset=0°",))
    (unit,) = result.results.units
    assert result.results.verdict == "INCOMPLETE"
    assert "steps/temperature=20/position=0/acquire: dead_band" in texts(unit.flags)
    assert "dwell 0 incomplete: 0, 180" in texts(unit.flags)


def test_the_full_default_cycle_is_what_the_method_says():
    from bench.app.request import RunRequest, prepare

    prepared = prepare(RunRequest("tumble_static"))
    ramps = [planned.step.temperature_c for planned in prepared.plan.steps if planned.id.endswith("/ramp")]
    assert ramps == [*range(20, 71, 10), *range(60, -41, -10), *range(-30, 21, 10)]
    assert len(ramps) - 1 == 22
    assert SHORT


def test_a_mistake_in_a_reduction_ends_a_run_that_says_so(tmp_path, monkeypatch):
    def slip(_self):
        raise ZeroDivisionError("float division by zero")

    monkeypatch.setattr(StoredRun, "evaluate", slip)
    result = run_short(tmp_path, sequence="smoke")
    manifest = read_json(result, "manifest.json")
    assert (manifest["state"], manifest["verdict"], result.outcome.how) == ("error", "ERROR", "error")
    assert "an internal error of this program" in result.problems[0]
    assert "float division by zero" in result.problems[0]


def test_a_store_that_fails_is_told_once(tmp_path, monkeypatch):
    append, commits, message = RunWriter._append, [], []

    def full(self, group):
        commits.append(group)
        if len(commits) > 5:
            raise OSError(28, "No space left on device")
        append(self, group)

    class Told(Quiet):
        def notice(self, text):
            message.append(text)

    monkeypatch.setattr(RunWriter, "_append", full)
    result = execute.execute(prepare(RunRequest("smoke", runs=tmp_path, no_report=True)), Told())
    assert [text for text in result.problems if "No space left" in text] == result.problems[:1]
    assert [text for text in message if "No space left" in text] == result.problems[:1]


def test_results_that_cannot_be_written_are_no_pass(tmp_path, monkeypatch):
    write = RunDirectory.write_json

    def full(self, name, content):
        if name == "results.json":
            raise StoreError("the disk is full")
        write(self, name, content)

    monkeypatch.setattr(RunDirectory, "write_json", full)
    result = run_short(tmp_path, sequence="smoke")
    assert (result.results.verdict, read_json(result, "manifest.json")["verdict"]) == ("ERROR", "ERROR")


def test_the_bench_is_held_until_it_is_safe_and_free_while_the_report_is_written(tmp_path, monkeypatch):
    address = Address.parse(f"tcp://10.0.0.2:{2000 + os.getpid() % 7_990}")
    in_use = []
    run_plan = execute.run_plan

    def look(*_: object) -> None:
        try:
            with address_lock([address], "the next run"):
                in_use.append("")
        except InUseError as problem:
            in_use.append(str(problem).partition(", process")[0])

    async def looked_at(*arguments, **options):
        look()
        try:
            return await run_plan(*arguments, **options)
        finally:
            look()

    monkeypatch.setattr(execute, "real_addresses", lambda _bench: {"head": address})
    monkeypatch.setattr(execute, "run_plan", looked_at)
    monkeypatch.setattr("bench.report.write.write_report", look)
    assert run_short(tmp_path, sequence="smoke", no_report=False).problems == []
    held = f"{address} is in use by a run of smoke"
    assert in_use == [held, held, ""]
