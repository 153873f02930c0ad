import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.physics.motion import Axis, AxisErrors
from simulators.physics.profiles import Move, Slew, Swing, Turn
from simulators.physics.servo import Loop, Ripple

ARCSEC = 1 / 3600
RIPPLE = Ripple(1e-2, (1, 2, 24), (0.3, 1.0, 2.0))


def axis(seed: int = 1, **errors) -> Axis:
    return Axis(AxisErrors(**errors), 40.0, np.random.default_rng(seed))


def true_at(head: Axis, at_s: float) -> float:
    return float(head.true_deg(np.array([float(at_s)]))[0])


def go(head: Axis, at_s: float, target_deg: float) -> float:
    """Moves and comes to rest; where it then truly stands."""
    head.start(at_s, target_deg, 20.0)
    assert not head.moving(at_s + 100)
    return true_at(head, at_s + 100)


# The profile


def test_a_long_move_is_a_trapezoid() -> None:
    move = Move(start_s=10, origin_deg=5, distance_deg=90, rate_dps=20, acceleration_dps2=40)
    assert move.duration_s == 5.0  # half a second of ramp at each end, 4 s at 20°/s between
    times = np.array([9, 10, 10.25, 10.5, 12.5, 14.5, 14.75, 15, 16])
    assert move.angle_deg(times) == pytest.approx([5, 5, 6.25, 10, 50, 90, 93.75, 95, 95], abs=1e-12)


def test_a_short_move_is_a_triangle() -> None:
    move = Move(start_s=0, origin_deg=0, distance_deg=-2.5, rate_dps=20, acceleration_dps2=40)
    assert move.duration_s == 0.5  # 10°/s at its middle
    assert move.angle_deg(np.array([0.125, 0.25, 0.375, 0.5])) == pytest.approx([-0.3125, -1.25, -2.1875, -2.5])


def test_no_distance_takes_no_time() -> None:
    move = Move(start_s=3, origin_deg=7, distance_deg=0, rate_dps=20, acceleration_dps2=40)
    assert move.duration_s == 0.0
    assert move.angle_deg(np.array([2.0, 3.0, 4.0])).tolist() == [7, 7, 7]
    assert move.angle_at(3.0) == 7


@given(
    distance_deg=st.floats(-720, 720).filter(lambda d: abs(d) > 1e-3),
    rate_dps=st.floats(0.1, 200),
    acceleration_dps2=st.floats(1, 400),
)
def test_every_move_is_smooth_keeps_its_limits_and_ends_on_target(
    distance_deg: float, rate_dps: float, acceleration_dps2: float
) -> None:
    move = Move(0.0, 10.0, distance_deg, rate_dps, acceleration_dps2)
    times, step_s = np.linspace(0, move.duration_s, 4001, retstep=True)
    angle = move.angle_deg(times)
    rate = np.diff(angle) / step_s
    assert angle[0] == pytest.approx(10, abs=1e-9)
    assert angle[-1] == pytest.approx(10 + distance_deg, abs=1e-9)
    assert move.angle_at(move.duration_s) == 10 + distance_deg
    assert np.all(np.sign(distance_deg) * rate >= -1e-6 * rate_dps), "it never turns back"
    assert np.abs(rate).max() <= rate_dps * (1 + 1e-6)
    assert np.abs(np.diff(rate)).max() <= acceleration_dps2 * step_s * (1 + 1e-6) + 1e-6 * rate_dps


# What the encoder says


def test_the_encoder_sees_the_profile_and_no_error() -> None:
    head = axis(zero_deg=1.0, cosines=(0.5,), sines=(0.5,), backlash_deg=1.0, repeatability_deg=1.0)
    head.start(0.0, 90.0, 20.0)
    assert head.target_deg() == 90.0
    assert [head.encoder_deg(at_s) for at_s in (0.0, 0.5, 2.5, 5.0, 6.0)] == [0, 5, 45, 90, 90]
    assert [head.moving(at_s) for at_s in (0.0, 4.999, 5.0)] == [True, True, False]


def test_a_stop_in_mid_move_stands_where_it_is() -> None:
    head = axis()
    head.start(0.0, 90.0, 20.0)
    head.stop(2.5)
    assert not head.moving(2.5)
    assert head.encoder_deg(100.0) == head.target_deg() == true_at(head, 100.0) == 45.0
    head.start(100.0, 0.0, 20.0)
    assert head.encoder_deg(100.0) == 45.0
    assert head.encoder_deg(200.0) == 0.0


def test_a_command_in_mid_move_starts_from_where_the_axis_is() -> None:
    head = axis()
    head.start(0.0, 90.0, 20.0)
    head.start(2.5, 10.0, 20.0)
    assert head.encoder_deg(2.5) == 45.0
    assert head.target_deg() == 10.0
    assert head.encoder_deg(2.5 + 35 / 20 + 0.5) == 10.0


