"""The commands that help to write sequences and bench files."""

from __future__ import annotations

import json

import pytest

from bench.config import schema_file
from bench.config.bench import load_bench
from bench.config.new_bench import write_bench
from bench.errors import InputError
from bench.sequence.document import starter
from tests.support.runs import ROOT

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("kind", ["sequence", "bench"])
def test_a_schema_is_printed_as_it_is_kept(bench_here, kind):
    done = bench_here("schema", kind)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["$ref"].startswith("#/$defs/")
    assert done.stdout == (ROOT / f"docs/schema/{kind}.schema.json").read_text("utf-8")


def test_a_page_of_the_reference_is_printed_as_it_is_kept(bench_here):
    done = bench_here("reference", "rules")
    assert done.returncode == 0, done.stderr
    assert done.stdout == (ROOT / "docs/reference/rules.md").read_text("utf-8")


def test_all_pages_of_the_reference_are_written_and_named(tmp_path, bench_here):
    done = bench_here("reference", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(done.stdout.split()) == sorted(map(str, tmp_path.iterdir()))
    assert f"{tmp_path / 'README.md'}" in done.stdout


def test_fmt_writes_and_names_the_files_that_change(tmp_path, bench_here):
    wide, good = tmp_path / "wide.yaml", tmp_path / "good.yaml"
    wide.write_text("a:\n    b: 1   # why\n")
    good.write_text("a: 1\n")
    done = bench_here("fmt", wide, good)
    assert (done.returncode, done.stdout) == (0, f"{wide}\n")
    assert wide.read_text() == "a:\n  b: 1   # why\n"
    done = bench_here("fmt", wide, good)
    assert (done.returncode, done.stdout) == (0, "")


def test_fmt_check_names_the_files_that_would_change_and_exits_with_2(tmp_path, bench_here):
    wide = tmp_path / "wide.yaml"
    wide.write_text("a:\n    b: 1\n")
    done = bench_here("fmt", "--check", wide, "sequences/smoke.yaml")
    assert (done.returncode, done.stdout) == (2, f"{wide}\n")
    assert wide.read_text() == "a:\n    b: 1\n"
    assert bench_here("fmt", "--check", "sequences/smoke.yaml").returncode == 0


def test_fmt_writes_nothing_when_one_of_the_files_is_no_document(tmp_path, bench_here):
    wide, bad = tmp_path / "wide.yaml", tmp_path / "bad.yaml"
    wide.write_text("a:\n    b: 1\n")
    bad.write_text("a: 1\n b: 2\n")
    done = bench_here("fmt", wide, bad)
    assert done.returncode == 2
    assert done.stderr.startswith(f"{bad}:2:")
    assert wide.read_text() == "a:\n    b: 1\n"


def test_a_sequence_of_an_installed_program_brings_its_schema(tmp_path, monkeypatch):
    shipped = tmp_path / "site-packages" / "sequence.schema.json"
    shipped.parent.mkdir()
    shipped.write_text("{}")
    monkeypatch.setattr(schema_file, "SHIPPED", shipped.parent)
    path = starter.write_starter("my_test", tmp_path / "sequences")
    assert path.read_text("utf-8").splitlines()[0] == "# yaml-language-server: $schema=sequence.schema.json"
    assert (tmp_path / "sequences" / "sequence.schema.json").read_text() == "{}"


def test_a_new_sequence_is_found_checked_and_run_to_a_verdict(tmp_path, bench_here):
    done = bench_here("new", "sequence", "my_test", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "sequences/my_test.yaml\n"), done.stderr
    text = (tmp_path / "sequences/my_test.yaml").read_text("utf-8")
    assert "\ntitle: My test\n" in text
    schema = text.splitlines()[0].removeprefix("# yaml-language-server: $schema=")
    assert (tmp_path / "sequences" / schema).samefile(ROOT / "docs/schema/sequence.schema.json")
    assert bench_here("check", "my_test", "--bench", "simulated", cwd=tmp_path).returncode == 0
    done = bench_here("run", "my_test", "--bench", "simulated", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Verdict: PASS" in done.stdout
    assert bench_here("fmt", "--check", "sequences/my_test.yaml", cwd=tmp_path).returncode == 0


def test_a_new_sequence_replaces_nothing(tmp_path, bench_here):
    path = tmp_path / "mine.yaml"
    path.write_text("mine")
    done = bench_here("new", "sequence", "mine", "--dir", tmp_path)
    assert done.returncode == 2
    assert done.stderr == f"{path}: is there already; choose another name, or remove it first\n"
    assert path.read_text() == "mine"


@pytest.mark.parametrize("name", ["../mine", "Mine", "2nd", "a" * 33, "mine.yaml", ""])
def test_a_new_sequence_needs_a_name(tmp_path, bench_here, name):
    done = bench_here("new", "sequence", name, "--dir", tmp_path / "made")
    assert done.returncode == 2
    assert "expected a name: at most 32 lower-case letters, digits and _, a letter first" in done.stderr
    assert not (tmp_path / "made").exists()


def test_a_new_sequence_that_cannot_be_written_is_told(tmp_path, bench_here):
    (tmp_path / "file").touch()
    done = bench_here("new", "sequence", "mine", "--dir", tmp_path / "file")
    assert done.returncode == 2
    assert "mine.yaml: " in done.stderr


def test_a_copied_bench_brings_the_files_that_it_names_and_runs(tmp_path, bench_here):
    done = bench_here("new", "bench", "mine", cwd=tmp_path)
    written = ["config/if_counter.dbc", "config/uut/quartz_flexure.yaml", "config/mine.yaml"]
    assert (done.returncode, done.stdout.splitlines()) == (0, written), done.stderr
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()) == sorted(written)
    lines = (tmp_path / "config/mine.yaml").read_text("utf-8").splitlines()
    assert "title: Mine" in lines
    schema = lines[0].removeprefix("# yaml-language-server: $schema=")
    assert (tmp_path / "config" / schema).samefile(ROOT / "docs/schema/bench.schema.json")
    assert bench_here("check", "smoke", "--bench", "mine.yaml", cwd=tmp_path).returncode == 0
    done = bench_here("run", "smoke", "--bench", "mine", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Verdict: PASS" in done.stdout


SHIPPED = sorted(path.stem for path in (ROOT / "config").glob("*.yaml"))


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_bench_can_be_copied(tmp_path, name):
    made = write_bench("mine", name, tmp_path / "made")
    assert made[-1] == tmp_path / "made/mine.yaml"
    load_bench(made[-1])


def test_a_recording_that_a_bench_names_is_copied_too(tmp_path):
    source = recorded(tmp_path / "from")
    write_bench("mine", str(source), tmp_path / "made")
    assert (tmp_path / "made/logs/run.log").read_text() == "kept"
    source.write_text(source.read_text("utf-8").replace("log:logs/run.log", "log:../run.log"), "utf-8")
    (tmp_path / "run.log").write_text("outside")
    with pytest.raises(InputError, match=r"\.\./run\.log leaves the folder of this file"):
        write_bench("other", str(source), tmp_path / "made")
    assert not (tmp_path / "made/other.yaml").exists()


def recorded(folder):
    """A bench whose counter is a log beside it."""
    path = write_bench("recorded", "simulated", folder)[-1]
    text = path.read_text("utf-8")
    path.write_text(text.replace("sim+slcan:///tmp/itb/can?bitrate=500000", "log:logs/run.log"), "utf-8")
    (folder / "logs").mkdir()
    (folder / "logs/run.log").write_text("kept")
    return path


def test_a_second_bench_shares_what_is_the_same_and_replaces_nothing(tmp_path):
    write_bench("first", "simulated", tmp_path)
    assert write_bench("second", "simulated", tmp_path) == [tmp_path / "second.yaml"]
    (tmp_path / "if_counter.dbc").write_text("mine")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(InputError, match=r"if_counter\.dbc: is there already, and is another"):
        write_bench("third", "simulated", tmp_path)
    with pytest.raises(InputError, match=r"first\.yaml: is there already; choose another name"):
        write_bench("first", "volts", tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_what_cannot_be_copied_whole_is_not_copied(tmp_path):
    (tmp_path / "uut").touch()  # where a folder must be
    with pytest.raises(InputError, match="nothing was copied"):
        write_bench("mine", "simulated", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["uut"]


@pytest.mark.parametrize("name", ["../mine", "Mine", "mine.yaml", ""])
def test_a_new_bench_needs_a_name_and_a_source_without_problems(tmp_path, name):
    with pytest.raises(InputError, match="expected a name"):
        write_bench(name, "simulated", tmp_path / "made")
    (tmp_path / "broken.yaml").write_text("title: x\n")
    with pytest.raises(InputError, match=r"broken\.yaml.*the key 'schema' is missing"):
        write_bench("mine", str(tmp_path / "broken.yaml"), tmp_path / "made")
    assert not (tmp_path / "made").exists()
