"""Expressions `${…}`: what they are worth, what is refused word for word, and that nothing else is ever evaluated."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.sequence.language.expressions import LENGTH_LIMIT, ValueProblem, evaluate, scalar_of
from bench.sequence.language.values import in_words
from drivers.quantity.quantities import Quantity, parse
from drivers.quantity.units import quoted

TOO_LARGE = "is too deep or too large to be evaluated"
NAMES = {
    "temperature": parse("20 °C"), "t": parse("2 s"), "n": parse("3"), "zero": parse("0"), "big": parse("1e308"),
    "flag": True, "mode": "fast", "angles": (parse("0°"), parse("90°")),
}  # fmt: skip
UNDERSTOOD = (
    "expected numbers, names, + - * /, comparisons, and, or, not, if else, "
    "abs, min, max, round, sqrt, sin, cos, len"
)  # fmt: skip


def refusal(expression: str) -> str:
    with pytest.raises(ValueProblem) as caught:
        evaluate(expression, NAMES)
    return str(caught.value)


# Values


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1 + 2", "3"),
        ("2 * 3 - 4 / 8", "5.5"),
        ("(1 + 2) * 3", "9"),
        ("-n", "-3"),
        ("+n", "3"),
        ("temperature + '5 °C'", "25 °C"),
        ("'100 °C' - temperature", "80 °C"),
        ("'2 °C/min' * '30 min'", "60 °C"),
        ("temperature / '2 °C/min'", "600 s"),
        ("2 * t", "4 s"),
        ("1 / t", "0.5 Hz"),
        ("1 + '50 %'", "1.5"),
        ("abs(-t)", "2 s"),
        ("min(3, n, 2)", "2"),
        ("max(angles)", "90 °"),
        ("max(angles, '100°')", "100 °"),
        ("min(angles, '-5°')", "-5 °"),
        ("round(2.4)", "2"),
        ("round(2.5)", "2"),  # to even, as Python and IEEE 754 round
        ("round(-3.5)", "-4"),
        ("sqrt(16)", "4"),
        ("sqrt(t * t)", "2 s"),
        ("sqrt('4 m²/s²') * t", "4 m"),
        ("sin('30°')", "0.5"),
        ("cos('60°')", "0.5"),
        ("cos('0.5 turn')", "-1"),
        ("len(angles)", "2"),
        ("len(angles) == 2", "true"),
        ("angles", "0 °, 90 °"),
        ("angles + '5°'", "5 °, 95 °"),
        ("'5°' - angles", "5 °, -85 °"),
        ("2 * angles / n", "0 °, 60 °"),
        ("mode", "fast"),
        ("  n  ", "3"),
        ("ｎ", "3"),  # full-width, which Python and our quantities take for the same letter
        ("True", "true"),
        ("'fast'", "fast"),
    ],
)
def test_an_expression_has_a_value_with_its_unit(expression, value):
    assert in_words(evaluate(expression, NAMES)) == value


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("n > 2", True),
        ("n >= 3", True),
        ("n < 3", False),
        ("n <= 2", False),
        ("1 < n < 5", True),
        ("t == '2000 ms'", True),
        ("t != '2 s'", False),
        ("mode == 'fast'", True),
        ("mode != 'fast'", False),
        ("mode == flag", False),
        ("angles == angles", True),
        ("not flag", False),
        ("flag and n > 5", False),
        ("flag or 1 / zero > 1", True),  # what does not matter is not worked out
        ("not flag and 1 / zero > 1", False),
        ("flag and n == 3 and mode == 'fast'", True),
    ],
)
def test_comparisons_are_true_or_false(expression, value):
    assert evaluate(expression, NAMES) is value


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("n if flag else 4", "3"),
        ("temperature if n == 4 else mode", "fast"),
        ("1 if flag else 1 / zero", "1"),
    ],
)
def test_a_choice_works_out_only_what_it_takes(expression, value):
    assert in_words(evaluate(expression, NAMES)) == value


def test_a_calculation_keeps_the_last_bit_of_what_was_written():
    assert evaluate("'0.1 °C' + '0.2 °C'", {}).to("°C") == 0.3
    assert evaluate("'90°' + '1°'", {}).to("°") == 91


# Refusals


@pytest.mark.parametrize(
    ("expression", "reason"),
    [
        ("temprature", "there is no name 'temprature'; did you mean 'temperature'?"),
        ("n + m", "there is no name 'm'; expected temperature, t, n, zero, big, flag, mode or angles"),
        ("nn if flag else 1", "there is no name 'nn'; did you mean 'n'?"),
        ("abs", "there is no name 'abs'; expected temperature, t, n, zero, big, flag, mode or angles"),
        ("absolute(n)", "there is no function 'absolute'; expected abs, min, max, round, sqrt, sin, cos or len"),
        ("sqr(n)", "there is no function 'sqr'; did you mean 'sqrt'?"),
        ("n(3)", "there is no function 'n'; expected abs, min, max, round, sqrt, sin, cos or len"),
    ],
)
def test_an_unknown_name_is_told_with_what_is_meant(expression, reason):
    assert refusal(expression) == f"'${{{expression}}}': {reason}"


@pytest.mark.parametrize(
    ("expression", "reason"),
    [
        ("1 / 0", "division by zero"),
        ("n / zero", "division by zero"),
        ("1 / (n - 3)", "division by zero"),
        ("t + n", "cannot add s and a bare number"),
        ("temperature - t", "cannot subtract °C and s"),
        ("t < n", "cannot compare s and a bare number"),
        ("min(angles, t)", "cannot compare ° and s"),
        ("big * 10", "is not a finite number"),
        ("big + big", "is not a finite number"),
        ("1e999", "is inf, expected a value"),
        ("mode * 2", "'fast' is not a quantity"),
        ("mode == n", "'fast' is not a quantity"),
        ("-mode", "'fast' is not a quantity"),
        ("angles + angles", "a list is not a quantity"),
        ("angles == n", "a list is not a quantity"),
        ("round(t)", "is in s, expected a number without a unit"),
        ("sin(1)", "is a bare number, expected a quantity in °"),
        ("sqrt(-1)", "the square root of a negative quantity"),
        ("len(n)", "len needs a list"),
        ("abs(1, 2)", "a function has too many or too few arguments"),
        ("min()", "a function has too many or too few arguments"),
        ("None", "is empty, expected a value"),
        ("1j", "is '1j', expected a value"),
    ],
)
def test_what_cannot_be_worked_out_is_told_with_the_expression(expression, reason):
    assert refusal(expression) == f"'${{{expression}}}': {reason}"


@pytest.mark.parametrize(
    ("expression", "reason"),
    [
        ("'5 K' + t", "kelvin is refused: write °C, for a difference too"),
        ("sqrt(sqrt(sqrt(sqrt('1 s^0.1'))))", "has a unit with an exponent of more than 4 decimals"),
        ("'1 m^5' * '1 m^5'", "has a unit with an exponent beyond 9"),
        ("'1_0' + n", "'1_0' is not a quantity; write 1500 or 1.5, nothing between the digits"),
        ("'5 apples'", "'apples' is not a known unit"),
        ("''", "is empty, expected a value"),
    ],
)
def test_a_constant_in_quotes_is_read_like_a_value_of_the_document(expression, reason):
    assert refusal(expression) == f'"${{{expression}}}": {reason}'


@pytest.mark.parametrize(
    ("expression", "what"),
    [
        ("1 if n else 2", "a quantity"),
        ("1 if mode else 2", "'fast'"),
        ("1 if angles else 2", "a list"),
        ("not mode", "'fast'"),
        ("not n", "a quantity"),
        ("not angles", "a list"),
        ("n and flag", "a quantity"),
        ("flag and mode", "'fast'"),
        ("mode or flag", "'fast'"),
    ],
)
def test_only_a_truth_is_true_or_false(expression, what):
    """`default: off` is text in a document: were text true, a switched-off option would be on."""
    assert refusal(expression) == f"'${{{expression}}}': {what} is neither true nor false; compare it with another"


@pytest.mark.parametrize(
    "expression",
    [
        "n.real", "n.__class__", "''.join", "angles[0]", "[1, 2]", "(1, 2)", "{1}", "{1: 2}", "2**3", "9**9**9**9",
        "7 % 2", "7 // 2", "n @ n", "~n", "n & 1", "n | 1", "n ^ 1", "n << 3", "lambda: 1", "[x for x in angles]",
        "f'{n}'", "n is n", "n in angles", "n not in angles", "(y := 3)", "abs(x=1)", "abs(*angles)", "abs(**n)",
        "(1)(2)", "abs(1)(2)", "(lambda: 1)()", "n.real()", "''.__class__.__mro__[1].__subclasses__()",
        "().__class__.__bases__[0]",
    ],
)  # fmt: skip
def test_all_else_of_python_is_refused_before_it_is_evaluated(expression):
    assert refusal(expression).endswith(f": {UNDERSTOOD}")


@pytest.mark.parametrize("expression", ["open('x')", "__import__('os')", "eval('1')", "exec('1')", "print(n)"])
def test_a_function_of_python_is_no_function_here(expression):
    name = expression.partition("(")[0]
    assert f": there is no function '{name}'" in refusal(expression)


@pytest.mark.parametrize("expression", ["__class__", "__builtins__", "__name__"])
def test_a_name_of_python_is_no_name_here(expression):
    assert f": there is no name '{expression}'" in refusal(expression)


@pytest.mark.parametrize(
    "expression",
    ["", "  ", "1 +", "a b", "1;2", "x = 1", "if", "010", "٣", "\x00", "1\n2", ")", "*n", "yield n"],
)
def test_what_is_no_expression_is_told_with_what_one_may_hold(expression):
    shown = repr(f"${{{expression}}}")
    assert refusal(expression) in (f"{shown}: is not an expression; {UNDERSTOOD}", f"{shown}: {UNDERSTOOD}")


@pytest.mark.parametrize(
    ("expression", "bare"),
    [
        ("20 °C", "20 °C"),
        ("n > 5 s", "5 s"),
        ("'1 V' + 1.5mA/s", "1.5mA/s"),
        ("(30 °C/min)*n", "30 °C/min"),
        ("5°", "5°"),
    ],
)
def test_a_quantity_without_quotes_is_told_to_stand_in_quotes(expression, bare):
    shown = quoted(f"${{{expression}}}")
    assert refusal(expression) == f"{shown}: is not an expression; a quantity stands in quotes: '{bare}'"


@pytest.mark.parametrize("expression", ["5 if n else", "1 and", "n == 2 or", "'5 °C' >"])
def test_a_slip_beside_a_quantity_is_not_taken_for_one_without_quotes(expression):
    assert refusal(expression).endswith(f": is not an expression; {UNDERSTOOD}")


def test_escapes_of_python_are_refused():
    assert refusal(r"'\ud800'") == r""""${'\\ud800'}": a backslash has no meaning in an expression"""


@pytest.mark.parametrize(
    ("expression", "reason"),
    [
        ("1+" * 250 + "1", f"has more than {LENGTH_LIMIT} characters"),
        ("(" * 249 + "1" + ")" * 249, f"is not an expression; {UNDERSTOOD}"),
        ("9" * 400, TOO_LARGE),
    ],
)
def test_the_very_long_and_the_very_deep_are_refused(expression, reason):
    assert refusal(expression) == f"{quoted(f'${{{expression}}}')}: {reason}"


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("abs(" * 99 + "1" + ")" * 99, "1"),
        ("-" * 499 + "n", "-3"),
        ("n" + "+n" * 249, "750"),
        ("not " * 120 + "flag", "true"),
        ("1 <= " * 99 + "1", "true"),
    ],
)
def test_the_deep_is_worked_out_or_refused_where_the_stack_is_short(expression, value):
    try:
        found = in_words(evaluate(expression, NAMES))
    except ValueProblem as problem:
        found = str(problem)
    assert found in (value, f"{quoted(f'${{{expression}}}')}: {TOO_LARGE}")


# Scalars


@pytest.mark.parametrize(
    ("raw", "value"),
    [
        (20, Quantity(20.0)),
        (2.5, Quantity(2.5)),
        (True, True),
        ("20 °C", parse("20 °C")),
        ("−5 °C", parse("-5 °C")),
        ("1 h 30 min", parse("5400 s")),
        ("7", Quantity(7.0)),
        ("fast", "fast"),
        ("on", "on"),
        ("$t", "$t"),
        ("x5 V", "x5 V"),
        (parse("5 V"), parse("5 V")),
    ],
)
def test_text_that_is_a_quantity_is_one_and_other_text_stays_text(raw, value):
    assert scalar_of(raw) == value
    assert type(scalar_of(raw)) is type(value)


@pytest.mark.parametrize(
    ("raw", "problem"),
    [
        (None, "is empty, expected a value"),
        ("", "is empty, expected a value"),
        (math.nan, "is nan, expected a value"),
        (math.inf, "is inf, expected a value"),
        ({"a": 1}, "is a mapping, expected a value"),
        ("5 apples", "'apples' is not a known unit"),
        ("5 K", "kelvin is refused: write °C, for a difference too"),
        ("-x", "'-x' is not a quantity"),
        ("+x", "'+x' is not a quantity"),
        (".inf", "'.inf' is not a quantity"),
        ("0x10", "'x' in 'x10' is not a known unit"),
        ("½ h", "'½ h' contains '½'; write plain digits"),
        ("٣ V", "'٣ V' is not a quantity"),
    ],
)
def test_text_that_begins_like_a_number_must_be_a_quantity(raw, problem):
    with pytest.raises(ValueProblem) as caught:
        scalar_of(raw)
    assert str(caught.value) == problem


# Whatever is written


WORDS = st.sampled_from(
    [*NAMES, "1", "0", "1e300", "'5 s'", "'x'", "''", "None", "True", "abs", "min", "sqrt", "sin", "len", "round", "(",
     ")", ",", " + ", "-", "*", "/", "**", "//", "%", "<", "<=", "==", "!=", " and ", " or ", "not ", " if ", " else ",
     ".", "[", "]", "__class__", "lambda: ", ":", "=", "\\", "'", "#", "\n", "~"]
)  # fmt: skip


@settings(max_examples=600, deadline=None)
@given(st.text(max_size=30) | st.lists(WORDS, max_size=12).map("".join))
def test_any_expression_is_a_value_or_a_refusal_on_one_line(expression):
    problem = ""
    try:
        value = evaluate(expression, NAMES)
    except ValueProblem as refused:
        problem = str(refused)
    else:
        items = value if isinstance(value, tuple) else (value,)
        assert all(isinstance(item, (bool, str, Quantity)) for item in items)
    assert "\n" not in problem
