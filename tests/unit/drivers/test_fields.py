"""Fields of models: what a document may say in each of them, and what a technician reads where it may not."""

from __future__ import annotations

import datetime as dt
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import AfterValidator, Field, TypeAdapter, ValidationError, create_model

from drivers.quantity.quantities import Quantity, parse
from drivers.schema.fields import (
    DEFERRED,
    NOT_EMPTY,
    Celsius,
    CelsiusPerMinute,
    Date,
    FileBeside,
    Flag,
    Instant,
    InUnit,
    Name,
    Number,
    PositiveSeconds,
    Range,
    Ratio,
    Seconds,
    Spelled,
    StrictModel,
    TextLike,
    WholeNumber,
    keys_of,
)
from drivers.schema.suggest import did_you_mean, nearest
from drivers.schema.wording import value_text

Tilt = Annotated[float, InUnit("°", at_least=-30, at_most=30)]
Axis = Annotated[str, TextLike("[XYZ]", "the name of an axis such as X")]

BESIDE = "beside this one; a copied file needs what it names as well"


def read(kind: Any, raw: object, context: dict[str, Any] | None = None) -> Any:
    return create_model("Block", __base__=StrictModel, x=(kind, ...)).model_validate({"x": raw}, context=context).x


def refusals(model: type[StrictModel], raw: object, context: dict[str, Any] | None = None) -> list[tuple[Any, ...]]:
    with pytest.raises(ValidationError) as caught:
        model.model_validate(raw, context=context)
    return [(*item["loc"], item["msg"]) for item in caught.value.errors()]


def refusal(kind: Any, raw: object, context: dict[str, Any] | None = None) -> str:
    found = refusals(create_model("Block", __base__=StrictModel, x=(kind, ...)), {"x": raw}, context)
    assert len(found) == 1
    return str(found[0][-1])


# Numbers in a unit


@pytest.mark.parametrize(
    ("kind", "raw", "number"),
    [
        (Seconds, "1 h 30 min", 5400.0),
        (Seconds, "0 s", 0.0),
        (Seconds, "100 ms", 0.1),
        (Seconds, parse("5 s"), 5.0),
        (Celsius, "−40 °C", -40.0),
        (CelsiusPerMinute, "60 °C/h", 1.0),
        (Ratio, "2 %", 0.02),
        (Ratio, "0.5", 0.5),
        (Ratio, 0.5, 0.5),
        (Ratio, 5, 5.0),
        (Ratio, Quantity(0.25), 0.25),
        (Tilt, "30°", 30.0),
        (Tilt, "-30°", -30.0),
    ],
)
def test_a_field_holds_the_number_in_its_own_unit(kind, raw, number):
    held = read(kind, raw)
    assert held == number
    assert isinstance(held, float)


@pytest.mark.parametrize(
    ("kind", "raw", "problem"),
    [
        (Seconds, 5, "5 has no unit, write it like '5 s'"),
        (Seconds, 5.5, "5.5 has no unit, write it like '5.5 s'"),
        (Seconds, "5", "'5' has no unit, write it like '5 s'"),
        (Seconds, "50 %", "'50 %' is a ratio, expected a quantity in s"),
        (
            Celsius,
            "–20 °C",
            "'–20 °C' is not a quantity; a dash is used as minus sign: write -20 °C; expected a quantity in °C",
        ),
        (Celsius, "20 °", "is in °, expected a quantity in °C; write 20 °C"),
        (Seconds, "5 V", "is in V, expected a quantity in s"),
        (Seconds, parse("5 V"), "is in V, expected a quantity in s"),
        (Seconds, Quantity(5.0), "is a bare number, expected a quantity in s"),
        (Seconds, "soon", "'soon' is not a quantity; if it is a parameter, write ${soon}; expected a quantity in s"),
        (Seconds, "1e999 s", "is not a finite number; expected a quantity in s"),
        (Seconds, math.nan, "is nan, expected a quantity in s"),
        (Seconds, True, "is true, expected a quantity in s"),
        (Seconds, None, "is empty, expected a quantity in s"),
        (Seconds, "", "is empty, expected a quantity in s"),
        (Seconds, [], "is empty, expected a quantity in s"),
        (Seconds, {}, "is empty, expected a quantity in s"),
        (Seconds, ["5 s"], "is a list, expected a quantity in s"),
        (Seconds, {"s": 5}, "is a mapping, expected a quantity in s"),
        (Celsius, "20 K", "kelvin is refused: write °C, for a difference too; expected a quantity in °C"),
        (Celsius, "1 °C/min", "is in °C/min, expected a quantity in °C"),
        (Ratio, "5 V", "is in V, expected a number without a unit"),
        (
            Ratio,
            "half",
            "'half' is not a quantity; if it is a parameter, write ${half}; expected a number without a unit",
        ),
        (Ratio, math.inf, "is inf, expected a number without a unit"),
        (Ratio, False, "is false, expected a number without a unit"),
    ],
)
def test_what_is_no_number_in_the_unit_is_refused_with_what_was_expected(kind, raw, problem):
    assert refusal(kind, raw) == problem


