from collections.abc import Sequence

from drivers.kinds.chamber.driver import STANDSTILL_S, StandstillWatch


def frozen_after_s(looks: Sequence[tuple[float, float, float]]) -> float | None:
    """When a watch that took these looks (time, process value, set point) first said so."""
    watch = StandstillWatch()
    return next((at_s for at_s, value, set_point in looks if watch.frozen(at_s, value, set_point)), None)


def test_a_value_that_stands_still_for_ten_minutes_of_a_ramp_is_frozen() -> None:
    assert frozen_after_s([(at, 20.0, 20.0 + at / 60) for at in range(1200)]) == STANDSTILL_S


def test_the_last_bit_of_a_value_is_a_change() -> None:
    assert frozen_after_s([(at, 20.0 + 4e-15 * (at // 599), 20.0 + at / 60) for at in range(3600)]) is None


def test_a_value_may_rest_with_its_set_point() -> None:
    assert frozen_after_s([(at, 20.0, 20.0) for at in range(36_000)]) is None


def test_the_ten_minutes_begin_with_the_ramp() -> None:
    looks = [(at, 20.0, 20.0 + max(0, at - 3600) / 60) for at in range(7200)]
    assert frozen_after_s(looks) == 3601 + STANDSTILL_S  # the first look that sees it move


def test_they_end_with_the_ramp() -> None:
    assert frozen_after_s([(at, 20.0, 20.0 + min(at, 500) / 60) for at in range(7200)]) is None


def test_a_ramp_so_slow_that_many_looks_see_no_step_is_a_ramp() -> None:
    looks = [(at / 10, 20.0, 20.0 + at // 300 * 1e-5) for at in range(12_000)]  # a step every 30 s
    assert frozen_after_s(looks) == STANDSTILL_S


def test_nobody_knows_what_a_value_did_while_nobody_looked() -> None:
    assert frozen_after_s([(0.0, 20.0, 20.0), (1.0, 20.0, 20.1), (3600.0, 20.0, 80.0), (3601.0, 20.0, 80.1)]) is None
