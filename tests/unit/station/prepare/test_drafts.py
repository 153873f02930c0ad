"""Checks of a text that is edited: those of `bench check`, at the same lines."""

from __future__ import annotations

import pytest

from bench.app.check_files import check_files
from bench.app.files_to_check import SEQUENCE, FileToCheck
from bench.app.request import RunRequest
from bench.config.load import find
from bench.errors import InputError
from bench.station.prepare.drafts import bench_texts, check_draft, check_file, expect_readable
from bench.station.prepare.sequences import purpose_of
from tests.support.runs import ROOT

SEQUENCES, BENCH = ROOT / "sequences", find("simulated", "config")
SMOKE = (SEQUENCES / "smoke.yaml").read_text("utf-8")


@pytest.mark.parametrize("change", [("move: head", "move: haed"), ("schema:", "shema:"), ("5 s", "5 kg"), ("[", "[[")])
def test_findings_are_those_of_the_command_at_the_same_lines(tmp_path, change):
    text = SMOKE.replace(*change)
    path = tmp_path / "smoke.yaml"
    path.write_text(text)
    (expected,) = check_files([FileToCheck(path, SEQUENCE)], RunRequest(""), [str(BENCH)], {})
    found = check_draft("smoke", text, SEQUENCES, BENCH, "en")
    assert [(each.line, each.column, each.rule) for each in found.found] == [
        (each.line, each.column, each.rule) for each in expected.found
    ]
    assert found.errors
    assert (found.picture, found.steps) == ("", 0)
    assert not [each for each in found.found if "draft-" in each.text or each.file]


def test_a_good_text_has_a_duration_and_a_picture_of_its_plan():
    found = check_draft("new_one", SMOKE, SEQUENCES, BENCH, "en")
    assert found.found == []
    assert found.expected_s > 30
    assert found.steps > 10
    assert found.picture.endswith("</svg>\n")


def test_called_sequences_are_found_beside_it_and_problems_there_have_their_file():
    bench = find("channel", "config")
    full = (SEQUENCES / "channel_full.yaml").read_text("utf-8")
    assert check_draft("mine", full, SEQUENCES, bench, "").found == []
    lost = check_draft("mine", full.replace("call: channel_skew.yaml", "call: none.yaml"), SEQUENCES, bench, "")
    assert any("none.yaml" in each.text for each in lost.errors)
    itself = check_draft("mine", full.replace("call: channel_skew.yaml", "call: mine.yaml"), SEQUENCES, bench, "")
    assert any("cannot call itself" in each.text for each in itself.errors)


def test_a_release_has_the_sequence_with_those_that_it_calls_and_a_bench_with_its_files():
    found = check_file(SEQUENCES / "channel_full.yaml", find("channel", "config"))
    assert set(found.texts) == {
        "sequence.yaml",
        *(f"called/channel_{each}.yaml" for each in ("gravity", "skew", "source")),
    }
    assert set(bench_texts(BENCH)) == {"bench.yaml", "if_counter.dbc"}


def test_what_cannot_be_read_is_refused_with_its_lines():
    expect_readable("smoke", SMOKE)
    with pytest.raises(InputError, match=r"mine\.yaml:1:1: a: unknown key"):
        expect_readable("mine", "a: 1\n")


def test_the_purpose_is_that_of_the_head():
    assert (
        purpose_of("Title\n\nPurpose    Bias over\n           temperature.\nApparatus  A head.")
        == "Bias over temperature."
    )
    assert purpose_of("Title\n\nFirst words,\nsecond.\n\nMore.") == "First words, second."
    assert purpose_of("Title") == purpose_of("") == ""