@pytest.mark.parametrize(
    ("kind", "raw", "problem"),
    [
        (Seconds, "-1 ms", "is -0.001 s, expected at least 0 s"),
        (PositiveSeconds, "0 min", "is 0 s, expected more than 0 s"),
        (Tilt, "31°", "is 31 °, expected at most 30 °"),
        (Tilt, "-1 turn", "is -360 °, expected at least -30 °"),
        (Annotated[float, InUnit("", at_most=1)], "120 %", "is 1.2, expected at most 1"),
        (Annotated[float, InUnit("A/g", not_zero=True)], "0 mA/g", "is 0 A/g, expected a number other than 0"),
    ],
)
def test_a_number_outside_its_bounds_is_shown_in_the_unit_of_the_field(kind, raw, problem):
    assert refusal(kind, raw) == problem


def test_an_expression_is_not_a_number_yet_while_a_sequence_is_checked():
    assert math.isnan(read(PositiveSeconds, "${2 * dwell}", DEFERRED))
    assert read(PositiveSeconds, "5 s", DEFERRED) == 5.0
    assert refusal(PositiveSeconds, "0 s", DEFERRED) == "is 0 s, expected more than 0 s"
    assert refusal(PositiveSeconds, "${dwell}") == "'${dwell}' is not a quantity; expected a quantity in s"
    assert refusal(PositiveSeconds, "${dwell}", {"deferred": False}).startswith("'${dwell}' is not a quantity")


# Other scalars


@pytest.mark.parametrize(
    ("kind", "raw", "value"),
    [
        (Flag, True, True),
        (Flag, False, False),
        (WholeNumber, 7, 7),
        (Number, 7, 7.0),
        (Number, 7.5, 7.5),
        (Name, "a", "a"),
        (Name, "unit_temperature_2", "unit_temperature_2"),
        (Name, "a" * 32, "a" * 32),
        (Axis, "Y", "Y"),
        (Spelled, "007", "007"),
        (Spelled, 510, "510"),
        (Date, "2026-01-31", dt.date(2026, 1, 31)),
        (Date, "2028-02-29", dt.date(2028, 2, 29)),
        (Instant, "2026-01-31T08:00:00Z", dt.datetime(2026, 1, 31, 8, tzinfo=dt.UTC)),
        (Instant, "2026-01-31T08:00:00.5+08:00", dt.datetime(2026, 1, 31, 0, 0, 0, 500_000, tzinfo=dt.UTC)),
    ],
)
def test_a_scalar_is_taken_as_it_is_written(kind, raw, value):
    held = read(kind, raw)
    assert held == value
    assert type(held) is type(value)


def test_an_instant_is_kept_in_utc():
    assert read(Instant, "2026-01-31T08:00:00+08:00").isoformat() == "2026-01-31T00:00:00+00:00"


A_NAME = "a name: at most 32 lower-case letters, digits and _, a letter first"
AN_INSTANT = "a time with its zone like 2026-01-31T08:00:00Z"