# Where it really stands


def test_a_perfect_axis_is_where_its_encoder_says() -> None:
    head = axis()
    head.start(0.0, 90.0, 20.0)
    times = np.linspace(0, 6, 61)
    assert head.true_deg(times) == pytest.approx([head.encoder_deg(at_s) for at_s in times], abs=1e-12)
    assert go(head, 10.0, 270.0) == 270.0


def test_the_zero_error_is_there_at_every_angle() -> None:
    head = axis(zero_deg=5 * ARCSEC)
    assert [go(head, 1000.0 * n, angle) - angle for n, angle in enumerate((90, 180, 0))] == pytest.approx(
        [5 * ARCSEC] * 3
    )


def test_the_error_map_has_the_harmonics_it_was_given() -> None:
    head = axis(cosines=(1 * ARCSEC, 2 * ARCSEC), sines=(3 * ARCSEC, 4 * ARCSEC))
    errors = [(go(head, 1000.0 * n, angle) - angle) / ARCSEC for n, angle in enumerate((0, 45, 90, 180, 270))]
    diagonal = (1 + 3) / np.sqrt(2)
    assert errors == pytest.approx([1 + 2, diagonal + 4, 3 - 2, -1 + 2, -3 - 2], abs=1e-6)


def test_backlash_shows_after_an_approach_from_above_only() -> None:
    head = axis(backlash_deg=1 * ARCSEC)
    assert go(head, 0, 90) == 90
    assert go(head, 1000, 50) - 50 == pytest.approx(ARCSEC)
    assert go(head, 2000, 50) - 50 == pytest.approx(ARCSEC), "a move of no distance approaches from nowhere"
    assert go(head, 3000, 90) == 90
    head.start(4000, 0, 20)
    head.stop(4001)
    assert true_at(head, 4002) - head.encoder_deg(4002) == pytest.approx(ARCSEC)


def test_each_move_scatters_anew_and_rest_does_not() -> None:
    head = axis(repeatability_deg=0.1 * ARCSEC)
    errors = []
    for n in range(4000):
        errors.append(go(head, 1000 * n, 90 * (n % 2 + 1)) - 90 * (n % 2 + 1))
        assert true_at(head, 1000 * n + 500) - 90 * (n % 2 + 1) == errors[-1]
    assert np.mean(errors) == pytest.approx(0, abs=0.007 * ARCSEC)
    assert np.std(errors) == pytest.approx(0.1 * ARCSEC, rel=0.05)
    assert np.corrcoef(errors[:-1], errors[1:])[0, 1] == pytest.approx(0, abs=0.06)


def test_the_scatter_belongs_to_the_seed() -> None:
    angles = [0, 90, 180, 270]

    def tour(seed: int) -> list[float]:
        head = axis(seed, repeatability_deg=ARCSEC)
        return [go(head, 1000 * n, angle) for n, angle in enumerate(angles)]

    assert tour(1) == tour(1)
    assert tour(1) != tour(2)


def test_one_look_across_the_end_of_a_move_sees_it_come_to_rest() -> None:
    head = axis(zero_deg=ARCSEC, cosines=(ARCSEC,), sines=(0.0,), repeatability_deg=ARCSEC)
    head.start(0.0, 90.0, 20.0)
    across = head.true_deg(np.array([4.9, 5.0, 5.1]))
    assert across[1] == across[2] == pytest.approx(true_at(head, 6.0), abs=1e-12)
    assert across[0] < across[1]


# Turning and swinging


def test_a_turn_changes_its_rate_and_goes_on() -> None:
    turn = Turn(10.0, 5.0, Slew(-20.0, 40.0, 30.0))
    assert (turn.duration_s, turn.endless) == (2.0, True)
    times = np.array([9.0, 10.0, 11.0, 12.0, 14.0])
    assert turn.angle_deg(times) == pytest.approx([5, 5, 0, 25, 105])  # back by 6.7°, to rest, and on
    assert [turn.rate_at(at_s) for at_s in times] == pytest.approx([-20, -20, 10, 40, 40])
    assert turn.angle_at(14.0) == turn.angle_deg(times)[-1]
    assert not Turn(0.0, 0.0, Slew(20.0, 0.0, 40.0)).endless


