"""Documents: the values and places in a file of YAML, and a refusal of everything outside the small safe subset."""

from __future__ import annotations

import math
import os
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.config.document import SIZE_LIMIT_BYTES, Document, Mark, parse_document, read_document
from bench.errors import InputError

FILE = Path("f.yaml")


def value(text):
    return parse_document(text, FILE).value


def refusal(text):
    with pytest.raises(InputError) as caught:
        parse_document(text, FILE)
    return str(caught.value)


# Values


@pytest.mark.parametrize(
    ("scalar", "meant"),
    [
        ("5", 5),
        ("-5", -5),
        ("0", 0),
        ("9223372036854775807", 9223372036854775807),
        ("12345678901234567890", 12345678901234567890.0),
        ("1.50", 1.5),
        ("-0.25", -0.25),
        ("1e5", 100000.0),
        ("1.5E-3", 0.0015),
        ("1e-999", 0.0),
        ("true", True),
        ("false", False),
        ("null", None),
        ("~", None),
        ("", None),
    ],
)
def test_plain_decimal_numbers_true_false_and_null_are_values(scalar, meant):
    held = value(f"a: {scalar}")["a"]
    assert held == meant
    assert type(held) is type(meant)


@pytest.mark.parametrize(
    "scalar",
    ["on", "off", "yes", "no", "True", "NULL", "010", "0x10", "0o10", "+5", "1_000", "1:30", "1.", ".5", "5e", ".nan",
     ".inf", "-.inf", "NaN", "2026-01-01", "2026-01-01T00:00:00Z", "20 °C", "٥", "--", "${a[0]}", "a#b", "=", "-5-",
     "null null", "µg", "😀", "a\u00a0b"],
)  # fmt: skip
def test_every_other_plain_scalar_is_the_text_that_is_written(scalar):
    assert value(f"a: {scalar}") == {"a": scalar}


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("a: '5'", "5"),
        ('a: "true"', "true"),
        ("a: ''", ""),
        ("a: 'it''s'", "it's"),
        ('a: "tab\\tnew\\nline"', "tab\tnew\nline"),
        ("a: |\n  x\n   y\n", "x\n y\n"),
        ("a: >\n  x\n  y\n", "x y\n"),
        ("a: >-\n  x\n\n  y\n", "x\ny"),
        ("a: x\n  y", "x y"),
        ("a: x # a comment", "x"),
    ],
)
def test_quoted_block_and_folded_scalars_are_text(text, meant):
    assert value(text) == {"a": meant}


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("", None),
        ("# nothing but this\n", None),
        ("---\n", None),
        ("text", "text"),
        ("- a\n- 5\n", ["a", 5]),
        ("a: 1\nb:\n  c: [2, {d: 3}]\n", {"a": 1, "b": {"c": [2, {"d": 3}]}}),
        ("a:\n- b: 1\n  c: 2\n- d\n", {"a": [{"b": 1, "c": 2}, "d"]}),
        ("a: {}\nb: []\n", {"a": {}, "b": []}),
        ("{a, b: 1,}", {"a": None, "b": 1}),
        ("? a\n: b\n", {"a": "b"}),
        ("---\na: 1\n...\n", {"a": 1}),
        ("%YAML 1.1\n---\na: yes\n", {"a": "yes"}),
        ("a: 1\r\nb: 2\r\n", {"a": 1, "b": 2}),
        ("a: 1\rb: 2\r", {"a": 1, "b": 2}),
        ("' a b ': 1", {" a b ": 1}),
    ],
)
def test_mappings_and_lists_are_plain_ones(text, meant):
    assert value(text) == meant


# Places


def test_every_part_has_its_place_a_key_where_it_begins_and_an_item_where_its_value_does():
    document = parse_document("# bench\na: 1\nb:\n  - x\n  - {c: 5, d: [6]}\n", FILE)
    assert document.marks == {
        (): Mark(2, 1),
        ("a",): Mark(2, 1),
        ("b",): Mark(3, 1),
        ("b", 0): Mark(4, 5),
        ("b", 1): Mark(5, 5),
        ("b", 1, "c"): Mark(5, 6),
        ("b", 1, "d"): Mark(5, 12),
        ("b", 1, "d", 0): Mark(5, 16),
    }


@pytest.mark.parametrize(
    ("text", "mark"),
    [("a: x\nb: y", "2:1"), ("a: x\r\nb: y", "2:1"), ("a: x\rb: y", "2:1"), ("{µ: °C, b: y}", "1:9")],
)
def test_lines_end_anyhow_and_columns_count_characters(text, mark):
    assert parse_document(text, FILE).where(("b",)) == f"f.yaml:{mark}"


