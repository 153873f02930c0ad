"""Outputs regressed to the nominal temperature, by hand; thermometers of single sensors; the temperature circuit."""

import dataclasses

import numpy as np
import pytest

from bench.methods.imu.reduction.knots import TemperatureTable
from bench.methods.imu.reduction.regressed import Regressed, nominal_output
from bench.methods.imu.reduction.run import reduce
from bench.metrology.calibration.nominal_output import NominalOutput
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.results.curves import KnotModel
from bench.metrology.run_data import RunData, TemperatureCircuit
from tests.support.flags import texts
from tests.unit.methods.imu.test_imu_windows import BENCH, SETTINGS, UNIT, block, record

KNOTS_C, ZERO, SCALE = (0.0, 10.0, 30.0), (10.0, 20.0, 35.0), (1000.0, 1010.0, 1006.0)
OWN = {f"acc_{axis}": f"a{axis}" for axis in "xyz"} | {f"gyro_{axis}": f"w{axis}" for axis in "xyz"}


def regressed(nominal_c=10.0, *, own=(0.1, 0.2), visits=(1, 2, 1), sign=1.0):
    table = TemperatureTable(np.array(KNOTS_C), np.array(ZERO), sign * np.array(SCALE))
    return Regressed(table, nominal_c, 2.0, *own, np.array(visits))


def test_the_change_of_an_output_is_the_largest_at_either_input():
    value, u, _ = regressed().change()
    assert value == pytest.approx(30.0)  # at 0 °C and +2: 10 + 2000 against 20 + 2020
    assert u == pytest.approx(np.sqrt(2) * np.hypot(0.1, 2 * 0.2))
    assert regressed(sign=-1.0).change()[0] == pytest.approx(30.0)  # at 0 °C and -2


def test_what_is_left_is_the_error_of_an_inner_knot_by_the_others_at_the_nominal_temperature():
    """Between 0 and 30 °C the zero would be 55/3 at 10 °C, and the scale factor 1002."""
    errors = [((20 + 1010 * v - 55 / 3) / 1002 - v) * 1010 for v in (2, -2)]
    assert regressed().left()[0] == pytest.approx(max(map(abs, errors)))
    at_0_c = [error / 1010 * 1000 for error in errors]
    assert regressed(0.0).left()[0] == pytest.approx(max(map(abs, at_0_c)))


def test_a_nominal_temperature_beyond_the_knots_is_none():
    assert not regressed(31.0).is_known
    assert not regressed(float("nan")).is_known
    assert nominal_output(regressed(31.0), "acc", {}) is None


def test_the_uncertainty_for_a_user_is_of_scatter_visits_and_the_course_between_knots():
    found = nominal_output(regressed(), "acc", {"K0/repeatability": 3e-3, "K1/interpolation": 4e-3})
    assert found.offset_u == pytest.approx((0.1, 0.1 / np.sqrt(2), 0.1))
    assert found.scale_u == pytest.approx((0.2, 0.2 / np.sqrt(2), 0.2))
    assert found.offset_beside_u == pytest.approx(np.sqrt((3e-3 * 1010) ** 2 - 2 * 0.1**2) / np.sqrt(3))
    assert found.scale_beside_u == pytest.approx(np.sqrt((4e-3 * 1010) ** 2 - 1.5 * 0.2**2) / 4 / np.sqrt(3))
    assert nominal_output(regressed(), "acc", {"K0/repeatability": 1e-9}).offset_beside_u == 0  # less than scatter


def compensation(nominal):
    scale, offset = (
        KnotModel("", "", "", unit, KNOTS_C, values, (1.0,) * 3)
        for unit, values in (("pulse/s/g", SCALE), ("pulse/s", ZERO))
    )
    return Compensation("acc_x", "pulse/s", "g", scale, offset, nominal=nominal)


def test_differences_whose_square_is_no_float_make_the_uncertainty_infinite():
    for what in ("repeatability", "interpolation"):
        assert nominal_output(regressed(), "acc", {f"K0/{what}": 1e200}).offset_beside_u == np.inf


def test_an_output_is_regressed_with_the_uncertainty_of_the_difference_from_the_nominal_temperature():
    known = compensation(NominalOutput(10.0, (0.1, 0.2, 0.3), (1.0, 2.0, 3.0), 0.05, 0.5))
    output, at_c = np.array([15 + 1005 * 0.5, 20 + 1010 * 0.5, 35.0]), np.array([5.0, 10.0, 60.0])
    value, u, outside = known.regressed(output, at_c, 10.0)
    assert value == pytest.approx([525.0, 525.0, 20.0])
    halves = np.hypot(0.1, 0.2) / 2
    assert u[0] == pytest.approx(np.sqrt(halves**2 + 0.05**2 + 0.5**2 * ((10 * halves) ** 2 + 0.5**2)))
    assert u[1] == pytest.approx(np.hypot(0.05, 0.25))  # what differs from visit to visit alone
    assert u[2] == pytest.approx(np.hypot(np.hypot(0.2, 0.3), 0.05))
    assert outside.tolist() == [False, False, True]
    assert np.isnan(known.regressed(output, at_c, 10.0, "reject")[0]).tolist() == [False, False, True]
    assert np.isnan(compensation(None).regressed(output, at_c, 10.0)[1]).all()


def warmed(acquisitions, **celsius):
    """Windows with readings of more thermometers, each as much above that of the unit, or as a function of it."""
    for each in acquisitions:
        common_c = each.temperatures_c["t"]
        own = {name: of(common_c) for name, of in celsius.items()}
        yield dataclasses.replace(
            each, temperatures_c={"t": common_c, **own}, temperatures_at_s=dict.fromkeys(["t", *own], np.arange(3.0))
        )