@pytest.mark.parametrize(
    ("kind", "raw", "problem"),
    [
        (Flag, "true", "is 'true', expected true or false"),  # in quotes it is text
        (Flag, "on", "is 'on', expected true or false"),
        (Flag, 1, "is 1, expected true or false"),
        (Flag, None, "is empty, expected true or false"),
        (WholeNumber, 1.0, "is 1.0, expected a whole number"),
        (WholeNumber, 1.5, "is 1.5, expected a whole number"),
        (WholeNumber, "1", "is '1', expected a whole number"),
        (WholeNumber, True, "is true, expected a whole number"),
        (WholeNumber, [1], "is a list, expected a whole number"),
        (Number, "1", "is '1', expected a number"),
        (Number, True, "is true, expected a number"),
        (Name, "Chamber", f"is 'Chamber', expected {A_NAME}"),
        (Name, "2nd", f"is '2nd', expected {A_NAME}"),
        (Name, "_a", f"is '_a', expected {A_NAME}"),
        (Name, "a-b", f"is 'a-b', expected {A_NAME}"),
        (Name, "a" * 33, f"is '{'a' * 33}', expected {A_NAME}"),
        (Name, "kühler", f"is 'kühler', expected {A_NAME}"),
        (Name, "a\n", f"is 'a\\n', expected {A_NAME}"),
        (Name, "", f"is empty, expected {A_NAME}"),
        (Name, 5, "is 5, expected text; put it in quotes"),
        (Name, True, "is true, expected text; put it in quotes"),
        (Name, None, "is empty, expected text"),
        (Name, [], "is empty, expected text"),
        (Axis, "W", "is 'W', expected the name of an axis such as X"),
        (Spelled, 5.10, "put it in quotes, so that it is kept as it is written"),
        (Spelled, True, "is true, expected text; put it in quotes"),
        (Spelled, ["a"], "is a list, expected text"),
        (Date, "2026-02-30", "is '2026-02-30', expected a date like 2026-01-31"),
        (Date, "31.01.2026", "is '31.01.2026', expected a date like 2026-01-31"),
        (Date, "2026-1-31", "is '2026-1-31', expected a date like 2026-01-31"),
        (Date, "20260131", "is '20260131', expected a date like 2026-01-31"),
        (Date, "2026-W05-1", "is '2026-W05-1', expected a date like 2026-01-31"),
        (Date, "2026-01-31T00:00:00Z", "is '2026-01-31T00:00:00Z', expected a date like 2026-01-31"),
        (Date, 2026, "is 2026, expected a date like 2026-01-31"),
        (Instant, "2026-01-31T08:00:00", f"is '2026-01-31T08:00:00', expected {AN_INSTANT}"),
        (Instant, "2026-01-31", f"is '2026-01-31', expected {AN_INSTANT}"),
        (Instant, "0001-01-01T00:00:00+14:00", f"is '0001-01-01T00:00:00+14:00', expected {AN_INSTANT}"),
        (Instant, "now", f"is 'now', expected {AN_INSTANT}"),
        (Instant, 0, f"is 0, expected {AN_INSTANT}"),
    ],
)
def test_another_scalar_is_refused_with_what_stands_there_and_what_was_expected(kind, raw, problem):
    assert refusal(kind, raw) == problem


@pytest.mark.parametrize(
    ("kind", "raw", "problem"),
    [
        (Literal["low", "high"], "lo", "is 'lo', expected 'low' or 'high'"),
        (Annotated[str, Field(min_length=1)], "", "is empty, expected text"),
        (Annotated[str, Field(max_length=3)], "abcd", "is 'abcd', expected at most 3 characters"),
        (Annotated[Number, Field(gt=0)], 0, "is 0, expected more than 0"),
        (Annotated[Number, Field(ge=0.5)], 0.25, "is 0.25, expected at least 0.5"),
        (Annotated[Number, Field(lt=4)], 4, "is 4, expected less than 4"),
        (Annotated[Number, Field(le=4)], 5, "is 5, expected at most 4"),
        (Annotated[float, Field(allow_inf_nan=False)], math.inf, "is inf, expected a finite number"),
        (int, "x", "is 'x', expected a whole number"),
        (int, 1.5, "is 1.5, expected a whole number"),
        (int, "9" * 5000, f"is '{'9' * 27}...{'9' * 28}', expected a whole number with fewer digits"),
        (float, "x", "is 'x', expected a number"),
        (bool, "x", "is 'x', expected true or false"),
        (bool, ["x"], "is a list, expected true or false"),
        (dict[str, int], 5, "is 5, expected a mapping"),
        (dict[str, int], [], "is empty, expected a mapping"),
        (tuple[int, ...], "x", "is 'x', expected a list"),
        (list[int], {"a": 1}, "is a mapping, expected a list"),
        (Annotated[int, Field(multiple_of=5)], 4, "Input should be a multiple of 5"),  # unknown to the table: as it is
    ],
)
def test_the_findings_of_pydantic_are_told_in_plain_words(kind, raw, problem):
    assert refusal(kind, raw) == problem


