import numpy as np
import pytest
from pydantic import ValidationError

from simulators.instruments.meters.meter_inputs import VoltsOnLoad
from simulators.physics.input_hysteresis import Play
from simulators.physics.voltmeter import VoltmeterSettings
from simulators.truth.constants import DwellAsMeasured, Orientation, truth_record
from simulators.units.imu_file import ImuAccelerometer
from tests.support.laboratory import Laboratory, place, unit

THRESHOLDS = ["1 mg", "2 mg"]
HYSTERETIC = unit(accelerometer={"input_hysteresis": {"amplitude": "30 µg", "thresholds": THRESHOLDS}})


def moved(lab: Laboratory, *targets_deg: float) -> None:
    """The head goes to one angle after the other, and comes to rest there."""
    for target_deg in targets_deg:
        lab.world.move(target_deg, 20.0)
        lab.wait(20.0)


def added_ug(*targets_deg: float) -> float:
    """What the way to the last angle adds to the bias, as the pulses have it."""
    readings = []
    for file in (HYSTERETIC, unit()):
        lab = Laboratory(place(unit=file))
        counter = lab.counter()
        lab.world.power("supply", True)
        moved(lab, *targets_deg)
        counter.take()
        readings.append(lab.rate_pps(gate_s=1000.0))
    return (readings[0] - readings[1]) / 1e4 * 1e6


def test_the_operators_follow_a_path_worked_by_hand() -> None:
    # in mg:        a       0.5    3    2.5     0    -5     0
    # y(1), y(2)          0  0    2 1   2  1   1  1  -4 -3  -1 -2
    # (a-y)1+(a-y)2      .5+.5   1+2  .5+1.5  -1-1  -1-2   1+2
    path = np.array([0.0, 0.5, 3, 2.5, 0, -5, 0])
    assert Play(30.0, (1.0, 2.0)).follow(path) == pytest.approx([0, 10, 30, 20, -20, -30, 30])


def test_it_is_one_path_in_whatever_parts_it_is_followed() -> None:
    path = np.cumsum(np.random.default_rng(1).standard_normal(200))
    whole, parts = Play(30.0, (1.0, 2.0)), Play(30.0, (1.0, 2.0))
    assert np.concatenate([parts.follow(each) for each in np.split(path, 20)]).tolist() == whole.follow(path).tolist()


def test_an_angle_from_above_differs_from_the_same_from_below_in_what_is_counted() -> None:
    below, above = added_ug(-1.0, 0.1), added_ug(-1.0, 1.0, 0.1)  # 1° is 17 mg, far beyond the thresholds
    assert (below, above) == (pytest.approx(30, abs=0.2), pytest.approx(-30, abs=0.2))


def test_it_does_not_depend_on_stops_or_on_the_rate() -> None:
    assert added_ug(-1.0, -0.5, -0.2, 0.0, 0.05) == pytest.approx(added_ug(-1.0, 0.05), abs=0.2)


@pytest.mark.parametrize(("on_the_way_deg", "side"), [((), 1), ((1.0,), -1), ((1.0, -1.0), 1)])
def test_turning_points_count_though_the_voltmeter_did_not_look_there(
    on_the_way_deg: tuple[float, ...], side: int
) -> None:
    lab = Laboratory(place(unit=HYSTERETIC, channel=""))
    lab.world.power("supply", True)
    load = VoltsOnLoad(lab.world, VoltmeterSettings(place="a", load_ohm=1e3), "dvm")
    moved(lab, -1.0, *on_the_way_deg, 0.0)
    begin_s = lab.world.now()
    assert load.mean(begin_s, lab.wait(1.0)) == pytest.approx(side * 30e-6, abs=1e-10)  # 1 mA/g in 1 kΩ is 1 V/g


def test_the_truth_of_a_dwell_has_the_history_of_each_of_its_readings() -> None:
    lab = Laboratory(place(unit=HYSTERETIC))
    counter = lab.counter()
    lab.world.power("supply", True)
    moved(lab, -1.0)
    angles, each_s = (0.0, 90.0, 180.0, 270.0), []
    for angle in angles:
        moved(lab, angle)
        counter.take()
        each_s.append(lab.host_s)
        lab.wait(60.0)
        counter.take()
    dwell = DwellAsMeasured(
        "d", "a", float(np.mean(each_s)), 20.0, tuple(Orientation((a,)) for a in angles), tuple(each_s)
    )
    found = truth_record(lab.world, [dwell])["dwells"]["d"]
    assert found["by_input_g"] == pytest.approx([30e-6, 30e-6, -30e-6, -30e-6], abs=1e-9)
    assert (found["K0"], found["misalignment"]) == (pytest.approx(0, abs=1e-9), pytest.approx(30e-6, rel=1e-3))
    assert found["K1"] == pytest.approx(10_000 * (1 + 30e-6), rel=1e-9)


def test_an_inertial_unit_with_it_is_refused_instead_of_simulated_without() -> None:
    with pytest.raises(ValidationError, match="input_hysteresis is simulated for single accelerometers only"):
        ImuAccelerometer.model_validate({
            "K0": {"at_reference": "0 g"}, "K1": {"at_reference": "1 mA/g"},
            "converter": {"S": "10 kHz/mA", "full_scale": "25 mA", "max_rate": "256 kHz"},
            "input_hysteresis": {"amplitude": "1 µg", "thresholds": ["1 mg"]},
        })  # fmt: skip
