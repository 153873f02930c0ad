"""A stored run reduced again: what of it has changed."""

import json

import pytest

from bench.errors import StoreError
from bench.reduce.reduced_again import reduced_again
from bench.reduce.stored_run import open_run
from tests.support.runs import sealed_anew

pytestmark = pytest.mark.slow

K0 = "tumble/a/K0@temperature=20"


@pytest.fixture
def folder(smoke_copy):
    return smoke_copy


def again(folder):
    with open_run(sealed_anew(folder)) as stored:
        return reduced_again(stored)


def plant(folder, **changes):
    """Changes what was kept of a finding; gives what was there."""
    path = folder / "results.json"
    content = json.loads(path.read_text("utf-8"))
    (finding,) = [finding for finding in content["findings"] if finding["id"] == K0]
    before = dict(finding)
    finding.update(changes)
    path.write_text(json.dumps(content), "utf-8")
    sealed_anew(folder)
    return before


def test_nothing_has_changed(smoke_run):
    found = again(smoke_run.path)
    assert found.changes == ()
    assert list(found.in_words()) == [f"{smoke_run.path.name}: nothing changed, PASS"]


def test_a_value_that_has_changed_is_named_with_by_how_much(folder):
    now = plant(folder, value=0.0)
    (change,) = again(folder).changes
    assert (change.id, change.before.value, change.now.value) == (K0, 0.0, now["value"])
    of_u = f"{now['value'] / now['u']:.2g}"
    assert list(again(folder).in_words()) == [
        f"{K0}: value 0 -> {now['value']:.9g} g ({now['value']:+.3g}, {of_u} u)",
        f"{folder.name}: 1 of 5 findings changed, PASS",
    ]


def test_rounding_is_no_change(folder):
    now = plant(folder)
    plant(folder, value=now["value"] + 1e-10 * now["u"], u=now["u"] * (1 + 1e-10))
    assert again(folder).changes == ()
    plant(folder, value=now["value"] + 1e-8 * now["u"])
    assert len(again(folder).changes) == 1


def test_uncertainty_verdict_and_unit_are_compared_too(folder):
    now = plant(folder, u=1e-3, verdict="FAIL")
    path = folder / "results.json"
    path.write_text(path.read_text("utf-8").replace('"verdict": "PASS"', '"verdict": "FAIL"', 1), "utf-8")
    lines = list(again(folder).in_words())
    assert lines[0] == f"{K0}: u 0.001 -> {now['u']:.4g} g; FAIL -> PASS"
    assert lines[-1] == f"{folder.name}: 1 of 5 findings changed, FAIL -> PASS"
    plant(folder, u=now["u"], verdict=None, unit="m/s²")
    assert "unit m/s² -> g; not judged -> PASS" in next(again(folder).in_words())


def test_findings_come_and_go(folder):
    plant(folder, id="tumble/a/K9")
    assert list(again(folder).in_words())[:2] == ["tumble/a/K9: is not found any more", f"{K0}: is new"]


def test_a_run_without_results_is_reduced_all_the_same(folder):
    (folder / "results.json").unlink()
    assert list(again(folder).in_words()) == [f"{folder.name}: no stored results to compare with; 5 findings now, PASS"]


@pytest.mark.parametrize("text", ["{", "[]", '{"verdict": "PASS", "findings": [{"id": "K0"}]}'])
def test_results_that_are_damaged_are_not_compared_with(folder, text):
    (folder / "results.json").write_text(text)
    with pytest.raises(StoreError, match="is damaged"):
        again(folder)


def test_it_is_told_on_the_command_line(folder, bench_here):
    plant(folder, value=0.0)
    before = {path.name: path.stat().st_mtime_ns for path in folder.iterdir() if path.suffix == ".json"}
    done = bench_here("reduce", folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == f"{folder.name}: 1 of 5 findings changed, PASS"
    reported = json.loads(bench_here("reduce", folder.name, "--runs", folder.parent, "--json").stdout)
    assert reported["verdict"] == {"before": "PASS", "now": "PASS"}
    assert [(change["id"], change["before"]["value"]) for change in reported["changes"]] == [(K0, 0.0)]
    assert {name: (folder / name).stat().st_mtime_ns for name in before} == before


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (("case.json",), "give --out DIR to write result.json, or --json to print it"),
        (("last", "--out", "there"), "'bench report last --format json' writes the results of a run"),
        (("last",), "there is no run yet"),
    ],
)
def test_what_is_missing_is_told(tmp_path, bench_here, arguments, reported):
    done = bench_here("reduce", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert reported in done.stderr
