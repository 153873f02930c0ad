"""Whole runs whose units send their outputs themselves, by the same sequences as those that are measured."""

import pytest

from bench.app.request import RunRequest, prepare
from bench.config.bench import load_bench
from bench.errors import InputError
from bench.methods.tumble.method import TEMPERATURE_TUMBLE
from bench.methods.tumble.reduction.run import reduce
from bench.reduce.stored_run import open_run
from campaigns.truth.campaign import compare, full_bench
from campaigns.truth.indexing import QUANTITIES, compare_indexing
from campaigns.truth.ramp import compare_ramp
from tests.support.flags import texts
from tests.support.runs import ROOT, SHORT, read_json, run_short
from tests.support.sequences import plan_of, problems_of, steps

TELEMETRY = load_bench(ROOT / "config/telemetry.yaml").bench
ONE_DWELL = ("temperatures=[20 °C]", "warm_up=0 s", "soak=30 min", "gate=10 s")
RAMP = ("low=10 °C", "high=40 °C", "ramp_rate=3 °C/min")  # shorter legs are nothing but turns
# One dwell has no slope over temperature.
SURE = ("telemetry.yaml", "U: {offset: 0.6 °C, gain: 0.2 %, drift: 0.12 °C}", "U: {offset: 0 °C}")
ON = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"
TAIL = """\
teardown:
  - {move: head, to: 0°}
  - {set: supply, output: off}
schema: itb-sequence/1
title: Test
needs: {output: output, head: positioner, supply: power_supply}
"""
TUMBLE = [
    line
    for deg in (0, 90, 180, 270)
    for line in (f"{{move: head, to: {deg}°}}", "{acquire: output, for: 60 s, label: tumble}")
]
RESULT = "results:\n  - {method: temperature_tumble, data: tumble, settings: {degree: 1}, limits: {K1: {min: LIMIT}}}\n"


def edited(folder, *edits, faults=""):
    """The bench with telemetry in a folder of its own, its files edited."""
    path = full_bench(folder, "telemetry")
    for file, old, new in edits:
        text = (folder / file).read_text("utf-8")
        assert old in text, old
        (folder / file).write_text(text.replace(old, new), "utf-8")
    if faults:
        path.write_text(path.read_text("utf-8") + f"  faults: {faults}\n", "utf-8")
    return path


def by_quantity(run):
    return {finding["quantity"]: finding for finding in read_json(run, "results.json")["findings"]}


@pytest.fixture(scope="module")
def tumble(tmp_path_factory):
    folder = tmp_path_factory.mktemp("telemetry")
    run = run_short(folder / "runs", bench=edited(folder / "config"), settings=SHORT, no_report=False)
    (folder / "config" / "telemetry.dbc").unlink()  # the run has kept its own
    return run


# The methods


def test_a_tumble_of_codes_finds_the_truth(tumble):
    assert tumble.problems == []
    comparisons = compare([tumble.path])
    assert len(comparisons) == 15
    assert max(abs(comparison.ratio) for comparison in comparisons) < 3.5
    found = by_quantity(tumble)
    assert (found["K1"]["unit"], found["K1_si"]["unit"], found["K0"]["unit"]) == ("code/g", "code/(m/s²)", "g")
    assert found["K1"]["value"] == pytest.approx(400_000, rel=5e-3)


def test_a_unit_that_sends_has_no_instrument_but_itself_in_its_budgets(tumble):
    found = by_quantity(tumble)
    for quantity in ("K0", "K1"):
        sources = [line["source"] for line in found[quantity]["budget"]]
        assert "readings: scatter pooled over the run" in sources
        assert not [source for source in sources if source.startswith(("counter", "x:"))], (
            "noise carries over the steps"
        )


def test_a_run_is_reduced_by_the_dbc_that_it_kept(tumble):
    with open_run(tumble.path) as run:
        data = run.data("tumble")
    (unit,) = reduce(data, TEMPERATURE_TUMBLE.settings.model_validate({"degree": 1}).model_dump())
    values = {finding.id: finding.value for finding in unit.findings if finding.quantity == "K1"}
    stored = {each["id"]: each["value"] for each in read_json(tumble, "results.json")["findings"]}
    assert values.items() <= stored.items()
    codes = data.acquisitions[0].codes["x"]
    assert (len(codes.values), codes.lost, codes.step) == (500, 0, 1.0)


def test_the_report_tells_codes(tumble):
    page = (tumble.path / "report.html").read_text("utf-8")
    for words in ("K1 relative to 4", "code/g", "Telemetry x", "samples in 24 acquisitions, 0 lost"):
        assert words in page
    assert "pulse/s/g" not in page


