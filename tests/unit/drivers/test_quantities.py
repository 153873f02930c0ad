"""Numbers with units: what is understood, to the last bit; what is refused, word for word; and the algebra."""

from __future__ import annotations

import math
import operator
import re
import sys

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from drivers.quantity.quantities import Quantity, as_quantity, finite, parse, spell
from drivers.quantity.units import NO_DIMENSION, QuantityError, customary_unit, describe, parse_unit, quoted

MANY = settings(max_examples=1000, deadline=None)


def refusal(text):
    with pytest.raises(QuantityError) as caught:
        parse(text)
    return str(caught.value)


# What a person writes is what a person gets


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("20 °C", "°C", 20.0),
        ("-40 °C", "°C", -40.0),
        ("+5 °C", "°C", 5.0),
        ("20°C", "°C", 20.0),
        ("  20   °C  ", "°C", 20.0),
        ("25 degC", "°C", 25.0),
        ("0.1 s", "s", 0.1),
        (".5 s", "s", 0.5),
        ("5. s", "s", 5.0),
        ("1e3 Hz", "Hz", 1000.0),
        ("1E-3 A", "mA", 1.0),
        ("100 ms", "s", 0.1),
        ("100 ms", "ms", 100.0),
        ("30 min", "s", 1800.0),
        ("2 h", "min", 120.0),
        ("1 d", "h", 24.0),
        ("1 day", "d", 1.0),
        ("1 °C/min", "°C/min", 1.0),
        ("0.1 °C/min", "°C/min", 0.1),
        ("6 °C/h", "°C/min", 0.1),
        ("120 mA", "A", 0.12),
        ("2 nA", "A", 2e-9),
        ("16 V", "mV", 16000.0),
        ("3 kΩ", "Ω", 3000.0),
        ("3 kohm", "Ω", 3000.0),
        ("12 V·A", "W", 12.0),
        ("12 V*A", "W", 12.0),
        ("256 kHz", "Hz", 256000.0),
        ("1 MHz", "kHz", 1000.0),
        ("91°", "°", 91.0),
        ("90 deg", "°", 90.0),
        ("20 °/s", "°/s", 20.0),
        ("1 rpm", "°/s", 6.0),
        ("2 turn", "°", 720.0),
        ("30 arcmin", "°", 0.5),
        ("10 arcsec", "arcsec", 10.0),
        ("100 marcsec", "arcsec", 0.1),
        ("1 mrad", "rad", 0.001),
        ("9.79541 m/s²", "m/s²", 9.79541),
        ("9.79541 m/s^2", "m/s²", 9.79541),
        ("9.79541 m/s2", "m/s²", 9.79541),
        ("9.79541 m·s⁻²", "m/s²", 9.79541),
        ("9.79541 m·s^(-2)", "m/s²", 9.79541),
        ("9.79541 m/s/s", "m/s²", 9.79541),
        ("12 g", "g", 12.0),
        ("-5 mg", "µg", -5000.0),
        ("2 µg/Hz^0.5", "µg/Hz^0.5", 2.0),
        ("100 µg/g²", "1/g", 1e-4),
        ("50 µg/°C", "g/°C", 5e-5),
        ("150 ppm/°C", "1/°C", 1.5e-4),
        ("5 1/°C", "1/°C", 5.0),
        ("1800 pulse/s/(m/s²)", "pulse·s/m", 1800.0),
        ("5 (((m)))", "m", 5.0),
        ("20 ppm", "", 2e-5),
        ("0.2 %", "", 0.002),
        ("7", "", 7.0),
        ("-7.5", "", -7.5),
    ],
)
def test_a_number_with_a_unit_is_that_number_in_that_unit(text, unit, number):
    assert parse(text).to(unit) == number


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("−40 °C", "-40 °C"),  # U+2212, which word processors make of a hyphen
        ("20 ℃", "20 °C"),
        ("20 ºC", "20 °C"),  # the masculine ordinal of Spanish keyboards
        ("20 ˚C", "20 °C"),  # the ring that macOS types
        ("５ Ｖ", "5 V"),  # full-width
        ("𝟓 V", "5 V"),
        ("5 μV/V", "5 µV/V"),  # Greek mu, micro sign
        ("5 us", "5 µs"),
        ("5\u00a0V", "5 V"),  # no-break space
        ("5\u2009V", "5 V"),  # thin space
        ("5\tV", "5 V"),
        ("1 kΩ", "1 kΩ"),  # ohm sign, omega
        ("5 ㎏", "5 kg"),
        ("3 V⋅A", "3 V·A"),
        ("10 m⁻¹", "10 1/m"),
        ("54° 44′ 08″", "54°44'08\""),
        ("6 °C/h", "0.1 °C/min"),
        ("90 s", "1 min 30 s"),
        ("0.0003 V", "0.3 mV"),
        ("1 h", "3600 s"),
        ("3600 °/h", "1 °/s"),
        ("-0 V", "0 V"),
    ],
)
def test_other_spellings_are_the_same_quantity_to_the_last_bit(text, same):
    assert parse(text) == parse(same)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("1 h 30 min", 5400),
        ("1h30min", 5400),
        ("1 d 2 h 3 min 4.5 s", 93784.5),
        ("2 day 1 s", 172801),
        ("10 min 0.25 s", 600.25),
        ("0 h 90 min", 5400),
    ],
)
def test_days_to_seconds_stand_side_by_side(text, seconds):
    assert parse(text).to("s") == seconds


