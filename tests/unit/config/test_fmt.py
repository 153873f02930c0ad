"""The layout of files: lines move sideways, and nothing else happens to them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.config.document import parse_document
from bench.config.layout import changes, formatted
from bench.errors import InputError

ROOT = Path(__file__).parents[3]
FILE = Path("f.yaml")
SEQUENCES = sorted((ROOT / "sequences").glob("*.yaml"))
SHIPPED = [*SEQUENCES, *sorted((ROOT / "config").rglob("*.yaml")), ROOT / "bench/sequence/document/starter.yaml"]
DENSE = """\
# of all

a:
  - b: {c: 1, d: [x,
          y]}  # beside
    e: |
      verbatim
        deeper

      # no comment
    # of f
    f: "two
      lines"
  - - 1
    - 2
# of g
g:
- h: plain
    and more
- 5 °C
k:
  l:
    m: ''
n: 0.10
"""
TEXTS = [DENSE, *((ROOT / name).read_text("utf-8") for name in ("sequences/smoke.yaml", "config/simulated.yaml"))]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_files_stand_as_they_should(path):
    assert formatted(path.read_text("utf-8"), path) == path.read_text("utf-8")


@pytest.mark.parametrize(
    ("text", "result"),
    [
        ("a: 1", "a: 1\n"),
        ("a: 1\n\n\n", "a: 1\n"),
        ("a: 1  \r\nb: 2\r\n", "a: 1\nb: 2\n"),
        ("a: 1\rb: 2\r", "a: 1\nb: 2\n"),
        ("\n# only a comment  \n", "\n# only a comment\n"),
        ("", "\n"),
        ("  a: 1\n  b: 2\n", "a: 1\nb: 2\n"),
        ("a:\n    b:\n        c: 1\n    d: 2\n", "a:\n  b:\n    c: 1\n  d: 2\n"),
        ("a:\n- 1\n- 2\nb: 3\n", "a:\n  - 1\n  - 2\nb: 3\n"),
        ("a:\n- b:\n  - 1\n  c: 2\n- d: 3\n", "a:\n  - b:\n      - 1\n    c: 2\n  - d: 3\n"),
        ("a:\n    -   b: 1\n        c: 2\n", "a:\n  - b: 1\n    c: 2\n"),
        ("-   -   1\n    -   2\n", "- - 1\n  - 2\n"),
        ("a:\n  -\n    b: 1\n", "a:\n  -\n    b: 1\n"),
        ("a:\n      {b: 1,\n       c: 2}\n", "a:\n  {b: 1,\n   c: 2}\n"),
        ("a:\n    b: [1,\n        # inside\n        2]\n", "a:\n  b: [1,\n      # inside\n      2]\n"),
        ("a:\n     text\n     goes on\n", "a:\n  text\n  goes on\n"),
        ("a:\n    'text\n\n    goes on'   \n", "a:\n  'text\n\n  goes on'\n"),
        ("a:\n    b: |  \n        text  \n          deeper\n\n    c: 1\n",
         "a:\n  b: |\n      text  \n        deeper\n\n  c: 1\n"),
        ("a: x\u00a0 \n# tab\t\n", "a: x\u00a0\n# tab\n"),
        ("a:   1     # why\n", "a:   1     # why\n"),
        ("a: {b:   1,c: [1,2]}\n", "a: {b:   1,c: [1,2]}\n"),
        ("'a': 0.10\n\"b\": 1e3\n", "'a': 0.10\n\"b\": 1e3\n"),
        ("# top\na:\n    # of b\n    b: 1\n    # after b\n# of c\nc: 2\n",
         "# top\na:\n  # of b\n  b: 1\n  # after b\n# of c\nc: 2\n"),
        ("a:\n- b: 1\n  # - c: 2\nd: 1\n", "a:\n  - b: 1\n    # - c: 2\nd: 1\n"),
        ("a:\n    b: 1\n      # odd\nc: 2\n", "a:\n  b: 1\n    # odd\nc: 2\n"),
        ("---\na: 1\n", "---\na: 1\n"),
    ],
)  # fmt: skip
def test_a_text_is_laid_out(text, result):
    assert formatted(text, FILE) == result
    assert formatted(result, FILE) == result


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a: [1", "f.yaml:1:4: is not YAML: a comma is missing here, or a bracket is not closed"),
        ("a: 1\na: 2\n", "f.yaml:2:1: the key 'a' stands twice; it is already in line 1"),
        ("a: &x 1\n", "f.yaml:1:4: anchors"),
        ("a: |\n  no line end", "f.yaml: cannot be laid out without a change of what it says"),
    ],
)
def test_what_is_no_document_or_would_say_something_else_is_refused(text, problem):
    with pytest.raises(InputError, match=re.escape(problem)):
        formatted(text, FILE)


@pytest.mark.parametrize("width", [3, 4, 8])
@pytest.mark.parametrize("path", SEQUENCES, ids=lambda path: path.stem)
def test_a_sequence_with_another_indentation_becomes_what_is_shipped(path, width):
    def wider(line: str) -> str:
        found = re.match(r"( *)(- )?", line)
        dash = "-" + " " * (width - 1) if found[2] else ""
        return " " * (len(found[1]) // 2 * width) + dash + line[found.end() :]

    text = path.read_text("utf-8")
    assert formatted("\r\n".join(wider(line) + "  " for line in text.splitlines()), FILE) == text


EDIT = st.tuples(
    st.integers(0, 10_000),
    st.sampled_from(["indent", "outdent", "trail", "blank", "comment", "copy", "drop"]),
    st.integers(1, 5),
)


def edited(text: str, edits: list[tuple[int, str, int]]) -> str:
    lines = text.split("\n")
    for where, what, width in edits:
        at = where % len(lines)
        line = lines[at]
        lines[at : at + 1] = {
            "indent": [" " * width + line],
            "outdent": [line[min(width, len(line) - len(line.lstrip())) :]],
            "trail": [line + " " * width],
            "blank": [line, " " * width],
            "comment": [" " * width + "# x", line],
            "copy": [line, line],
            "drop": [],
        }[what] or ["# dropped"]
    return "\n".join(lines) + "\n"


@settings(max_examples=60, deadline=None)
@given(text=st.sampled_from(TEXTS), edits=st.lists(EDIT, max_size=6), line_end=st.sampled_from(["\n", "\r\n"]))
def test_layout_never_changes_what_is_said_and_doing_it_again_changes_nothing(text, edits, line_end):
    text = edited(text, edits).replace("\n", line_end)
    try:
        value = parse_document(text, FILE).value
    except InputError:
        with pytest.raises(InputError):
            formatted(text, FILE)
        return
    result = formatted(text, FILE)
    assert json.dumps(parse_document(result, FILE).value) == json.dumps(value)
    assert [line.split() for line in result.split("\n")] == [
        line.split() for line in f"{text.rstrip()}\n".replace("\r\n", "\n").split("\n")
    ], "words stay in their lines"
    assert "|" in text or not re.search(r"[ \r]$", result, re.MULTILINE)
    assert formatted(result, FILE) == result


# Files


def test_files_that_would_change_come_with_their_new_text(tmp_path):
    good, wide, marked = (tmp_path / name for name in ("good.yaml", "wide.yaml", "marked.yaml"))
    good.write_text("a:\n  b: 1\n")
    wide.write_text("a:\n    b: 1\n")
    marked.write_text("a: 1\n", encoding="utf-8-sig")
    assert changes([good, wide, marked]) == {wide: "a:\n  b: 1\n", marked: "a: 1\n"}
    assert wide.read_text() == "a:\n    b: 1\n"


def test_all_files_that_are_no_documents_are_told_at_once(tmp_path):
    (tmp_path / "bad.yaml").write_text("a: [")
    with pytest.raises(InputError) as caught:
        changes([tmp_path / "bad.yaml", tmp_path / "none.yaml"])
    assert [problem.split(":")[0].rpartition("/")[2] for problem in caught.value.problems] == ["bad.yaml", "none.yaml"]