def test_a_part_that_is_not_there_is_where_the_nearest_part_around_it_is():
    document = parse_document("a: 1\nb:\n  c: 2\n", FILE)
    assert document.where(("b", "c")) == "f.yaml:3:3"
    assert document.where(("b", "x", 3, "y")) == "f.yaml:2:1"
    assert document.where(("x",)) == "f.yaml:1:1"
    assert Document(FILE, "", None, {}).where(("x",)) == "f.yaml:1:1"


def test_problems_are_told_once_in_the_order_of_the_file():
    document = parse_document("a: 1\nb:\n  c: 2\nd: 3\n", FILE)
    problems = [(("d",), "late"), (("b", "c"), "middle"), (("a",), "two"), (("d",), "late"), (("a",), "one")]
    assert document.located(problems) == [
        "f.yaml:1:1: one",
        "f.yaml:1:1: two",
        "f.yaml:3:3: middle",
        "f.yaml:4:1: late",
    ]


# What is refused


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a: 1\nb: 2\na: 3\n", "f.yaml:3:1: the key 'a' stands twice; it is already in line 1"),
        ("a:\n  b: 1\n  b: 2\n", "f.yaml:3:3: the key 'b' stands twice; it is already in line 2"),
        ("- {a: 1, 'a': 2}", "f.yaml:1:10: the key 'a' stands twice; it is already in line 1"),
        ("1: x", "f.yaml:1:1: a key is text, found 1; put it in quotes"),
        ("a: {1.5: x}", "f.yaml:1:5: a key is text, found 1.5; put it in quotes"),
        ("true: x", "f.yaml:1:1: a key is text, found true; put it in quotes"),
        ("null: x", "f.yaml:1:1: a key is text, found empty; put it in quotes"),
        ("[a]: x", "f.yaml:1:1: a key is text, found a list"),
        ("? {a: 1}\n: x", "f.yaml:1:3: a key is text, found a mapping"),
        ("<<: {a: 1}", "f.yaml:1:1: merge keys (<<) are not part of this language; repeat the values"),
    ],
)
def test_keys_are_text_and_stand_once(text, problem):
    assert refusal(text) == problem


ANCHORS = "anchors (&) and aliases (*) are not part of this language; repeat the value, or put text in quotes"
TAGS = "tags (!) are not part of this language; put text in quotes"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a: &x 1", f"f.yaml:1:4: {ANCHORS}"),
        ("a: *x", f"f.yaml:1:4: {ANCHORS}"),
        ("&x {a: 1}", f"f.yaml:1:1: {ANCHORS}"),
        ("a: 1\n&b b: 1", f"f.yaml:2:1: {ANCHORS}"),
        ("a: &x [1]\nb: [*x, *x]", f"f.yaml:1:4: {ANCHORS}"),
        ("a: !!str 1", f"f.yaml:1:4: {TAGS}"),
        ("a: !!python/object/apply:os.system [ls]", f"f.yaml:1:4: {TAGS}"),
        ("a: ! 1", f"f.yaml:1:4: {TAGS}"),
        ("!!map {a: 1}", f"f.yaml:1:1: {TAGS}"),
        ("a: 1\nb: [!<" + "x" * 30_000 + "> 1]", f"f.yaml:2:5: {TAGS}"),
        ("%TAG ! tag:x,2000:\n---\na: 1", f"f.yaml:1:1: {TAGS}"),
        ("a: 1\n---\nb: 2\n", "f.yaml:2:1: a second document begins; one file holds one"),
        ("a: 1e999", "f.yaml:1:4: 1e999 is not a finite number"),
        ("a: [-1e999]", "f.yaml:1:5: -1e999 is not a finite number"),
    ],
)
def test_what_yaml_has_beyond_mappings_lists_and_scalars_is_refused(text, problem):
    assert refusal(text) == problem


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a:\n\tb: 1\n", "2:1: is not YAML: a tab stands where only spaces may; indent with spaces"),
        ("\ta: 1", "1:1: is not YAML: a tab stands where only spaces may; indent with spaces"),
        ("a: b: c", "1:5: is not YAML: a colon stands where none may; put text with ': ' in it in quotes"),
        ("a: 1\n b: 2", "2:3: is not YAML: a colon stands where none may; put text with ': ' in it in quotes"),
        ("a:\n  b: 1\n c: 2\n", "3:2: is not YAML: this line is not indented like those it belongs to"),
        ("a: 1\nb\nc: 2\n", "2:1: is not YAML: a key needs a colon and a space after it"),
        ("a: @x", "1:4: is not YAML: text cannot begin with this character; put it in quotes"),
        ("a: %x", "1:4: is not YAML: text cannot begin with this character; put it in quotes"),
        ("a: `x`", "1:4: is not YAML: text cannot begin with this character; put it in quotes"),
        ("a: **bold**", "1:5: is not YAML: text cannot begin with & or *; put it in quotes"),
        ("a: 1\n...\nb: 2\n", "3:1: is not YAML: the document has ended before this"),
        ("a: * x", "1:5: is not YAML: text cannot begin with & or *; put it in quotes"),
        (
            'a: "C:\\query"',
            "1:8: is not YAML: a backslash means something else in double quotes; put the text in single quotes",
        ),
        ("a: 'x", "1:4: is not YAML: a quotation mark is not closed"),
        ('a: "x\nb: 1\n', "1:4: is not YAML: a quotation mark is not closed"),
        ("a: [1, 2\nb: 3\n", "2:2: is not YAML: a comma is missing here, or a bracket is not closed"),
        ("a: 1\nb: [1, 2\n\n", "2:4: is not YAML: a comma is missing here, or a bracket is not closed"),
        ("a: {b: 1\nc: 3}", "2:2: is not YAML: a comma is missing here, or a brace is not closed"),
        ("a: {b: 1 c: 2}", "1:11: is not YAML: a comma is missing here, or a brace is not closed"),
        ("a: ]", "1:4: is not YAML: a value is expected here"),
        ("a: [1,, 2]", "1:7: is not YAML: a value is expected here"),
        ("a: - b", "1:4: is not YAML: a list of lines that begin with - begins on a line of its own"),
        ("{a: 1} b", "1:8: is not YAML: the document has ended before this"),
        ("a: |x\n", "1:5: is not YAML: expected chomping or indentation indicators, but found 'x'"),
        ("%YAML 3.0\n---\na", "1:1: is not YAML: found incompatible YAML document (version 1.* is required)"),
    ],
)
def test_what_is_not_yaml_is_refused_with_what_to_do(text, problem):
    assert refusal(text) == f"f.yaml:{problem}"


