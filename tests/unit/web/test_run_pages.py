"""Pages and API of runs and units: what they show, hostile names, and files that cannot act."""

import asyncio
import re

import pytest

from tests.support.station_pages import HTML, asked
from tests.support.stored_results import finding, instant, line, stored

HOSTILE = "<script>alert('QF')</script>&\"'"
LIMIT_BYTES = 300 * 1024


@pytest.fixture
def runs(tmp_path):
    folder = tmp_path / "runs"
    own, zero = line("readings: scatter", 0.03, kind="A"), line("head: zero", 0.04, "head.zero")
    for year in (2020, 2021, 2022):
        stored(folder, instant(year), [finding(0.1 * (year - 2020), own, zero)])
    hostile = stored(
        folder, instant(2023), [finding(1.5, uut=HOSTILE, verdict="FAIL", at={"run": HOSTILE}, quantity=HOSTILE)],
        uut=HOSTILE, title=HOSTILE, operator=HOSTILE, problems=[HOSTILE], bench=HOSTILE,
    )  # fmt: skip
    (hostile / "report.html").write_text("<script>alert(1)</script>")
    (hostile / "report_revisions.json").write_text('{"files": {"report.html": "sha256:h"}}')
    return folder


def answers(tmp_path, runs, *paths, viewer=False, **headers):
    """Answers to requests for these paths."""

    async def ask():
        async with asked(tmp_path, runs) as station:
            client = station.viewer if viewer else station.client
            return [await client.get(path, headers=headers) for path in paths]

    return asyncio.run(ask())


def names(runs):
    return sorted(path.name for path in runs.iterdir())


def pages(runs):
    first, second, _, hostile = names(runs)
    return [
        "/runs", f"/runs/{first}", f"/runs/{hostile}", f"/compare?run={first}&run={second}",
        f"/compare?run={first}&run={hostile}", "/units", "/unit?serial=QF-1", "/queue",
    ]  # fmt: skip


def test_a_page_answers_to_head_as_to_get(tmp_path, runs):
    async def ask():
        async with asked(tmp_path, runs) as station:
            for path in [*pages(runs), "/", "/start", "/login"]:
                whole, head = [await station.client.request(how, path, headers=HTML) for how in ("GET", "HEAD")]
                assert head.status_code == whole.status_code < 400, path
                assert head.headers.get("content-type") == whole.headers.get("content-type")
            assert (await station.client.head("/benches/demo/live")).status_code == 405

    asyncio.run(ask())


@pytest.mark.parametrize("language", ["en", "zh"])
def test_pages_have_no_inline_script_or_style_and_hostile_names_are_text(tmp_path, runs, language):
    paths = pages(runs)
    for path, answer in zip(
        paths, answers(tmp_path, runs, *paths, cookie=f"bench_language={language}", **HTML), strict=True
    ):
        assert answer.status_code == 200, path
        assert f'<html lang="{language}"' in answer.text
        assert "<script>alert" not in answer.text
        assert not re.search(r"<style|\sstyle=|\son[a-z]+=|javascript:", answer.text), path
        scripts = re.findall(r"<script[^>]*>(.*?)</script>", answer.text, re.DOTALL)
        assert scripts
        assert not any(scripts)
        assert answer.headers["content-security-policy"].startswith("default-src 'self'; script-src 'self'")
        assert len(answer.content) < LIMIT_BYTES


def test_the_page_of_a_run_begins_with_its_verdict_and_the_reason(tmp_path, runs):
    (page,) = answers(tmp_path, runs, f"/runs/{names(runs)[-1]}", **HTML)
    verdict, reason, results = (
        page.text.index(text) for text in ("✗ FAIL", "1 of 1 values beyond the limits", "Results")
    )
    assert verdict < reason < results
    assert "worst: 1.500 ± 0.020 g, allowed -1 to 1" in page.text
    assert '<svg class="bullet bad"' in page.text


def test_the_page_of_a_unit_shows_drift_and_the_latest_first(tmp_path, runs):
    (page,) = answers(tmp_path, runs, "/unit?serial=QF-1", **HTML)
    days = re.findall(r">(20\d\d)-01-01</a>", page.text)
    assert days == ["2022", "2021", "2020"]
    assert "Drift per year: 99932 ± 42397 µg" in page.text.replace("</strong>", "").replace("<strong>", "")
    assert "Shared by the last two, and no reason for a difference: head: zero." in page.text


def test_a_run_is_filtered_by_its_form_and_wrong_days_are_said(tmp_path, runs):
    found, wrong = answers(tmp_path, runs, "/runs?unit=QF-1&since=2021-06-01&state=", "/runs?since=yesterday", **HTML)
    assert re.findall(r'name="run" value="(\d{4})', found.text) == ["2022"]
    assert wrong.status_code == 200
    assert "since: " in wrong.text


