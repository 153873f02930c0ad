"""Thermometers at the sensors of an inertial unit, and its temperature circuit, in a bench file."""

import pytest

from bench.app.can_nodes import thermometers_at
from bench.config.bench import load_bench
from bench.errors import InputError
from bench.reduce.acquisitions import _unit
from tests.support.runs import ROOT

SHIPPED = (ROOT / "config/imu_thermometers.yaml").read_text("utf-8")
CIRCUIT = "circuit: {output: temperature_circuit, nominal: 8000 Hz, at: 25 °C, slope: 20 Hz/°C}"
FIRST = "Ax: ax_temperature"


@pytest.fixture
def folder(tmp_path):
    for name in ("imu_thermometers.dbc", "uut/imu_gradients.yaml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text((ROOT / "config" / name).read_text("utf-8"), "utf-8")
    return tmp_path


def loaded(folder, old="", new=""):
    assert old in SHIPPED
    path = folder / "bench.yaml"
    path.write_text(SHIPPED.replace(old, new, 1) if old else SHIPPED, "utf-8")
    return load_bench(path).bench


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (FIRST, "Ax: ax_temprature", "there is no reading 'ax_temprature'; did you mean 'ax_temperature'?"),
        (FIRST, "Bx: ax_temperature", "Bx: unknown key; expected Ax, Ay, Az, Wx, Wy or Wz"),
        (FIRST, "Ax: temperature_circuit", "'temperature_circuit' is not a temperature"),
        ("      {Ax: ax_temperature, Ay: ay_temperature, Az: az_temperature, Wx: wx_temperature, Wy: wy_temperature,\n"
         "       Wz: wz_temperature}", "      {}", "needs at least one of Ax, Ay, Az, Wx, Wy, Wz"),
        (CIRCUIT, "circuit: {output: circuit_temperature}", "there is no reading 'circuit_temperature'"),
        (CIRCUIT, "circuit: {output: temperature_circuit, reference: temperature_circuit}",
         "'temperature_circuit' is not a temperature"),
        (CIRCUIT, "circuit: {output: temperature_circuit}", "is in Hz: its temperature needs nominal, at and slope"),
        (CIRCUIT, "circuit: {output: unit_temperature}", "'unit_temperature' is the thermometer that it is compared"),
        ("nominal: 8000 Hz", "nominal: 8 V", "is 8 V, expected a quantity in Hz, as 'temperature_circuit' is in Hz"),
        ("slope: 20 Hz/°C", "slope: 20 Hz", "expected a quantity in Hz/°C, as 'temperature_circuit' is in Hz"),
        ("slope: 20 Hz/°C", "slope: 0 Hz/°C", "slope is 0, expected the change of the output with 1 °C"),
        (", at: 25 °C", "", "needs nominal, at and slope together, or none of them"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_told(folder, old, new, problem):
    with pytest.raises(InputError) as told:
        loaded(folder, old, new)
    assert problem in str(told.value)


def test_both_are_for_inertial_units_only(folder):
    begin = SHIPPED.index("    channels: {acc_x")
    end = SHIPPED.index("    temperature: unit_temperature")
    for part in ("circuit", "temperatures"):
        kept = (
            SHIPPED[:begin]
            + "    channel: ax\n"
            + SHIPPED[end:].replace("    gyro_temperature: gyro_temperature\n", "")
        )
        other = "temperatures" if part == "circuit" else "circuit"
        lines = kept.splitlines(keepends=True)
        start = next(i for i, line in enumerate(lines) if line.startswith(f"    {other}:"))
        del lines[start : start + (3 if other == "temperatures" else 1)]
        (folder / "bench.yaml").write_text("".join(lines), "utf-8")
        with pytest.raises(InputError, match=f"{part} is for a unit with channels"):
            load_bench(folder / "bench.yaml")


def test_a_sensor_without_a_thermometer_has_that_of_its_triad(folder):
    bench = loaded(folder, "Wz: wz_temperature", "Wz: ax_temperature")
    bench = bench.model_copy(update={"places": {"a": bench.places["a"]}})
    own = bench.places["a"].at_sensors
    assert own["acc_x"] == own["gyro_z"] == "ax_temperature"
    partly = loaded(folder, "Ay: ay_temperature, ", "").places["a"]
    assert partly.at_sensors["acc_y"] == "unit_temperature"
    without = loaded(folder, "    gyro_temperature: gyro_temperature\n", "")
    lone = without.model_copy(update={"places": {"a": without.places["a"].model_copy(update={"temperatures": None})}})
    assert set(lone.places["a"].at_sensors.values()) == {"unit_temperature"}
    assert _unit("a", "S", lone, 1.0).thermometer("gyro_x") == "unit_temperature"


def test_all_readings_of_a_unit_are_recorded_and_simulated_where_they_are(folder):
    bench = loaded(folder)
    unit = _unit("a", "S", bench, 1.0)
    assert {"ax_temperature", "wz_temperature", "temperature_circuit", "unit_temperature"} <= set(unit.thermometers)
    assert unit.circuit.unit == "Hz"
    at = thermometers_at(bench.places["a"])
    assert (at["ax_temperature"], at["wz_temperature"]) == ("acc_x", "gyro_z")
    assert (at["unit_temperature"], at["temperature_circuit"]) == ("accelerometers", "circuit")
    shared = thermometers_at(loaded(folder, FIRST, "Ax: unit_temperature").places["a"])
    assert shared["unit_temperature"] == "accelerometers"