@pytest.mark.parametrize(
    ("text", "place", "code"),
    [
        ("a: \x00", "1:4", "0000"),
        ("a: 1\nb: x\x1b[31m", "2:5", "001B"),
        ("# \x07", "1:3", "0007"),
        ("a: x\x7f", "1:5", "007F"),
        ("a: x\x85y", "1:5", "0085"),  # a line end to some
        ("a: x\u2028y", "1:5", "2028"),
        ("a: 5\u200b00", "1:5", "200B"),  # no width at all
        ("a: x\u00ady", "1:5", "00AD"),
        ("a: x\u2060y", "1:5", "2060"),
        ("# \u202e", "1:3", "202E"),  # turns the order of what follows
        ("a: x\u2066y", "1:5", "2066"),
        ("a: x\U000e0041y", "1:5", "E0041"),
        ("a: \ud800", "1:4", "D800"),
        ("a: 1\ufeff", "1:5", "FEFF"),
        ('a: "\\x1b"', "1:4", "001B"),
        ('a: "\\u202e"', "1:4", "202E"),
        ('a: "\\ud800"', "1:4", "D800"),
        ('"\\0": 1', "1:1", "0000"),
    ],
)
def test_characters_that_a_screen_does_not_show_are_refused_even_as_escapes(text, place, code):
    assert refusal(text) == f"f.yaml:{place}: contains the invisible character U+{code}; remove it"


@pytest.mark.parametrize(
    ("text", "place"),
    [('a: 1\nb: "\\U00110000"', "2:1"), ('"\\UFFFFFFFF"', "1:1"), (f"%YAML 1.{'9' * 5000}\n--- 1", "1:1")],
)
def test_what_python_itself_chokes_on_is_refused_at_the_part_before_it(text, place):
    problem = "an escape that stands for no character, or a version far too long"
    assert refusal(text) == f"f.yaml:{place}: what follows here is not YAML: {problem}"


# Limits


DEEP = "is nested more than 20 deep"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[" * 21 + "]" * 21, f"1:1: {DEEP}"),
        ("a: 1\nb: " + "{a: " * 21 + "1" + "}" * 21, f"2:4: {DEEP}"),
        ("- " * 21 + "x", f"1:41: {DEEP}"),
        ("".join(" " * level + "a:\n" for level in range(21)), f"21:21: {DEEP}"),
        ("[[], " * 21, f"1:1: {DEEP}"),
        ("x: " + "y" * 4097, "1:4: is longer than 4096 characters"),
        (f"x: '{'y' * 4097}'", "1:4: is longer than 4096 characters"),
        ("x: |\n" + "  y\n" * 2049, "1:4: is longer than 4096 characters"),
        ("- 1\n" * 1500, "1500:3: has more than 1500 values"),
        ("{a: [1, 2], b: " + "[" + "1," * 1494 + "1]}", "1:3003: has more than 1500 values"),
        ("#\n" * 4000 + "\n", "4001:1: has more than 4000 lines"),
    ],
    ids=["brackets", "braces", "dashes", "lines", "siblings", "plain", "quoted", "block", "list", "keys", "many lines"],
)
def test_a_document_beyond_a_limit_is_refused_where_it_passes_it(text, problem):
    assert refusal(text) == f"f.yaml:{problem}"


