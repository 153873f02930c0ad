"""The commands that help to write sequences and bench files."""

from __future__ import annotations

import json

import pytest

from tests.support.runs import ROOT


@pytest.mark.parametrize("kind", ["sequence", "bench"])
def test_a_schema_is_printed_as_it_is_kept(bench_command, kind):
    done = bench_command("schema", kind)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["$ref"].startswith("#/$defs/")
    assert done.stdout == (ROOT / f"docs/schema/{kind}.schema.json").read_text("utf-8")


def test_a_page_of_the_reference_is_printed_as_it_is_kept(bench_command):
    done = bench_command("reference", "rules")
    assert done.returncode == 0, done.stderr
    assert done.stdout == (ROOT / "docs/reference/rules.md").read_text("utf-8")


def test_all_pages_of_the_reference_are_written_and_named(tmp_path, bench_command):
    done = bench_command("reference", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(done.stdout.split()) == sorted(map(str, tmp_path.iterdir()))
    assert f"{tmp_path / 'README.md'}" in done.stdout


def test_fmt_writes_and_names_the_files_that_change(tmp_path, bench_command):
    wide, good = tmp_path / "wide.yaml", tmp_path / "good.yaml"
    wide.write_text("a:\n    b: 1   # why\n")
    good.write_text("a: 1\n")
    done = bench_command("fmt", wide, good)
    assert (done.returncode, done.stdout) == (0, f"{wide}\n")
    assert wide.read_text() == "a:\n  b: 1   # why\n"
    done = bench_command("fmt", wide, good)
    assert (done.returncode, done.stdout) == (0, "")


def test_fmt_check_names_the_files_that_would_change_and_exits_with_2(tmp_path, bench_command):
    wide = tmp_path / "wide.yaml"
    wide.write_text("a:\n    b: 1\n")
    done = bench_command("fmt", "--check", wide, "sequences/smoke.yaml")
    assert (done.returncode, done.stdout) == (2, f"{wide}\n")
    assert wide.read_text() == "a:\n    b: 1\n"
    assert bench_command("fmt", "--check", "sequences/smoke.yaml").returncode == 0


def test_fmt_writes_nothing_when_one_of_the_files_is_no_document(tmp_path, bench_command):
    wide, bad = tmp_path / "wide.yaml", tmp_path / "bad.yaml"
    wide.write_text("a:\n    b: 1\n")
    bad.write_text("a: 1\n b: 2\n")
    done = bench_command("fmt", wide, bad)
    assert done.returncode == 2
    assert done.stderr.startswith(f"{bad}:2:")
    assert wide.read_text() == "a:\n    b: 1\n"


def test_a_new_sequence_is_found_checked_and_run_to_a_verdict(tmp_path, bench_command):
    done = bench_command("new", "sequence", "my_test", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "sequences/my_test.yaml\n"), done.stderr
    text = (tmp_path / "sequences/my_test.yaml").read_text("utf-8")
    assert "\ntitle: My test\n" in text
    schema = text.splitlines()[0].removeprefix("# yaml-language-server: $schema=")
    assert (tmp_path / "sequences" / schema).samefile(ROOT / "docs/schema/sequence.schema.json")
    assert bench_command("check", "my_test", "--bench", "simulated", cwd=tmp_path).returncode == 0
    done = bench_command("run", "my_test", "--bench", "simulated", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Verdict: PASS" in done.stdout
    assert bench_command("fmt", "--check", "sequences/my_test.yaml", cwd=tmp_path).returncode == 0


def test_a_new_sequence_replaces_nothing(tmp_path, bench_command):
    path = tmp_path / "mine.yaml"
    path.write_text("mine")
    done = bench_command("new", "sequence", "mine", "--dir", tmp_path)
    assert done.returncode == 2
    assert done.stderr == f"{path}: is there already; choose another name, or remove it first\n"
    assert path.read_text() == "mine"


@pytest.mark.parametrize("name", ["../mine", "Mine", "2nd", "a" * 33, "mine.yaml", ""])
def test_a_new_sequence_needs_a_name(tmp_path, bench_command, name):
    done = bench_command("new", "sequence", name, "--dir", tmp_path / "made")
    assert done.returncode == 2
    assert "expected a name: at most 32 lower-case letters, digits and _, a letter first" in done.stderr
    assert not (tmp_path / "made").exists()


def test_a_new_sequence_that_cannot_be_written_is_told(tmp_path, bench_command):
    (tmp_path / "file").touch()
    done = bench_command("new", "sequence", "mine", "--dir", tmp_path / "file")
    assert done.returncode == 2
    assert "mine.yaml: " in done.stderr