@pytest.mark.parametrize(
    ("text", "arcseconds"),
    [
        ("54°44'08\"", 197048),
        ("54°44'08.25\"", 197048.25),
        ("-54°44'08\"", -197048),
        ("-0°30'", -1800),  # the sign is that of the whole angle
        ("−0°00'01\"", -1),
        ("+1°30'", 5400),
        ("1° 30'", 5400),
        ('0°05"', 5),
        ("360°59'59.999\"", 1299599.999),
    ],
)
def test_degrees_take_minutes_and_seconds_of_arc(text, arcseconds):
    assert parse(text).to("arcsec") == arcseconds


# What is refused


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("1_000", "'1_000' is not a quantity; write 1500 or 1.5, nothing between the digits"),
        ("1,000 V", "'1,000 V' is not a quantity; write 1500 or 1.5, nothing between the digits"),
        ("1,5 V", "'1,5 V' is not a quantity; use a decimal point: write 1.5 V"),
        ("0,3 °C", "'0,3 °C' is not a quantity; use a decimal point: write 0.3 °C"),
        ("3O s", "'3O s' is not a quantity; a letter is used for a digit: write 30 s"),
        ("l0 s", "'l0 s' is not a quantity; a letter is used for a digit: write 10 s"),
        ("temperature", "'temperature' is not a quantity; if it is a parameter, write ${temperature}"),
        ("$soak", "'$soak' is not a quantity; if it is a parameter, write ${soak}"),
        ("{soak}", "'{soak}' is not a quantity; if it is a parameter, write ${soak}"),
        ("1 000 V", "'1 000 V' is not a quantity; write 1500 or 1.5, nothing between the digits"),
        ("0x10", "'x' in 'x10' is not a known unit"),
        ("1e999", "is not a finite number"),
        ("-1e999 V", "is not a finite number"),
        ("1e308 kV", "is not a finite number"),
        ("5 " + "·".join(["km^9/m^9"] * 20), "is not a finite number"),
        ("NaN", "'NaN' is not a quantity"),
        ("inf", "'inf' is not a quantity"),
        ("-inf V", "'-inf V' is not a quantity"),
        ("", "'' is not a quantity"),
        ("-", "'-' is not a quantity"),
        ("V", "'V' is not a quantity"),
        ("°C", "'°C' is not a quantity"),
        ("--5 V", "'--5 V' is not a quantity"),
        ("+-5 V", "'+-5 V' is not a quantity"),
        ("–5 V", "'–5 V' is not a quantity; a dash is used as minus sign: write -5 V"),
        ("1.5.2 h", "'1.5.2 h' is not a quantity; a number has one decimal point: write it like 1.5 h"),
        ("1..5 h", "'1..5 h' is not a quantity; a number has one decimal point: write it like 1 h"),
        (".1.2", "'.1.2' is not a quantity; a number has one decimal point: write it like .1"),
        ("1h30", "'1h30' is not a quantity; the last unit is missing: write 1 h 30 min"),
        ("2 min 30", "'2 min 30' is not a quantity; the last unit is missing: write 2 min 30 s"),
        ("00:30:00", "'00:30:00' is not a quantity; write a duration with its units: 30 min"),
        ("26:00:05", "'26:00:05' is not a quantity; write a duration with its units: 26 h 5 s"),
        ("1:30", "'1:30' is not a quantity; write a duration with its units: 1 h 30 min or 1 min 30 s"),
        ("0:00", "'0:00' is not a quantity; write a duration with its units: 0 min or 0 s"),
        ("120 MA", "'MA' is refused, M being mega: write mA for milli"),
        ("5 V/Ms", "'Ms' is refused, M being mega: write ms for milli"),
        ("30 mins", "'mins' is not a known unit; write min"),
        ("5 5 V", "'5 5 V' is not a quantity; write 1500 or 1.5, nothing between the digits"),
        ("1e V", "'e' in 'e V' is not a known unit"),
        ("1e5e5 V", "'e' in 'e5 V' is not a known unit"),
        ("٥ V", "'٥ V' is not a quantity"),
    ],
)
def test_what_is_not_wholly_a_number_is_refused(text, problem):
    assert refusal(text) == problem


