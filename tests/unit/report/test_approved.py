"""A run with an approved report: no other is written beside it, by no command; copies elsewhere say what they are."""

from __future__ import annotations

import json
import threading

import pytest

from bench.errors import InputError
from bench.reduce.stored_run import open_run
from bench.report.approval import APPROVAL, SCHEMA
from bench.report.revision import is_issued, issued_name, replacing, verify, writing
from bench.report.write import FORMS, write_report
from bench.store.runs import SEAL

NUMBER = "L3-2026-00001-ABCDE"
LABORATORY = {"name": "Inertial Laboratory", "address": "1 Bench Street"}


@pytest.fixture
def approved(smoke_copy):
    """The directory of an approved run; its report is a few bytes."""
    content = {
        "schema": SCHEMA, "report": NUMBER, "run": smoke_copy.name, "by": "boris", "at": "2026-11-21T20:00:00+00:00",
        "comment": "", "head": "", "calibrations": {}, "laboratory": LABORATORY, "fields": {},
    }  # fmt: skip
    (smoke_copy / APPROVAL).write_text(json.dumps(content))
    with replacing(smoke_copy, issued_name(NUMBER, "pdf"), b"%PDF"):
        (smoke_copy / issued_name(NUMBER, "pdf")).write_bytes(b"%PDF")
    return smoke_copy


def files_of(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("form", FORMS)
def test_bench_report_refuses_and_says_what_to_do(approved, bench_here, form):
    before = files_of(approved)
    done = bench_here("report", approved.name, "--runs", str(approved.parent), "--format", form)
    assert done.returncode == 2
    for words in (NUMBER, "--out FILE", "issue the report again"):
        assert words in done.stderr
    assert files_of(approved) == before
    assert verify(approved) == []


def test_a_copy_elsewhere_says_that_it_is_neither_approved_nor_signed(approved, bench_here, tmp_path):
    before, out = files_of(approved), tmp_path / "copies" / "copy.html"
    assert bench_here("report", approved.name, "--runs", str(approved.parent), "--out", str(out)).returncode == 0
    page = out.read_text("utf-8")
    assert f"The approved report {NUMBER} is another file" in page
    assert "<td>boris</td>" not in page
    changed = {name for name, content in files_of(approved).items() if before.get(name) != content}
    assert changed <= {"report_revisions.json"}


def test_a_copy_is_not_written_into_the_directory_of_a_run(approved, bench_here, tmp_path):
    link = tmp_path / "innocent.pdf"
    link.symlink_to(approved / issued_name(NUMBER, "pdf"))
    for out in (link, approved / issued_name(NUMBER, "pdf")):
        done = bench_here("report", approved.name, "--runs", str(approved.parent), "--out", str(out))
        assert (done.returncode, "directory of a run" in done.stderr) == (2, True)
    assert (approved / issued_name(NUMBER, "pdf")).read_bytes() == b"%PDF"


def test_a_reduction_of_an_approved_run_writes_nothing(approved, bench_here):
    before = files_of(approved)
    assert bench_here("reduce", approved.name, "--runs", str(approved.parent)).returncode == 0
    assert files_of(approved) == before


def test_a_report_that_is_being_written_waits_for_an_approval_and_is_then_refused(smoke_copy):
    problems = []

    def write():
        try:
            with open_run(smoke_copy) as stored:
                write_report(stored)
        except InputError as problem:
            problems.append(str(problem))

    before = (smoke_copy / "report.html").read_bytes()
    with writing(smoke_copy):
        writer = threading.Thread(target=write)
        writer.start()
        writer.join(0.3)
        assert writer.is_alive()
        content = {"report": NUMBER, "run": smoke_copy.name, "by": "", "at": "", "head": "", "calibrations": {}}
        (smoke_copy / APPROVAL).write_text(json.dumps({"schema": SCHEMA, "laboratory": {}, "fields": {}, **content}))
    writer.join()
    assert NUMBER in problems[0]
    assert (smoke_copy / "report.html").read_bytes() == before


def test_a_changed_approved_report_is_damage_and_is_not_to_be_written_again(approved):
    (approved / issued_name(NUMBER, "pdf")).write_bytes(b"%PDF changed")
    (damage,) = verify(approved)
    assert "restore this approved report from a copy" in damage


@pytest.mark.parametrize(
    ("name", "issued"),
    [("report.pdf", False), ("report.zh.pdf", False), ("report.DAMAGED.html", False), (SEAL, False),
     (f"report.{NUMBER}.pdf", True), ("report.my-lab-2026-123456-ABCDE.html", True)],
)  # fmt: skip
def test_issued_reports_are_known_by_their_names(name, issued):
    assert is_issued(name) == issued