def test_coarse_codes_are_as_uncertain_as_their_steps(tmp_path):
    """Of 100 µg, and noise of 10 µg that does not carry across them."""
    coarse = (
        ("uut/digital.yaml", "{mean: 354 code/µA, sd: 0.35 code/µA}", "8850 code/mA"),
        ("uut/digital.yaml", "noise: 1 code ", "noise: 0 code "),
        ("uut/digital.yaml", "{mean: 0 code, sd: 200 code}", "0.4 code"),
        ("telemetry.yaml", "400000 code/g", "10000 code/g"),
        ("telemetry.yaml", "          stuck_after: 50\n", ""),
        SURE,
    )
    run = run_short(tmp_path / "runs", bench=edited(tmp_path / "config", *coarse), settings=ONE_DWELL, seed=2)
    found = {each.quantity: each for each in compare([run.path])}
    assert max(abs(each.ratio) for each in found.values()) < 3.5
    lines = {line["source"]: line["u"] for line in by_quantity(run)["K0"]["budget"]}
    assert lines["x: steps of the codes"] == pytest.approx(1e-4 / 12**0.5 / 2**0.5, rel=0.02)  # of two readings
    assert abs(found["K0"].value - found["K0"].truth) > 1e-6, "far more than the samples scatter by"


def test_decoded_values_are_in_the_unit_of_the_dbc(tmp_path):
    decoded = (
        ("telemetry.dbc", 'Code : 0|24@1- (1,0) [-8388608|8388607] ""', 'Code : 0|24@1- (2.5e-6,0.01) [0|0] "g"'),
        ("telemetry.yaml", "          period: 20 ms\n", "          period: 20 ms\n          unit: g\n"),
        ("telemetry.yaml", "400000 code/g", "1 g/g"),
        SURE,
    )
    run = run_short(tmp_path / "runs", bench=edited(tmp_path / "config", *decoded), settings=ONE_DWELL, seed=3)
    assert max(abs(each.ratio) for each in compare([run.path])) < 3.5
    found = by_quantity(run)
    assert (found["K1"]["unit"], found["K0"]["unit"]) == ("g/g", "g")
    assert found["K1"]["value"] == pytest.approx(1.0, rel=5e-3)
    assert found["K0"]["value"] == pytest.approx(0.01, abs=3e-3), "what the DBC adds is in the bias"


def test_a_calibration_on_an_indexing_table_of_codes_finds_the_truth(tmp_path):
    bench = ROOT / "config/indexing_telemetry.yaml"
    settings = ("step=0.5°", "warm_up=20 min")
    run = run_short(tmp_path, bench=bench, sequence="indexing_static", settings=settings, seed=1)
    assert run.problems == []
    comparisons = compare_indexing(run.path)
    assert {comparison.quantity for comparison in comparisons} == set(QUANTITIES) - {"Kio", "misalignment_y"}
    assert max(abs(comparison.ratio) for comparison in comparisons) < 3.5
    assert by_quantity(run)["bias"]["unit"] == "code"


def test_a_ramp_of_codes_finds_the_truth(tmp_path):
    bench = ROOT / "config/telemetry.yaml"
    run = run_short(tmp_path, bench=bench, sequence="ramp_dynamic", settings=RAMP, seed=1)
    assert run.problems == []
    found = {comparison.quantity: comparison for comparison in compare_ramp(run.path)}
    rms = found.pop("K0/model_residual_rms")  # as in volts: K1 is behind the temperature of short legs
    assert max(abs(comparison.ratio) for comparison in found.values()) < 3.5
    assert abs(rms.value - rms.truth) < 1e-6


# What goes wrong


def test_readings_of_a_unit_that_begins_anew_or_does_not_measure_are_left_out(tmp_path):
    """The second position has a restart in it, the last one a converter that has died."""
    faults = "[{device: telemetry, kind: restart, at: 110 s}, {unit: a, kind: dead, at: 230 s}]"
    path = tmp_path / "s.yaml"
    path.write_text(steps(ON, *TUMBLE) + TAIL + RESULT.replace("LIMIT", "1 code/g"), "utf-8")
    run = run_short(tmp_path / "runs", sequence=str(path), bench=edited(tmp_path / "config", faults=faults))
    assert run.outcome.how == "completed"
    (unit,) = run.results.units
    flagged = [flag.rpartition(": ")[2] for flag in texts(unit.flags) if flag.startswith("steps/")]
    assert flagged == ["irregular_clock", "stuck_code"]
    assert [finding.quantity for finding in unit.findings] == []


def test_a_unit_that_falls_silent_ends_the_run(tmp_path):
    faults = "[{device: telemetry, kind: silent, at: 110 s}]"
    path = tmp_path / "s.yaml"
    path.write_text(steps(ON, *TUMBLE) + TAIL, "utf-8")
    run = run_short(tmp_path / "runs", sequence=str(path), bench=edited(tmp_path / "config", faults=faults))
    assert run.outcome.how == "error"
    assert "telemetry: no sample (0x200) for more than 0.5 s during an acquisition" in run.problems[0]