def test_the_api_compares_runs_and_units(tmp_path, runs):
    first, second, third, _ = names(runs)
    comparison, unit, units, lacking = answers(
        tmp_path, runs, f"/api/v1/comparison?first={first}&second={second}", "/api/v1/unit?serial=QF-1",
        "/api/v1/units?text=qf-1", "/api/v1/unit?serial=none",
    )  # fmt: skip
    assert comparison.json()["results"][0]["e_n"] == pytest.approx(0.1 / (2 * 0.03 * 2**0.5))
    assert [point["run"] for point in unit.json()["series"][0]["points"]] == [first, second, third]
    assert units.json() == {"QF-1": [third, second, first]}
    assert lacking.status_code == 422


def test_a_file_of_a_run_cannot_act(tmp_path, runs):
    run = names(runs)[-1]
    base = f"/api/v1/runs/{run}/files"
    report, shown, results, *refused = answers(
        tmp_path, runs, f"{base}/report.html", f"{base}/report.html?show=true", f"{base}/results.json?show=true",
        f"{base}/..%2F..%2Fstation%2Ftoken", f"{base}/run.lock", f"{base}/%2e%2e", "/api/v1/runs/..%2Fstation/files",
    )  # fmt: skip
    for answer in (report, shown, results):
        assert answer.status_code == 200
        assert answer.headers["content-security-policy"].startswith("sandbox; default-src 'none'")
        assert "script" not in answer.headers["content-security-policy"]
        assert answer.headers["x-content-type-options"] == "nosniff"
    assert report.headers["content-disposition"].startswith("attachment")
    assert results.headers["content-disposition"].startswith("attachment")
    assert shown.headers["content-disposition"].startswith("inline")
    assert [each.status_code for each in refused] == [404, 422, 422, 404]


def test_provenance_has_no_paths_of_the_computer(tmp_path):
    folder = tmp_path / "runs"
    run = stored(
        folder,
        instant(2020),
        request={"bench": "/home/anna/bench.yaml"},
        host={"name": "pc", "python": "", "system": ""},
    )
    (found,) = answers(tmp_path, folder, f"/api/v1/runs/{run.name}/provenance")
    assert found.json()["instruments"]["head"]["serial"] == "H-1"
    assert not {"request", "host"} & found.json().keys()


def test_a_viewer_reads_and_is_offered_no_buttons_that_act(tmp_path, runs):
    paths = [f"/runs/{names(runs)[0]}", "/queue", "/runs"]
    for answer in answers(tmp_path, runs, *paths, viewer=True, **HTML):
        assert answer.status_code == 200
        actions = re.findall(r'<form method="post" action="([^"]+)"', answer.text)
        assert set(actions) <= {"/appearance", "/logout"}


def test_there_is_an_empty_state_that_says_what_to_do(tmp_path):
    for answer in answers(tmp_path, tmp_path / "none", "/runs", "/queue", **HTML):
        assert 'href="/start"' in answer.text


@pytest.mark.parametrize(("moved", "words"), [(0.01, "within it"), (1.0, "beyond it"), (0.6, "not decided")])
def test_the_page_of_a_unit_compares_a_calibration_with_the_specified_drift(tmp_path, moved, words):
    folder, own = tmp_path / "drifting", line("readings: scatter", 0.03, kind="A")
    stored(folder, instant(2020), [{**finding(0.0, own), "monthly_drift": 0.05}])
    stored(folder, instant(2021), [finding(moved, own)])
    (page,) = answers(tmp_path, folder, "/unit?serial=QF-1", **HTML)
    said_of = re.search(r"Changed by [^<]*", page.text)[0]
    assert said_of.startswith(f"Changed by {moved * 1e6:.0f} ± 84853 µg since the calibration before")
    assert f"allows 601232: {words}" in said_of


def test_the_page_of_a_run_says_that_an_uncertainty_is_above_its_limit(tmp_path):
    folder = tmp_path / "uncertain"
    of_u = finding(0.0, line("readings: scatter", 0.03), low=None, high=None, verdict="INVALID", u_max=0.01)
    run = stored(folder, instant(2020), [of_u | {"flags": ["u_too_large"]}])
    page, api = answers(tmp_path, folder, f"/runs/{run.name}", f"/api/v1/runs/{run.name}/findings", **HTML)
    assert "no valid value: its standard uncertainty is above the limit u_max" in page.text
    assert "u at most 10000" in page.text
    assert '<svg class="bullet' not in page.text
    assert api.json()["reasons"] == ["QF-1: tumble/a/K0: u 0.03 g is above its limit 0.01 g"]
