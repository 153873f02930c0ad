"""The latest order wins; an angle is approached from one side; an axis stands when it has stood for long enough."""

import pytest

from drivers.errors import Refused
from drivers.kinds.approach import Hold, begin_of, legs
from drivers.kinds.latest import Latest


def test_an_order_ends_the_one_under_way_and_takes_away_its_result() -> None:
    latest: Latest[float] = Latest("head", "move")
    first = latest.begin()
    latest.done(first, 10.0)
    assert latest.result == 10.0
    second = latest.begin()
    assert first.ended
    assert latest.result is None
    with pytest.raises(Refused, match="head: the move was ended by another command; sent GO"):
        first.check("GO")
    latest.done(first, 10.0)
    assert latest.result is None
    latest.done(second, 20.0)
    assert latest.result == 20.0


@pytest.mark.parametrize(
    ("approach", "start_deg", "angles_deg"),
    [
        ("direct", 50.0, [20.0]),
        ("direct", 20.0, [20.0]),
        ("from_below", 0.0, [20.0]),
        ("from_below", 18.0, [20.0]),
        ("from_below", 19.0, [18.0, 20.0]),
        ("from_below", 50.0, [18.0, 20.0]),
        ("from_above", 50.0, [20.0]),
        ("from_above", 22.0, [20.0]),
        ("from_above", 20.0, [22.0, 20.0]),
        ("from_above", 0.0, [22.0, 20.0]),
    ],
)
def test_every_visit_ends_from_the_stated_side(approach, start_deg, angles_deg) -> None:
    found = legs(start_deg, begin_of(20.0, approach, 2.0), 20.0, hold_s=1.0)
    assert [angle_deg for angle_deg, _ in found] == angles_deg
    assert [hold_s for _, hold_s in found] == [0.0] * (len(found) - 1) + [1.0]


def test_a_hold_begins_anew_whenever_the_axis_does_not_stand() -> None:
    hold = Hold(2.0)
    looks = [(0.0, True), (1.0, True), (1.5, False), (2.0, True), (3.9, True), (4.0, True)]
    assert [hold.is_over(at_s, fulfilled=fulfilled) for at_s, fulfilled in looks] == [False] * 5 + [True]