@pytest.mark.parametrize("phase_deg", [0.0, 90.0])
def test_a_swing_grows_to_its_amplitude_and_frequency(phase_deg: float) -> None:
    swing = Swing(10.0, 40.0, Slew(0.0, 3.0, 1.5), Slew(0.0, 2.0, 0.5), phase_deg)
    assert (swing.duration_s, swing.endless) == (4.0, True)
    assert swing.angle_at(10.0) == 40.0
    times = np.linspace(14, 16, 401)
    expected = 3 * np.sin(2 * np.pi * 2 * (times - 14) + np.radians(phase_deg))  # 4 turns of phase by then
    assert swing.angle_deg(times) == pytest.approx(40 + expected, abs=1e-9)
    assert swing.rate_at(14.0) == pytest.approx(12 * np.pi * np.cos(np.radians(phase_deg)))


@given(
    begin_dps=st.floats(-400, 400),
    end_dps=st.floats(-400, 400),
    acceleration_dps2=st.floats(1, 4000),
    amplitude_deg=st.floats(0.01, 100),
    frequency_hz=st.floats(0.05, 20),
    run_up_s=st.floats(0.5, 20),
)
def test_the_rate_that_is_told_is_that_of_the_angle(
    begin_dps: float,
    end_dps: float,
    acceleration_dps2: float,
    amplitude_deg: float,
    frequency_hz: float,
    run_up_s: float,
) -> None:
    amplitude, frequency = (Slew(0.0, end, end / run_up_s) for end in (amplitude_deg, frequency_hz))
    for profile in (
        Move(0.0, 10.0, begin_dps, 50.0, acceleration_dps2),
        Turn(0.0, 10.0, Slew(begin_dps, end_dps, acceleration_dps2)),
        Turn(0.0, 10.0, Slew(begin_dps, end_dps, acceleration_dps2), RIPPLE),
        Swing(0.0, 10.0, amplitude, frequency),
    ):
        times_s, half_s = np.linspace(0.001, 2 * profile.duration_s + 1, 57), 1e-6
        times_s = times_s[np.abs(times_s - profile.duration_s) > 2 * half_s]  # the amplitude stops growing at once
        rates_dps = (profile.angle_deg(times_s + half_s) - profile.angle_deg(times_s - half_s)) / (2 * half_s)
        assert rates_dps == pytest.approx([profile.rate_at(float(at_s)) for at_s in times_s], abs=0.01)
        assert profile.rates_dps(times_s) == pytest.approx([profile.rate_at(float(at_s)) for at_s in times_s])
        changes = (profile.rates_dps(times_s + half_s) - profile.rates_dps(times_s - half_s)) / (2 * half_s)
        even = np.abs(changes - profile.accelerations_dps2(times_s)) < 1e-3 * (1 + np.abs(changes).max())
        assert np.count_nonzero(~even) <= 2, "where a move changes from one acceleration to another"


def test_an_axis_turns_from_what_it_does_and_comes_to_rest() -> None:
    table = axis()
    table.turn(0.0, 20.0, 40.0)
    assert (table.moving(0.0), table.done(0.4), table.done(0.5), table.moving(1e6)) == (True, False, True, True)
    assert (table.rate_dps(0.25), table.rate_dps(100.0), table.encoder_deg(2.0)) == (10.0, 20.0, 35.0)
    assert table.true_deg(np.array([1.0, 2.0])) == pytest.approx([15, 35])
    table.turn(2.0, -20.0, 40.0)
    assert (table.encoder_deg(2.5), table.rate_dps(2.5), table.rate_dps(3.0)) == (40.0, 0.0, -20.0)
    table.turn(3.0, 0.0, 20.0)
    assert (table.moving(3.9), table.moving(4.0), table.target_deg()) == (True, False, 25.0)
    assert table.encoder_deg(100.0) == true_at(table, 100.0) == 25.0
    table.turn(100.0, 0.0, 20.0)
    assert not table.moving(100.0)
    table.start(100.0, 0.0, 20.0, 400.0)
    assert table.encoder_deg(100.0 + 25 / 20 + 20 / 400) == 0.0


def test_an_axis_swings_about_where_it_stands() -> None:
    table = axis()
    go(table, 0.0, 30.0)
    table.swing(50.0, Slew(0.0, 2.0, 2.0), Slew(0.0, 1.0, 1.0), 0.0)
    assert (table.done(50.9), table.done(51.0), table.moving(1e6)) == (False, True, True)
    assert (table.encoder_deg(50.0), table.encoder_deg(51.25 + 0.5)) == pytest.approx((30.0, 32.0))
    table.turn(52.0, 0.0, 1000.0)
    assert not table.moving(52.1)


def test_backlash_shows_while_it_turns_down_and_stays_when_nothing_turns() -> None:
    table = axis(backlash_deg=ARCSEC)
    for at_s, rate_dps, error_arcsec in (
        (0.0, 10.0, 0),
        (100.0, -10.0, 1),
        (200.0, 0.0, 1),
        (300.0, 0.0, 1),
        (400.0, 10.0, 0),
    ):
        table.turn(at_s, rate_dps, 40.0)
        assert (true_at(table, at_s + 50) - table.encoder_deg(at_s + 50)) / ARCSEC == pytest.approx(
            error_arcsec, abs=1e-6
        )