SECOND = """\
        y:
          value: AccY.Code
          tick: AccY.Tick
          tick_period: 10 µs
          sequence: AccY.Sequence
          period: 50 ms
    identity: {serial: SIM-ACC-01}
"""
TWO = (
    ("telemetry.yaml", "    identity: {serial: SIM-ACC-01}\n", SECOND),
    ("telemetry.yaml", "places:\n", "places:\n  b: {telemetry: y, temperature: unit_temperature, supply: supply}\n"),
    ("telemetry.yaml", "{a: uut/digital.yaml}", "{a: uut/digital.yaml, b: uut/digital.yaml}"),
    ("telemetry.yaml", "max: 110 mA}", "max: 200 mA}"),
)


def test_of_two_units_one_that_falls_silent_is_dropped(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(steps(ON.replace("120 mA", "200 mA"), *TUMBLE) + TAIL, "utf-8")
    bench = edited(tmp_path / "config", *TWO, faults="[{unit: b, kind: silent, at: 110 s}]")
    run = run_short(tmp_path / "runs", sequence=str(path), bench=bench, units=("a=A-1", "b=B-1"))
    assert run.outcome.how == "completed"
    with open_run(run.path) as stored:
        (dropped,) = stored.reader.events("unit_dropped")
        codes = [each.codes for each in stored.data("tumble").acquisitions]
    assert dropped.data["place"] == "b"
    assert "no frame of its channel 'y' for" in str(dropped.data)
    assert [len(each["x"].values) for each in codes] == pytest.approx([3000] * 4, abs=1)
    assert len(codes[0]["y"].values) == pytest.approx(1200, abs=1)
    assert len(codes[3]["y"].values) == 0


# What files may say


def test_limits_are_in_the_unit_that_is_sent(tmp_path):
    limits = RESULT.replace("LIMIT", "1 code/g")
    for bench in (TELEMETRY, None):
        plan_of(tmp_path, steps(ON, *TUMBLE), tail=TAIL + limits, bench=bench)
    (problem,) = problems_of(
        tmp_path, steps(ON, *TUMBLE), tail=TAIL + RESULT.replace("LIMIT", "1 V/g"), bench=TELEMETRY
    )
    assert "expected a quantity in code/g" in problem


def test_telemetry_may_be_acquired_by_its_role(tmp_path):
    tail = TAIL.replace("output: output", "telemetry: telemetry")
    plan_of(tmp_path, steps("{acquire: telemetry, for: 5 s, label: a}"), tail=tail, bench=TELEMETRY)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("telemetry: x\n", "telemetry: z\n", "no telemetry has a channel 'z'"),
        ("telemetry: x\n", "telemetry: x\n    channel: x\n", "it has channel and telemetry"),
        ("telemetry: x\n", "channel: x\n", "is for a unit that sends its output, on a channel of telemetry"),
        ("400000 code/g", "2 A/g", "is 2 A/g, expected a quantity in code/g"),
        ("400000 code/g", "0 code/g", "is 0 code/g, expected a quantity other than 0"),
        ("output: 400000 code/g, ", "", "needs K1, or of a unit that sends its output what 1 g changes that by"),
        ("period: 20 ms", "period: 200 µs", "its frames take up to 675000 bit/s, 135 % of the bus"),
        ("places:\n", "places:\n  b: {telemetry: x, temperature: unit_temperature, supply: supply}\n",
         "'x' carries place 'b' already"),
    ],
)  # fmt: skip
def test_a_bench_whose_parts_do_not_fit_is_told(tmp_path, old, new, problem):
    with pytest.raises(InputError) as caught:
        load_bench(edited(tmp_path, ("telemetry.yaml", old, new)))
    assert problem in str(caught.value)


def test_a_simulated_unit_must_send_something(tmp_path):
    bench = edited(tmp_path / "config", ("telemetry.yaml", "uut/digital.yaml", "uut/quartz_flexure.yaml"))
    with pytest.raises(InputError, match="the simulated unit of place 'a' sends no codes: its file needs 'telemetry'"):
        run_short(tmp_path / "runs", bench=bench, settings=ONE_DWELL)


def test_a_stable_output_needs_to_be_known_in_g(tmp_path):
    bench = edited(tmp_path / "config", ("telemetry.yaml", "output: 400000 code/g", "K1: 1 mA/g"))
    path = tmp_path / "s.yaml"
    stable = "{acquire: output, until_stable: {sd: 1 µg, slope: 1 µg/min}, give_up_after: 10 min, label: a}"
    path.write_text(steps(ON, stable) + TAIL, "utf-8")
    with pytest.raises(InputError, match=r"places\.a of the bench file has no nominal output, which makes it of g"):
        prepare(RunRequest(str(path), bench=str(bench), runs=tmp_path))