def test_the_message_of_a_plain_value_error_is_told_as_it_is():
    def refuse(raw: object) -> object:
        raise ValueError("the cable is too short")

    assert refusal(Annotated[str, AfterValidator(refuse)], "x") == "the cable is too short"


def test_a_collection_that_needs_something_in_it_says_so():
    assert refusal(Annotated[dict[str, int], NOT_EMPTY], {}) == "is empty, expected at least one"
    assert refusal(Annotated[tuple[int, ...], NOT_EMPTY], []) == "is empty, expected at least one"
    assert refusal(Annotated[tuple[int, ...], NOT_EMPTY], None) == "is empty, expected a list"
    assert read(Annotated[tuple[int, ...], NOT_EMPTY], [5]) == (5,)


def test_a_long_text_is_shown_without_its_middle_and_a_control_character_as_an_escape():
    assert value_text("a" * 200) == f"'{'a' * 27}...{'a' * 28}'"
    assert value_text("a\n\x1b") == "'a\\n\\x1b'"
    assert value_text(("a",)) == "a list"


# Files


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    inside = tmp_path / "bench"
    (inside / "uut").mkdir(parents=True)
    (inside / "counter.dbc").touch()
    (inside / "uut" / "unit.yaml").touch()
    (tmp_path / "other.dbc").touch()
    (inside / "link.dbc").symlink_to("counter.dbc")
    (inside / "out.dbc").symlink_to("../other.dbc")
    (inside / "loop.dbc").symlink_to("loop.dbc")
    return inside


Beside = Annotated[Path, FileBeside()]


@pytest.mark.parametrize(
    ("raw", "file"),
    [
        ("counter.dbc", "counter.dbc"),
        ("./counter.dbc", "counter.dbc"),
        ("uut/unit.yaml", "uut/unit.yaml"),
        ("uut/../counter.dbc", "counter.dbc"),
        ("link.dbc", "counter.dbc"),
    ],
)
def test_a_file_is_found_beside_the_document_or_below_it(folder, raw, file):
    assert read(Beside, raw, {"folder": folder}) == folder / file


@pytest.mark.parametrize(
    ("raw", "problem"),
    [
        ("../other.dbc", "'../other.dbc' leaves the folder of this file"),
        ("out.dbc", "'out.dbc' leaves the folder of this file"),
        ("/etc/hostname", "'/etc/hostname' leaves the folder of this file"),
        ("a\0b", "'a\\x00b' cannot be read (no file can have this name)"),
        ("a\ud800b", "'a\\ud800b' cannot be read (no file can have this name)"),
        ("", "is empty, expected the name of a file beside this one"),
        (5, "is 5, expected the name of a file beside this one"),
        (["counter.dbc"], "is a list, expected the name of a file beside this one"),
    ],
)
@pytest.mark.parametrize("files_needed", [True, False])
def test_a_file_elsewhere_is_refused_whether_it_is_needed_or_not(folder, raw, problem, files_needed):
    assert refusal(Beside, raw, {"folder": folder, "files_needed": files_needed}) == problem


def test_a_link_to_itself_is_refused(folder):
    problem = "'loop.dbc' cannot be read (Too many levels of symbolic links)"
    assert refusal(Beside, "loop.dbc", {"folder": folder}) == problem
    assert refusal(Beside, "loop.dbc/x", {"folder": folder, "files_needed": False}) == problem.replace(".dbc", ".dbc/x")