# What a table makes of it


def test_a_table_lags_behind_a_sine_and_cannot_do_more_than_its_motor() -> None:
    slow = Loop(natural_hz=150.0, damping=0.7)
    gain, phase = slow.follows(np.array([0.1, 0.1]), np.array([1e-3, 150.0]))
    assert gain == pytest.approx([1, 1 / 1.4])
    assert phase == pytest.approx([0, -np.pi / 2], abs=1e-4)
    weak = Loop(natural_hz=150.0, damping=0.7, most_dps2=100.0)
    gain, _ = weak.follows(np.array([1.0, 1.0]), np.array([1.0, 10.0]))
    assert gain == pytest.approx([1, 100 / (20 * np.pi) ** 2], rel=1e-4)
    swing = Swing(0.0, 40.0, Slew(0.0, 3.0, 1.5), Slew(0.0, 50.0, 25.0), 0.0, slow)
    gain, phase = slow.follows(np.array([3.0]), np.array([50.0]))
    times = np.linspace(2, 2.1, 401)
    expected = 3 * gain * np.sin(2 * np.pi * 50 * (times - 2) + phase)
    assert swing.angle_deg(times) == pytest.approx(40 + expected, abs=1e-9)


@pytest.mark.parametrize("loop", [None, Loop(150.0, 0.7), Loop(150.0, 0.7, most_dps2=1e4)])
def test_the_frequency_of_a_swing_changes_without_a_step(loop: Loop | None) -> None:
    before = Swing(0.0, 40.0, Slew(0.0, 0.5, 0.5), Slew(0.0, 8.0, 8.0), 30.0, loop)
    swept = before.changed(2.3, 0.5, 48.0, (1.0, 4.0))
    assert swept.angle_at(2.3) == pytest.approx(before.angle_at(2.3), abs=1e-12)
    assert (swept.duration_s, swept.frequency_hz.end) == (10.0, 48.0)
    times_s, half_s = np.linspace(2.31, 12.2, 997), 1e-6
    rates_dps = (swept.angle_deg(times_s + half_s) - swept.angle_deg(times_s - half_s)) / (2 * half_s)
    assert swept.rates_dps(times_s) == pytest.approx(rates_dps, abs=2e-6 * np.abs(rates_dps).max())
    late_s = np.linspace(13, 13 + 1 / 48, 257)[:-1]
    gain = 1.0 if loop is None else loop.follows(np.array([0.5]), np.array([48.0]))[0][0]
    assert np.ptp(swept.angle_deg(late_s)) / 2 == pytest.approx(0.5 * gain, rel=1e-3)


def test_a_table_that_turns_unevenly_is_where_its_mean_rate_takes_it() -> None:
    turn = Turn(0.0, 10.0, Slew(0.0, 360.0, 1e6), Ripple(1e-4, (1, 2), (0.5, 1.5)))
    seconds = turn.angle_deg(np.array([1.0, 2.0, 3.0]))
    assert np.diff(seconds) == pytest.approx([360, 360], abs=1e-9)
    assert turn.rates_dps(np.linspace(1, 2, 1001)).max() == pytest.approx(360 * (1 + 1.9e-4), rel=2e-5)


def test_a_table_whose_clock_is_fast_turns_faster_than_it_is_told() -> None:
    table = Axis(AxisErrors(), 40.0, np.random.default_rng(1), rate_error=2e-4)
    table.turn(0.0, -50.0, 1e6)
    assert table.rate_dps(10.0) == pytest.approx(-50.01, abs=1e-9)


def test_the_true_rate_holds_the_slope_of_the_error_map() -> None:
    table = axis(cosines=(0.1, 0.05), sines=(0.02, 0.03))
    table.swing(0.0, Slew(0.0, 20.0, 10.0), Slew(0.0, 0.5, 0.25), 0.0)
    times_s, half_s = np.linspace(3, 9, 57), 1e-5
    rates_dps, changes_dps2 = table.true_rates(times_s)
    steps = table.true_deg(times_s + half_s) - table.true_deg(times_s - half_s)
    assert rates_dps == pytest.approx(steps / (2 * half_s), abs=1e-6)
    steps = table.true_rates(times_s + half_s)[0] - table.true_rates(times_s - half_s)[0]
    assert changes_dps2 == pytest.approx(steps / (2 * half_s), abs=1e-5)
    assert np.abs(rates_dps / table._profile.rates_dps(times_s) - 1).max() > 1e-4