@pytest.mark.parametrize(
    ("text", "char"),
    [("½ h", "½"), ("5½ h", "½"), ("5⑤ V", "⑤"), ("5₂ V", "₂"), ("Ⅴ V", "Ⅴ"), ("⒌ V", "⒌"), ("5 m₂", "₂")],
)
def test_digits_that_normalisation_would_run_together_with_their_neighbours_are_refused(text, char):
    assert refusal(text) == f"'{text}' contains '{char}'; write plain digits"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("1 h 30", "'1 h 30' is not a quantity; the last unit is missing: write 1 h 30 min"),
        ("30 min 1 h", "'min 1 h' is not a unit"),
        ("-1 h 30 min", "'h 30 min' is not a unit"),
        ("1.5 h 30 min", "'h 30 min' is not a unit"),
        ("1°60'", "has 60 or more minutes or seconds of arc"),
        ("1°59'60\"", "has 60 or more minutes or seconds of arc"),
        ("1°5", "'1°5' is not an angle; write minutes and seconds of arc like 54°44'08\""),
        ("5°-5'", '"5°-5\'" is not an angle; write minutes and seconds of arc like 54°44\'08"'),
        ("1.5°5'", '"1.5°5\'" is not an angle; write minutes and seconds of arc like 54°44\'08"'),
        ("5'", "write arcmin for minutes of arc"),
        ('5"', "write arcsec for seconds of arc, or degrees before them like 0°00'05\""),
    ],
)
def test_compound_times_and_angles_have_one_form(text, problem):
    assert refusal(text) == problem


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("20 K", "kelvin is refused: write °C, for a difference too"),
        ("20 mK", "kelvin is refused: write °C, for a difference too"),
        ("20 °K", "kelvin is refused: write °C, for a difference too"),
        ("1 K/min", "kelvin is refused: write °C, for a difference too"),
        ("20 °F", "fahrenheit is refused: write °C"),
        ("20 ℉", "fahrenheit is refused: write °C"),
        ("20 F", "fahrenheit is refused: write °C"),
        ("1 gn", "g_n is refused: g is local gravity, or write m/s²"),
        ("1 g_n", "g_n is refused: g is local gravity, or write m/s²"),
        ("1 gₙ", "g_n is refused: g is local gravity, or write m/s²"),
        ("5 gram", "gram is refused: g is local gravity"),
    ],
)
def test_units_that_mean_two_things_are_refused_with_what_to_write_instead(text, problem):
    assert refusal(text) == problem


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("5 hz", "'hz' is not a known unit; write Hz"),
        ("5 Mv", "'Mv' is not a known unit; write mV"),
        ("15 v", "'v' is not a known unit; write V"),
        ("120 ma", "'ma' is not a known unit; write mA"),
        ("30 minutes", "'minutes' is not a known unit; write min"),
        ("5 H", "'H' is not a known unit; write h"),
        ("5 Min", "'Min' is not a known unit; write min"),
        ("5 volts", "'volts' is not a known unit; write V"),
        ("20 celsius", "'celsius' is not a known unit; write °C"),
        ("20C", "'C' is not a known unit; write °C"),
        ("90 degrees", "'degrees' is not a known unit; write °"),
        ("5 ps", "'ps' is not a known unit"),
        ("5 mmin", "'mmin' is not a known unit"),
        ("5 k°C", "'k°C' is not a known unit"),
        ("5 µ°", "'µ°' is not a known unit"),
        ("5 mrpm", "'mrpm' is not a known unit"),
        ("5 m%", "'m%' is not a known unit"),
        ("5 µg/√Hz", "'√Hz' in 'µg/√Hz' is not a known unit"),
        ("5 µ s", "'µ' in 'µ s' is not a known unit"),
        ("5 V A", "'V A' is not a unit"),
        ("5 V.s", "'V.s' is not a unit"),
        ("5 ° C", "'° C' is not a unit; write °C"),
        ("5 m//s", "'m//s' is not a unit"),
        ("5 /s", "'/s' is not a unit"),
        ("5 m^", "'m^' is not a unit"),
        ("5 m^^2", "'m^^2' is not a unit"),
        ("5 m**2", "'m**2' is not a unit"),
        ("5 m^9^9", "'m^9^9' is not a unit"),
        ("5 m^10", "'m^10' has an exponent beyond 9"),
        ("5 m²²", "'m^22' has an exponent beyond 9"),
        ("5 " + "·".join(["m"] * 10), "has a unit with an exponent beyond 9"),
        ("5 m^0.33333", "has a unit with an exponent of more than 4 decimals"),
        ("2²", "'^2' is not a unit"),
        ("10⁶ V", "'^6 V' is not a unit"),
        ("5 (m", "'(m' lacks a closing parenthesis"),
        ("5 m)", "'m)' is not a unit"),
        ("5 ()", "'()' is not a unit"),
        ("5 (m/s)^2", "'(m/s)^2' is not a unit"),
        ("1 1/2 h", "'1/2 h' is not a unit"),
        ("5\u200bV", "'\\u200bV' is not a known unit"),
    ],
)
def test_what_is_not_a_unit_is_refused(text, problem):
    assert refusal(text) == problem


