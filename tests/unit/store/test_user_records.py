"""Records of this user: what was tried, who signs, what followed a run; and the forms of all that is kept."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import pytest

from bench.errors import InputError, StoreError
from bench.store import kept_json as forms
from bench.store.followed import FOLLOWED, Followed, followed
from bench.store.kept_json import read_kept
from bench.store.manifest_form import instant
from bench.store.runs import RunSummary
from bench.store.signed import check_signed
from bench.store.tried import TRIED, last_tried, note_tried
from bench.store.user_state import state_folder


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def test_the_last_success_of_a_kind_and_key_counts():
    assert last_tried("alert", "a") is None
    before = datetime.now(UTC).replace(microsecond=0)
    note_tried("alert", "a")
    found = last_tried("alert", "a")
    assert found is not None
    assert before <= found <= datetime.now(UTC)
    assert last_tried("rehearsal", "a") is None
    assert last_tried("alert", "b") is None


def test_of_several_the_newest_counts_and_what_cannot_be_read_does_not():
    lines = [
        {"what": "alert", "key": "a", "at": "2026-01-02T00:00:00+00:00"},
        {"what": "alert", "key": "a", "at": "2026-01-01T00:00:00+00:00"},
        {"what": "alert", "key": "a", "at": "2026-01-09"},
        {"what": "alert", "key": "a"},
        {"what": 1, "key": "a", "at": "2026-01-09T00:00:00+00:00"},
        [],
    ]
    text = "\n".join(map(json.dumps, lines)) + "\n{\n" + "[" * 100_000 + "\n"
    (state_folder() / TRIED).write_bytes(text.encode() + b"\xff\n")
    assert last_tried("alert", "a") == datetime(2026, 1, 2, tzinfo=UTC)


def test_a_success_that_cannot_be_recorded_is_told():
    (state_folder() / TRIED).mkdir()
    with pytest.raises(StoreError, match=r"^that the alert succeeded cannot be recorded \("):
        note_tried("alert", "a")
    assert last_tried("alert", "a") is None


@pytest.mark.parametrize(("by", "reason"), [("n" * 100, "r" * 500), ("A", "ü ö")])
def test_a_name_and_a_reason_are_accepted(by, reason):
    check_signed(by, reason)


@pytest.mark.parametrize(
    ("by", "reason", "told"),
    [
        ("", "why", "--by: expected up to 100 printable characters"),
        ("n" * 101, "why", "--by: expected up to 100 printable characters"),
        ("a\nb", "why", "--by: expected up to 100 printable characters"),
        ("A", "  ", "--reason: expected up to 500 printable characters"),
        ("A", "r" * 501, "--reason: expected up to 500 printable characters"),
        ("A", "\x1b[1m", "--reason: expected up to 500 printable characters"),
    ],
)
def test_one_that_says_nothing_or_too_much_is_refused(by, reason, told):
    with pytest.raises(InputError) as found:
        check_signed(by, reason)
    assert str(found.value) == told


@pytest.mark.parametrize("state", ["running", "interrupted", "damaged", "completed", "failed", "error", "aborted"])
def test_a_summary_knows_whether_there_is_an_outcome(tmp_path, state):
    found = RunSummary(tmp_path / "a run", state, {"units": [{"uut": "QF-1"}, {"uut": "QF-2"}]})
    assert found.has_outcome == (state not in ("running", "interrupted", "damaged"))
    assert (found.id, found.units) == ("a run", ("QF-1", "QF-2"))
    assert found.to_json() == {
        "run": "a run", "path": str(tmp_path / "a run"), "state": state, "manifest": found.manifest,
    }  # fmt: skip
    assert RunSummary(tmp_path, state, {}).units == ()


def entries(folder, *lines) -> list[Followed | None]:
    (folder / FOLLOWED).write_text("\n".join(each if isinstance(each, str) else json.dumps(each) for each in lines))
    return list(followed(folder))


def test_what_followed_a_run_is_read_field_by_field(tmp_path):
    whole = {
        "role": "chamber", "event": "arrived", "at": "now", "why": "a\x1bb", "what": "w" * 500, "is_complete": True,
        "air_c": 25, "set_point_c": -25.5,
    }  # fmt: skip
    (found,) = entries(tmp_path, whole)
    assert found == Followed("chamber", "arrived", "now", "a\ufffdb", "w" * 400, True, 25.0, -25.5)
    assert isinstance(found.air_c, float)
    (odd,) = entries(tmp_path, {"role": "chamber", "event": "held", "at": 3, "is_complete": 1, "air_c": True})
    assert odd == Followed("chamber", "held", "", "", "", False, None, None)
    (hot,) = entries(tmp_path, {"role": "c", "event": "held", "air_c": 1e4, "set_point_c": "25"})
    assert (hot.air_c, hot.set_point_c) == (None, None)


def test_entries_that_cannot_be_read_are_known_as_such_and_alerts_are_none(tmp_path):
    assert entries(tmp_path, "{", [1], {"role": "c", "event": "odd"}, {"event": "held"}) == [None] * 4
    assert entries(tmp_path, {"event": "alert", "role": "c"}) == []
    assert entries(tmp_path, "[" * 100_000) == [None]
    states = ("commanded", "held", "reading", "not_seen", "hold_ends", "arrived", "not_arrived", "handed_over", "ended")
    found = entries(tmp_path, *({"role": "c", "event": each} for each in states))
    assert [each and each.event for each in found] == list(states)


def test_a_run_that_nothing_followed_has_no_entries_and_an_unfit_file_one(tmp_path):
    assert list(followed(tmp_path)) == []
    (tmp_path / FOLLOWED).mkdir()
    assert list(followed(tmp_path)) == [None]


@pytest.mark.parametrize(
    ("form", "fits", "told"),
    [
        (forms.TEXT, ["", "a"], {1: " is not text", None: " is not text"}),
        (forms.WHOLE, [0, -1], {True: " is not a whole number", 1.5: " is not a whole number"}),
        (forms.NUMBER, [0, 1.5], {True: " is not a number", "1": " is not a number"}),
        (forms.TRUTH, [True, False], {1: " is not true or false"}),
        (forms.one_of("a", "b"), ["a", "b"], {"c": " is not a or b", 1: " is not a or b"}),
        (forms.nullable(forms.TEXT), [None, "a"], {1: " is not text"}),
        (forms.list_of(forms.TEXT), [[], ["a"]], {"a": " is not a list", ("a", 1): ".1 is not text"}),
        (forms.pair(forms.TEXT), [["a", "b"]], {1: " is not a list", ("a", "b"): " is not a pair"}),
        (forms.named(forms.TEXT), [{}, {"x": "a"}], {"a": " is not an object"}),
        (instant, ["2026-01-01T00:00:00Z"], {1: " is not an instant", "2026-01-01T00:00:00": " is not an instant"}),
    ],
)  # fmt: skip
def test_a_form_says_what_does_not_fit(form, fits, told):
    assert [form(each) for each in fits] == [""] * len(fits)
    assert {value: form(value) for value in told} == told


def test_the_form_of_an_object_names_the_place():
    form = forms.object_of({"a": forms.TEXT, "b": forms.named(forms.list_of(forms.WHOLE))}, ("a",))
    assert form({"a": "x"}) == form({"a": "x", "b": {}, "c": 1}) == ""
    assert form({}) == " has no 'a'"
    assert form([]) == " is not an object"
    assert form({"a": 1}) == ".a is not text"
    assert form({"a": "x", "b": {"n": [1, "2"]}}) == ".b.n.1 is not a whole number"
    assert forms.named(forms.TEXT)({"x": 1}) == ".x is not text"
    assert forms.pair(forms.TEXT)(["a"]) == forms.pair(forms.TEXT)(["a", "b", "c"]) == " is not a pair"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"{", "cannot be read ("), (b"\xff", "cannot be read ("),
        (b'"\\ud800"', "cannot be read (an unpaired surrogate)"),
        (b"NaN", "cannot be read (NaN is not a number)"), (b"1e999", "cannot be read (1e999 is not a number)"),
        (b"[" * 100_000, "cannot be read ("), (b"1", "is not text"), (b'"' + b"x" * 100 + b'"', "cannot be read ("),
    ],
)  # fmt: skip
def test_a_file_that_does_not_fit_is_refused(tmp_path, content, told):
    path = tmp_path / "kept.json"
    path.write_bytes(content)
    with pytest.raises(StoreError) as found:
        read_kept(path, forms.TEXT, 200 if content.startswith(b"[") else 50)
    assert str(found.value).startswith(f"{path}: {told}")


def test_a_file_that_fits_is_read(tmp_path):
    path = tmp_path / "kept.json"
    path.write_text('["a", 1.5, 3]', "utf-8")
    assert read_kept(path, forms.list_of(lambda _: "")) == ["a", 1.5, 3]
