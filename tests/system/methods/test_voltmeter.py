"""Runs with a voltmeter across a load that the unit's current flows through, and what is told of a wrong bench."""

import pytest

from bench.config.bench import load_bench
from bench.errors import InputError
from bench.store.reader import RunReader
from tests.support.runs import copy_bench, run_short
from tests.support.sequences import TAIL, steps

HEAD = "# Named readings of the devices: what a sequence soaks on, waits for and records.\nreadings:\n"
DEVICE = """  dvm:
    driver: keysight_3458a
    connection: sim+tcp://127.0.0.1:1234
    options: {range: 1 V}
    identity: {model: 3458A, serial: US28031234}
    calibration:
      {certificate: SIM-2026-0105, laboratory: none, date: 2026-01-01, due: 2030-12-31, k: 2,
       U: {gain: U_GAIN, offset: 2 µV}}

# Named readings of the devices: what a sequence soaks on, waits for and records.
readings:
  output: {from: dvm.voltage, stale_after: 30 s}
"""
CONNECTED = "  voltmeters: {dvm: {place: a, load: 500 Ω, noise: 0.1 µV}}\n  ambient:"
ON = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"
LEVEL = ("{move: head, to: 0°}", "{wait: 10 s}", "{measure: output, for: 30 s, as: level}")
UP = ("{move: head, to: 90°}", "{wait: 10 s}", "{measure: output, for: 30 s, as: up}")


def bench_with_voltmeter(folder, connected=CONNECTED, gain="8 ppm"):
    device = DEVICE.replace("U_GAIN", gain)
    return copy_bench(folder, (HEAD, device), ("  ambient:", connected))


def measured(tmp_path, **settings):
    bench = bench_with_voltmeter(tmp_path / "config", **settings)
    path = tmp_path / "s.yaml"
    path.write_text(
        steps(ON, *LEVEL, *UP) + "teardown:\n  - {set: supply, output: off}\n" + TAIL + "  output: reading\n", "utf-8"
    )
    result = run_short(tmp_path / "runs", sequence=str(path), bench=bench)
    assert result.problems == []
    with RunReader(result.path) as reader:
        ends = [event.data for event in reader.events("step_ended")]
        return {end["as"]: end["value"] for end in ends if "as" in end}, reader.series("output")


def test_the_voltage_is_the_units_current_times_the_load(tmp_path):
    values, series = measured(tmp_path)
    assert values["up"] - values["level"] == pytest.approx(1.13e-3 * 500, rel=1e-3)
    assert abs(values["level"]) < 2e-3  # its bias and misalignment
    assert len(series.values) > 5


def test_its_gain_error_is_drawn_from_its_certificate(tmp_path):
    small, _ = measured(tmp_path / "small")
    large, _ = measured(tmp_path / "large", gain="1 %")
    assert 1e-4 < abs((large["up"] - large["level"]) / (small["up"] - small["level"]) - 1) < 0.015


@pytest.mark.parametrize(
    ("connected", "problem"),
    [
        (CONNECTED.replace("dvm:", "dwm:"), "'dwm' is not a voltmeter; did you mean 'dvm'?"),
        (CONNECTED.replace("dvm:", "head:"), "'head' is not a voltmeter; expected dvm"),
        (CONNECTED.replace("place: a", "place: b"), "there is no place 'b'; expected a"),
        (CONNECTED.replace("500 Ω", "500 V"), "load: is in V, expected a quantity in Ω"),
    ],
)
def test_what_it_is_connected_to_must_be_there(tmp_path, connected, problem):
    with pytest.raises(InputError) as caught:
        load_bench(bench_with_voltmeter(tmp_path / "config", connected))
    assert problem in str(caught.value)


def test_a_simulated_voltmeter_is_connected_to_something(tmp_path):
    with pytest.raises(InputError, match=r"nothing is connected to 'dvm': add it to simulation\.voltmeters"):
        measured(tmp_path, connected="  ambient:")