def test_very_long_text_is_refused_at_once_and_not_printed_whole():
    assert refusal("5 " + "(" * 4000) == f"'5 {'(' * 25}...{'(' * 28}' is too long for a quantity"
    assert refusal("5 " + "(" * 99).endswith("is not a unit")


def test_a_tiny_number_costs_no_memory():
    assert parse("1e-999999999 V") == parse("0 V")
    assert parse("0e999999999 V") == parse("0 V")


def test_a_message_stands_on_one_line_and_shows_what_a_screen_does_not():
    assert refusal("five\n\x1b[31mV") == "'five\\n\\x1b[31mV' is not a quantity"
    assert quoted(5) == "'5'"


@pytest.mark.lengthy
@MANY
@given(st.text(max_size=40) | st.from_regex(r"[+-−]?[0-9.e,_½]{0,8} ?[a-zA-Zµ°%'\"·/^()0-9²⁻ ]{0,12}", fullmatch=True))
def test_any_text_is_a_finite_quantity_or_a_refusal_on_one_line(text):
    problem = ""
    try:
        assert math.isfinite(parse(text).base_value)
    except QuantityError as refused:
        problem = str(refused)
    assert "\n" not in problem


# Spelling


@pytest.mark.parametrize(
    ("text", "spelled"),
    [
        ("1 h 30 min", "5400 s"),
        ("60 °C/h", "1 °C/min"),
        ("120 mA", "0.12 A"),
        ("54°30'", "54.5 °"),
        ("1800 pulse/s", "1800 pulse/s"),
        ("20 ppm", "2e-05"),
        ("5 1/°C", "5 1/°C"),
        ("2 µg/Hz^0.5", "2e-06 s^0.5·g"),
        ("3 m²/s", "3 m^2/s"),
        ("−0.0 V", "0 V"),
        ("1e308 °C/s", "1e+308 °C/s"),  # too large a number in °C/min
    ],
)
def test_a_quantity_is_spelled_in_its_customary_unit(text, spelled):
    assert str(parse(text)) == spelled