def test_a_name_longer_than_the_file_system_takes_is_refused(folder):
    problem = f"'{'x' * 27}...{'x' * 28}' cannot be read (File name too long)"
    assert refusal(Beside, "x" * 300, {"folder": folder}) == problem


def test_a_missing_file_is_refused_unless_the_document_is_only_kept(folder):
    assert refusal(Beside, "countr.dbc", {"folder": folder}) == f"there is no file 'countr.dbc' {BESIDE}"
    assert refusal(Beside, "uut", {"folder": folder}) == f"there is no file 'uut' {BESIDE}"
    assert read(Beside, "countr.dbc", {"folder": folder, "files_needed": False}) == folder / "countr.dbc"


def test_without_a_document_there_is_nothing_a_file_could_be_beside():
    assert refusal(Beside, "counter.dbc") == "is 'counter.dbc', expected the name of a file beside this one"


# Models


class Window(Range):
    min: Celsius | None = None
    max: Celsius


class Soak(StrictModel):
    reading: Name
    dwell_time: Seconds = 0.0
    window: Window | None = None
    from_: Name = Field("a", alias="from")


def test_a_range_goes_upwards():
    assert Window.model_validate({"min": "-50 °C", "max": "100 °C"}).min == -50
    assert Window.model_validate({"max": "100 °C"}).min is None
    for low in ("100 °C", "101 °C"):
        assert refusals(Window, {"min": low, "max": "100 °C"}) == [("min is not below max",)]


@pytest.mark.parametrize(
    ("raw", "problems"),
    [
        ({}, [("reading", "is missing")]),
        ({"reading": "a", "zzz": 1}, [("zzz", "unknown key; expected reading, dwell_time, window or from")]),
        ({"readng": "a"}, [("readng", "unknown key; did you mean 'reading'?")]),  # and not that one is missing
        ({"readng": "a", "reading": "b"}, [("readng", "unknown key; did you mean 'reading'?")]),
        ({"reading": "a", "form": "b"}, [("form", "unknown key; did you mean 'from'?")]),
        ({"reading": "a", "from_": "b"}, [("from_", "unknown key; did you mean 'from'?")]),
        (
            {"dwel_time": "1 V"},
            [("reading", "is missing"), ("dwel_time", "unknown key; did you mean 'dwell_time'?")],
        ),
        (
            {"reading": "A", "dwell_time": 5, "window": {"mx": "5 °C", "min": "5 V"}},
            [
                ("reading", f"is 'A', expected {A_NAME}"),
                ("dwell_time", "5 has no unit, write it like '5 s'"),
                ("window", "min", "is in V, expected a quantity in °C"),
                ("window", "mx", "unknown key; did you mean 'max'?"),
            ],
        ),
        (None, [("is empty, expected a mapping",)]),
        ([1], [("is a list, expected a mapping",)]),
        ("text", [("is 'text', expected a mapping",)]),
    ],
)
def test_a_model_tells_all_its_problems_at_once_and_each_mistake_once(raw, problems):
    assert refusals(Soak, raw) == problems


def test_a_model_cannot_be_changed():
    soak = Soak.model_validate({"reading": "a"})
    with pytest.raises(ValidationError, match="Instance is frozen"):
        soak.reading = "b"


def test_the_keys_of_a_model_are_those_of_the_document():
    assert keys_of(Soak) == ["reading", "dwell_time", "window", "from"]


def test_a_field_type_stands_alone_as_well():
    assert TypeAdapter(Seconds).validate_python("2 min") == 120.0


# Suggestions


@pytest.mark.parametrize(
    ("name", "known", "tail"),
    [
        ("chambre", ["head", "chamber"], "; did you mean 'chamber'?"),
        ("zzz", ["head", "chamber", "head"], "; expected head or chamber"),
        ("zzz", ["a", "b", "c"], "; expected a, b or c"),
        ("zzz", ["head"], "; expected head"),
        ("zzz", [], "; none is known here"),
    ],
)
def test_a_misspelt_name_is_told_the_nearest_or_all_that_are_known(name, known, tail):
    assert did_you_mean(name, known) == tail


def test_a_name_far_from_all_has_no_nearest():
    assert nearest("zzz", ["head"]) is None
    assert nearest("hed", ["head"]) == "head"