def test_a_document_at_a_limit_is_read():
    assert value("[" * 20 + "]" * 20) is not None
    assert value("{a: " * 20 + "1" + "}" * 20) is not None
    assert value("x: " + "y" * 4096) == {"x": "y" * 4096}
    assert len(value("- 1\n" * 1499)) == 1499  # and the list itself
    assert value("#\n" * 3999 + "1\n") == 1


@pytest.mark.parametrize("text", ["[" * 10_000, "{a: " * 10_000, "[a, " * 10_000, "{" * 10_000, "a: [\n" * 10_000])
def test_nesting_ten_thousand_deep_is_refused_within_a_tenth_of_a_second(text):
    began_s = time.process_time()
    problem = refusal(text)
    assert time.process_time() - began_s < 0.1
    assert problem.endswith(DEEP)


# Files


def read_refusal(path):
    with pytest.raises(InputError) as caught:
        read_document(path)
    return str(caught.value)


def written(tmp_path, content: bytes):
    path = tmp_path / "f.yaml"
    path.write_bytes(content)
    return path


def test_a_file_is_read_with_or_without_a_byte_order_mark(tmp_path):
    for content in (b"a: 20 \xc2\xb0C\n", b"\xef\xbb\xbfa: 20 \xc2\xb0C\n"):
        document = read_document(written(tmp_path, content))
        assert document.value == {"a": "20 °C"}
        assert document.text == "a: 20 °C\n"
        assert document.marks["a",] == Mark(1, 1)


def test_a_file_keeps_its_text_as_it_is(tmp_path):
    assert read_document(written(tmp_path, b"a: 1\r\n")).text == "a: 1\r\n"


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("title: Prüfstand".encode("latin-1"), 1),
        (b"a: 1\nb: 2\nc: \xb0\n", 3),
        ("a: 1\n".encode("utf-16"), 1),
        (b"a: \xed\xa0\x80", 1),  # half of a surrogate pair
    ],
)
def test_a_file_that_is_not_utf_8_is_refused_with_its_line(tmp_path, content, line):
    path = written(tmp_path, content)
    assert read_refusal(path) == f"{path}:{line}:1: is not UTF-8 text; save it as UTF-8"


def test_a_file_beyond_32_kib_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "f.yaml"
    with path.open("wb") as file:
        file.truncate(10_000_000)  # its zero bytes would be refused if they were looked at
    problem = f"{path}: has 10000000 bytes, at most 32768 are read; is it the right file?"
    assert read_refusal(path) == problem


def test_a_file_of_32_kib_is_read(tmp_path):
    assert read_document(written(tmp_path, b"a: 1\n" + b"#" * (SIZE_LIMIT_BYTES - 5))).value == {"a": 1}


def test_what_is_not_a_regular_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "loop").symlink_to("loop")
    assert read_refusal(tmp_path) == f"{tmp_path}: is a folder"
    assert read_refusal(tmp_path / "fifo") == f"{tmp_path}/fifo: is not a regular file"
    assert read_refusal(tmp_path / "none.yaml") == f"{tmp_path}/none.yaml: there is no such file"
    assert read_refusal(tmp_path / "loop").startswith(f"{tmp_path}/loop: ")
    long = "x" * 300
    assert read_refusal(tmp_path / long).startswith(f"{tmp_path}/{long}: cannot be read ([Errno 36] File name too long")


# Any text


FRAGMENTS = st.sampled_from(
    ["a", "b: ", ": ", "- ", "\n", "\n  ", "[", "]", "{", "}", ",", "'", '"', "\\", "&x ", "*x", "!t ", "|", ">", "? ",
     "#", "---\n", "...\n", "%YAML 1.2\n", "5", "1e9", "\t", "\r", "~", "<<: ", "\x1b", "°"]
)  # fmt: skip


@settings(max_examples=500, deadline=None)
@given(st.text(max_size=40) | st.lists(FRAGMENTS, max_size=25).map("".join))
def test_any_text_is_a_document_or_a_refusal_on_one_line_at_its_place(text):
    problem = "f.yaml:1:1: "
    try:
        assert finite(parse_document(text, FILE).value)
    except InputError as refused:
        (problem,) = refused.problems
    name, line, column, _ = problem.split(":", 3)
    assert name == "f.yaml"
    assert int(line) >= 1
    assert int(column) >= 1


def finite(node):
    if isinstance(node, dict):
        return False not in [isinstance(key, str) and finite(item) for key, item in node.items()]
    if isinstance(node, list):
        return False not in map(finite, node)
    return node is None or isinstance(node, (bool, str)) or math.isfinite(node)