UNITS = st.sampled_from(
    ["", "s", "min", "°C", "°C/min", "°", "arcsec", "°/s", "mA", "nA", "V", "g", "µg", "1/°C", "µg/g²", "pulse/s",
     "m/s²", "kΩ", "ppm", "g/Hz^0.5", "rpm"]
)  # fmt: skip
NUMBERS = st.decimals(-(10**6), 10**6, places=4, allow_nan=False, allow_infinity=False)


@MANY
@given(NUMBERS, UNITS)
def test_a_number_comes_back_from_its_unit_as_it_was_written(number, unit):
    assert parse(f"{number} {unit}").to(unit) == float(number)


@MANY
@given(NUMBERS, UNITS)
def test_what_is_spelled_is_read_back(number, unit):
    quantity = parse(f"{number} {unit}")
    assert parse(spell(quantity)).dimension == quantity.dimension
    assert parse(spell(quantity)).base_value == pytest.approx(quantity.base_value, rel=1e-11)


def test_a_dimension_without_a_customary_unit_is_a_product_of_base_units():
    assert customary_unit(parse_unit("V/A/s").dimension) == "m^2·kg/s^4/A^2"
    assert describe(parse_unit("1/m²").dimension) == "1/m^2"
    assert describe(NO_DIMENSION) == "a bare number"


# Conversion and algebra


@pytest.mark.parametrize(
    ("text", "unit", "problem"),
    [
        ("5 V", "A", "is in V, expected a quantity in A"),
        ("5", "A", "is a bare number, expected a quantity in A"),
        ("5 V", "", "is in V, expected a number without a unit"),
        ("5 g", "m/s²", "is in g, expected a quantity in m/s²"),
        ("5 kg", "g", "is in kg, expected a quantity in g"),
        ("5 rad", "°C", "is in °, expected a quantity in °C"),
    ],
)
def test_a_unit_of_another_dimension_is_refused(text, unit, problem):
    with pytest.raises(QuantityError) as caught:
        parse(text).to(unit)
    assert str(caught.value) == problem


def test_sums_differences_products_and_quotients_keep_dimensions():
    assert (parse("90°") + parse("1°")).to("°") == 91
    assert (parse("0.1 V") + parse("0.2 V")).to("V") == 0.3
    assert (parse("20 °C") - parse("-40 °C")).to("°C") == 60
    assert (parse("2 °C/min") * parse("30 min")).to("°C") == 60
    assert (parse("60 °C") / parse("2 °C/min")).to("min") == 30
    assert (2 * parse("3 V")).to("V") == 6
    assert (1 / parse("2 s")).to("Hz") == 0.5
    assert (1 + parse("50 %")).to("%") == 150
    assert (1 - parse("50 %")).to("%") == 50
    assert abs(-parse("3 V")).to("V") == 3
    assert +parse("3 V") == parse("3 V")