def reduced(acquisitions, unit, nominal_c=None):
    data = RunData("imu", (unit,), tuple(acquisitions), record(BENCH))
    (found,) = reduce(data, SETTINGS | {"nominal_c": nominal_c})
    return found


@pytest.fixture(scope="module")
def acquisitions():
    return block(BENCH, "s/hot", "xyz") + block(BENCH, "s/cold", "xyz")


def above(by_c):
    return lambda common_c: common_c + by_c


def test_each_sensor_has_the_temperature_of_its_own_thermometer_or_of_its_triad(acquisitions):
    unit = dataclasses.replace(UNIT, temperatures={"acc_x": "ax", "gyro_z": "wz"})
    found = reduced(warmed(acquisitions, ax=above(1), wz=above(-2)), unit)
    knots = {each.channel: (each.thermometer, each.scale.knots_c) for each in found.compensations}
    assert knots["acc_x"] == ("ax", (21, 51))
    assert knots["acc_y"] == knots["gyro_x"] == ("t", (20, 50))
    assert knots["gyro_z"] == ("wz", (18, 48))
    at_c = {(each.quantity, each.at["axis"]): each.at["temperature_c"] for each in found.findings
            if each.at.get("visit") == 0}  # fmt: skip
    assert (at_c["K0", "x"], at_c["K0", "y"], at_c["D0", "z"]) == (51, 50, 48)


def test_the_budget_names_the_thermometer_of_the_sensor(acquisitions):
    bench = dataclasses.replace(record(BENCH), thermometers_u={"ax": (0.5, 0.0), "t": (0.1, 0.0)})
    unit = dataclasses.replace(UNIT, temperatures={"acc_x": "ax"})
    once = [each for each in acquisitions if each.group == "s/hot"]  # its slope is that of the settings
    data = RunData("imu", (unit,), tuple(warmed(once, ax=above(0))), bench)
    found = {
        (each.quantity, each.at["axis"]): each for each in reduce(data, SETTINGS)[0].findings if "visit" in each.at
    }
    for axis, name, u_c in (("x", "ax", 0.5), ("y", "t", 0.1)):
        finding = found["K1", axis]
        assert finding.at["temperature_u_c"] == u_c
        assert any(line.source.startswith(f"{name}: ") for line in finding.budget)


def test_a_thermometer_that_came_off_is_told_and_one_beside_its_sensor_is_not(acquisitions):
    unit = dataclasses.replace(UNIT, temperatures={"acc_x": "ax", "acc_y": "ay"})
    found = reduced(warmed(acquisitions, ax=above(-3), ay=lambda common_c: np.full_like(common_c, 22.0)), unit)
    told = [flag for flag in texts(found.flags) if "its triad" in flag]
    assert told == ["the thermometer of acc_y is up to 25.0 °C from those of its triad; is it at its sensor?"]


def test_a_nominal_temperature_that_was_not_reached_is_told(acquisitions):
    found = reduced(acquisitions, UNIT, 60.0)
    assert any("nominal temperature is beyond the temperatures of acc_x" in flag for flag in texts(found.flags))
    assert not any(each.quantity[:2] in ("N/", "W/") for each in found.findings)
    assert all(each.nominal is None for each in found.compensations)
    assert len(found.compensations) == 6


CIRCUIT = TemperatureCircuit("circuit", "Hz", "t", nominal=8000.0, at_c=25.0, slope=20.0)


@pytest.mark.parametrize("slope", [20.5, -20.0])
def test_the_output_of_the_circuit_at_the_nominal_temperature_and_its_deviation(acquisitions, slope):
    unit = dataclasses.replace(UNIT, circuit=CIRCUIT)
    warm = warmed(acquisitions, circuit=lambda at_c: 8010 + slope * (at_c - 25))
    found = {each.quantity: each for each in reduced(warm, unit, 35.0).findings}
    nominal, deviation = found["circuit/nominal"], found["circuit/deviation"]
    assert (nominal.value, nominal.unit) == (pytest.approx(8010 + slope * 10), "Hz")
    assert nominal.at["temperature_c"] == 35
    told_c = 25 + (10 + slope * 25) / 20
    assert (deviation.value, deviation.unit) == (pytest.approx(told_c - 50), "°C")  # at the first set point
    assert deviation.at["temperature_c"] == 50


def test_the_uncertainty_of_the_circuit_is_that_of_the_thermometer_by_its_slope(acquisitions):
    bench = dataclasses.replace(record(BENCH), thermometers_u={"t": (0.1, 0.0)})
    warm = warmed(acquisitions, circuit=lambda at_c: 8000 + 20 * (at_c - 25))
    data = RunData("imu", (dataclasses.replace(UNIT, circuit=CIRCUIT),), tuple(warm), bench)
    found = {each.quantity: each.u for each in reduce(data, SETTINGS)[0].findings}
    assert found["circuit/nominal"] == pytest.approx(2.0)
    assert found["circuit/deviation"] == pytest.approx(0.1)


def test_a_circuit_in_degrees_needs_no_characteristic_and_one_without_has_no_deviation(acquisitions):
    def of(circuit, output):
        found = reduced(warmed(acquisitions, circuit=output), dataclasses.replace(UNIT, circuit=circuit)).findings
        return {each.quantity: each.value for each in found if each.quantity.startswith("circuit")}

    celsius = TemperatureCircuit("circuit", "°C", "t")
    assert of(celsius, above(0.3)) == {"circuit/nominal": pytest.approx(50.3), "circuit/deviation": pytest.approx(0.3)}
    assert of(TemperatureCircuit("circuit", "Hz", "t"), above(8000)) == {"circuit/nominal": pytest.approx(8050)}
    assert of(CIRCUIT, lambda at_c: np.full_like(at_c, np.nan)) == {}
