"""Gyros on a simulated table, and what a table carries its fixture through."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.can.dbc import Dbc
from drivers.can.options import PositionOptions
from drivers.dialects.can_counter.wire import decode_counts, decode_positions
from simulators.faults.instrument_faults import FaultPlan
from simulators.physics.attitude import EAST, UP, Fixture
from simulators.physics.motion import Axis, AxisErrors
from simulators.physics.profiles import Slew
from simulators.physics.table_kinematics import EARTH_DPS, Level, TableErrors, TableKinematics
from simulators.units.gyro import GyroModel, draw_gyro, noise_of_gyro
from simulators.units.gyro_file import GyroFile
from tests.support.laboratory import LATCH, ROOT, Laboratory, a_counter, format_in, place

TABLE = Fixture((UP,), EAST, UP)
DBC = Dbc((ROOT / "config" / "response.dbc").read_text("utf-8"))
CHANNELS = {"x": {"positive": "Pulses.Positive", "negative": "Pulses.Negative", "sequence": "Pulses.Sequence"}}
POSITIONS = {"table": {"position": "Encoder.Position", "sequence": "Encoder.Sequence"}}


def gyro(**changes):
    return GyroModel.model_validate({"KG": {"at_reference": "1000 pulse/°"}} | changes)


def file(**changes):
    return GyroFile.model_validate(
        {"schema": "itb-uut/1", "title": "G", "gyro": {"KG": {"at_reference": "1000 pulse/°"}} | changes}
    )


def carried(axis=None, **settings):
    axis = axis or Axis(AxisErrors(), 100.0, np.random.default_rng(1))
    defaults = {"level": Level(), "table": TableErrors(), "gravity_mps2": 9.8, "latitude_deg": 30.0}
    return axis, TableKinematics(TABLE, {"table": axis}, **(defaults | settings))


# The gyro


def test_the_output_is_that_of_the_equation():
    truth = draw_gyro(
        gyro(
            KG={"at_reference": "1000 pulse/°", "linear": "100 ppm/°C"}, D0={"at_reference": "0.01 °/s",
            "linear": "1e-3 °/s/°C"}, asymmetry="50 ppm", q3="1e-9 s²/°²", misalignment_o="1 mrad",
            misalignment_p="2 mrad",
            g_sensitivity={"input": "0.1 °/s/g", "pendulous": "0.2 °/s/g", "output": "0.3 °/s/g"},
        ), 1, "a",
    )  # fmt: skip
    rate_dps, force_g = (np.array([-100.0]), np.array([5.0]), np.array([7.0])), tuple(np.ones((3, 1)))
    w = -100.0 + 1e-3 * 5 - 2e-3 * 7
    sensed = w + 0.01 + 1e-3 * 5 + 0.6 + 0.02
    expected = 1000 * (1 + 5e-4) * (1 - 50e-6 + 1e-9 * w**2) * sensed
    assert truth.output_pps(rate_dps, force_g, 25.0, np.array([0.02])) == pytest.approx([expected])
    assert truth.clipped_pps(np.array([-1e9, 5.0])).tolist() == [-400_000, 5]
    opposite = replace(truth, scale_ppd=-truth.scale_ppd)
    assert opposite.clipped_pps(np.array([-1e9, 5.0])).tolist() == [-400_000, 5]
    assert truth.dynamics is None


def test_bandwidth_and_damping_go_together():
    assert draw_gyro(gyro(bandwidth="60 Hz", damping=0.6, delay="1 ms"), 1, "a").dynamics.delay_s == 1e-3
    with pytest.raises(ValidationError, match="go together"):
        gyro(bandwidth="60 Hz")


def test_the_noise_of_a_mean_falls_with_the_root_of_its_time():
    truth = draw_gyro(gyro(noise={"random_walk": "0.6 °/h^0.5", "instability": "1 °/h"}), 1, "a")
    noise = noise_of_gyro(truth, 3, "a")
    means = np.array([noise.mean(np.full(100, 0.04)) for _ in range(400)])
    assert np.std(np.diff(means, axis=1)) / np.sqrt(2) == pytest.approx(0.01 / np.sqrt(0.04), rel=0.03)
    still = noise_of_gyro(replace(truth, random_walk=0.0), 3, "a")
    wander = np.array([still.mean(np.full(10, 1.0))[-1] for _ in range(2000)])
    assert np.std(wander) == pytest.approx(1 / 3600, rel=0.1)


# What the table carries it through


def test_the_axis_of_a_table_turns_with_the_earth_and_with_the_table():
    axis, fixture = carried()
    at_s = np.linspace(5, 6, 11)
    across = EARTH_DPS * np.cos(np.radians(30))
    assert fixture.rate_dps(at_s)[:, 0] == pytest.approx([0, across, EARTH_DPS / 2])
    axis.turn(0.0, -20.0, 1e6)
    assert fixture.rate_dps(at_s)[2] == pytest.approx(np.full(11, EARTH_DPS / 2 - 20))
    assert np.hypot(*fixture.rate_dps(at_s)[:2]) == pytest.approx(np.full(11, across))


@pytest.mark.parametrize("arm_m", [(0.05, 0.03, 0.0), (0.0, -0.5, 0.02)])
def test_a_place_on_a_swinging_table_is_pulled_and_pushed(arm_m):
    axis, fixture = carried()
    axis.swing(0.0, Slew(0.0, 10.0, 100.0), Slew(0.0, 2.0, 20.0), 0.0)
    at_s, step_s = np.linspace(1, 2, 101), 1e-4
    x, y, z = fixture.force_g(at_s, arm_m)
    before, now, after = (np.radians(axis.true_deg(at_s + by)) for by in (-step_s, 0.0, step_s))
    w, change = (after - before) / (2 * step_s), (after - 2 * now + before) / step_s**2
    assert x * 9.8 == pytest.approx(-(w**2) * arm_m[0] - change * arm_m[1], abs=2e-4)  # equations 5.5 (8)
    assert y * 9.8 == pytest.approx(-(w**2) * arm_m[1] + change * arm_m[0], abs=2e-4)
    assert z == pytest.approx(np.ones(101))


def test_tilts_of_the_base_and_wobble_let_gravity_in_once_a_turn_and_twice():
    axis, fixture = carried(table=TableErrors(across_deg=0.02), level=Level(0.01))
    axis.turn(0.0, 36.0, 1e6)
    at_s = np.linspace(20, 30, 401)[:-1]
    x = np.degrees(fixture.upward(at_s)[0])
    once = 2 * np.mean(x * np.exp(-2j * np.pi * (at_s - 20) / 10))
    assert abs(once) == pytest.approx(np.hypot(0.01, 0.02), rel=1e-4)
    axis, fixture = carried(table=TableErrors(wobble_deg=0.02, wobble_phase_rad=0.5))
    axis.turn(0.0, 36.0, 1e6)
    x = np.degrees(fixture.upward(at_s)[0])
    assert abs(2 * np.mean(x * np.exp(-4j * np.pi * (at_s - 20) / 10))) == pytest.approx(0.01, rel=1e-3)
    assert abs(np.mean(x)) == pytest.approx(0.01 * np.cos(0.5), rel=1e-3)


# On a table, through the counter


def on_a_table(unit, **settings):
    given = {"unit": unit, "mount_angle_deg": 90.0} | settings.pop("place", {})
    lab = Laboratory(place(**given), axes={"table": AxisErrors()}, fixture=TABLE, **settings)
    lab.world.power("supply", True)
    form = format_in(DBC, LATCH, CHANNELS, POSITIONS)
    encoders = {"table": PositionOptions.model_validate({**POSITIONS["table"], "resolution": "0.36 arcsec"})}
    faults = FaultPlan(now_s=lab.world.now)
    return lab, form, a_counter(lab.world, faults, dbc=DBC, form=form, period_s=1e-3, positions=encoders)


def test_pulses_and_encoder_are_latched_together():
    lab, form, counter = on_a_table(file(), encoder_skew_s=1e-3)
    lab.world.turn(-100.0, 1e6)
    lab.wait(1)
    counter.take()
    lab.wait(5)
    block = counter.take()
    counts, encoder = decode_counts(form, "x", block), decode_positions(form, "table", block)
    assert counts.sequence.tolist() == encoder.sequence.tolist()
    assert counts.tick.tolist() == encoder.tick.tolist()
    turned_deg = (np.cumsum(np.diff(encoder.position) % -(2**32)) / 1e4)[-1]
    assert turned_deg == pytest.approx(-100 * 4.999, abs=1e-3)
    assert (counts.negative[-1] - counts.negative[0]) == pytest.approx(-1000 * turned_deg, abs=2)
    lab.host_s = 6.0
    latest_deg = lab.world.axis.encoder_deg(lab.world.now())
    position_deg = (int(encoder.position[-1]) - 2**32) / 1e4
    assert position_deg == pytest.approx(latest_deg - 0.1, abs=2e-4), "one latch later than the pulses"


def test_a_gyro_without_power_and_a_dead_one_send_nothing():
    lab, form, counter = on_a_table(file())
    (gyro,) = lab.world.gyros.values()
    gyro.faults = FaultPlan({"dead": 3.0}, lab.world.now)
    lab.world.turn(100.0, 1e6)
    lab.wait(2)
    counter.take()
    lab.wait(5)
    dead = decode_counts(form, "x", counter.take())
    assert dead.positive[-1] == dead.positive[-2000]
    lab.world.power("supply", False)
    lab.wait(5)
    counts = decode_counts(form, "x", counter.take())
    assert set(np.diff(counts.positive)) == {0}
    assert lab.world.load_a("supply") == pytest.approx(0.06)


def test_a_slow_gyro_lags_on_a_swing_as_its_response_says():
    lab, form, counter = on_a_table(file(bandwidth="30 Hz", damping=0.6, delay="2 ms"), latitude_deg=0.0)
    lab.world.swing(Slew(0.0, 0.5, 100.0), Slew(0.0, 20.0, 4000.0), 0.0)
    lab.wait(1)
    counter.take()
    lab.wait(4)
    block = counter.take()
    counts, encoder = decode_counts(form, "x", block), decode_positions(form, "table", block)
    at_s = np.arange(len(counts.tick)) * 1e-3
    wave = np.exp(-2j * np.pi * 20 * at_s)
    position = (encoder.position + 2**31) % 2**32 - 2.0**31
    ratio = np.mean((counts.positive - counts.negative) * wave) / np.mean(position * wave) * 10
    expected = lab.world.gyros["a"].truth.dynamics.response(np.array([20.0]))[0]
    assert abs(ratio / expected - 1) < 6e-3  # the play of its converter