@pytest.mark.parametrize(
    ("work", "problem"),
    [
        (lambda: parse("1 V") + parse("1 A"), "cannot add V and A"),
        (lambda: parse("1 V") - 1, "cannot subtract V and a bare number"),
        (lambda: 1 + parse("1 V"), "cannot add a bare number and V"),
        (lambda: parse("1 V") < parse("1 s"), "cannot compare V and s"),
        (lambda: parse("1 V") / parse("0 s"), "division by zero"),
        (lambda: parse("1 V") / 0, "division by zero"),
        (lambda: parse("1e300 V") * parse("1e300 V"), "is not a finite number"),
        (lambda: 1 / parse("1e-310 V"), "is not a finite number"),
        (lambda: parse("1 V") + "x", "'x' is not a quantity"),
        (lambda: parse("1 V") * True, "'True' is not a quantity"),
        (lambda: operator.add(parse("1 V"), (parse("1 V"),)), "a list is not a quantity"),
        (lambda: as_quantity(math.inf), "is not a finite number"),
        (lambda: finite(math.nan, NO_DIMENSION), "is not a finite number"),
        (lambda: bool(parse("1 V")), "a quantity is neither true nor false; compare it with another"),
    ],
)
def test_what_does_not_go_together_is_refused(work, problem):
    with pytest.raises(QuantityError) as caught:
        work()
    assert str(caught.value) == problem


def test_quantities_of_one_dimension_are_ordered():
    small, large = parse("99 mV"), parse("0.1 V")
    assert small < large
    assert small <= large
    assert large > small
    assert large >= small
    assert not large <= small
    assert parse("6 °C/h") >= parse("0.1 °C/min")
    assert parse("6 °C/h") <= parse("0.1 °C/min")


VOLTS = st.integers(-(10**6), 10**6).map(lambda mv: Quantity(mv / 1000, parse_unit("V").dimension))
ANY = st.tuples(st.integers(-(10**6), 10**6), UNITS).map(lambda pair: parse(f"{pair[0]} {pair[1]}"))


@pytest.mark.lengthy
@MANY
@given(VOLTS, VOLTS, ANY)
def test_the_algebra_is_that_of_numbers(a, b, c):
    assert a + b == b + a
    assert (a * c).dimension == (c * a).dimension
    assert a * c == c * a
    assert a - b == -(b - a)
    assert (a < b) == (b > a)
    assert ((a + b) * c).base_value == pytest.approx((a * c + b * c).base_value, rel=1e-9, abs=1e-9)
    assume(c.base_value != 0)
    assert (a / c * c).dimension == a.dimension
    assert (a / c * c).base_value == pytest.approx(a.base_value, rel=1e-12)


def test_the_largest_number_stays_finite_in_its_unit_and_in_words():
    largest = Quantity(sys.float_info.max)
    assert largest.to("") == sys.float_info.max
    assert spell(largest) == "1.79769313486e+308"


def test_the_largest_number_has_no_number_in_a_smaller_unit():
    with pytest.raises(QuantityError, match="is not a finite number"):
        parse("1e308 g").to("mg")


@pytest.mark.parametrize("by", [operator.mul, operator.truediv])
def test_an_exponent_that_no_unit_is_written_with_is_refused(by):
    one, other = parse("1 m^5"), parse("1 m^5") if by is operator.mul else parse("1 1/m^5")
    with pytest.raises(QuantityError, match="has a unit with an exponent beyond 9"):
        by(one, other)


@pytest.mark.parametrize(
    ("text", "unit", "problem"),
    [
        ("20 °", "°C", "is in °, expected a quantity in °C; write 20 °C"),
        ("3 °/min", "°C/min", "is in °/s, expected a quantity in °C/min; write 3 °C/min"),
        ("20 deg", "°C", "is in °, expected a quantity in °C"),
        ("20 °", "V", "is in °, expected a quantity in V"),
    ],
)
def test_degrees_of_angle_for_a_temperature_say_what_to_write(text, unit, problem):
    with pytest.raises(QuantityError, match=f"^{re.escape(problem)}$"):
        parse(text).to(unit)


def test_mega_is_for_units_that_come_in_millions():
    assert [parse(text).base_value for text in ("1 MHz", "1 MΩ", "1 Mohm", "1 MPa", "1 Mpulse/s")] == [1e6] * 5
