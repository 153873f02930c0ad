"""Start and queue: each step when the one before is done, checks before the button, and what a form changes."""

import asyncio
import re
from urllib.parse import urlencode

import pytest

from bench.station.queue.items import ItemState
from bench.web.pages.start import changed_settings, draft_of
from tests.support.served import on_real_wires
from tests.support.station_pages import HTML, asked

SMOKE = {"sequence": "smoke", "bench": "demo"}
UNIT = {**SMOKE, "unit.a": "QF-1", "units_done": "1"}
READY = {**UNIT, "parameters_done": "1"}


def with_station(tmp_path, work, bench="simulated"):
    async def run():
        async with asked(tmp_path, tmp_path / "runs", bench) as station:
            return await work(station)

    return asyncio.run(run())


async def opened(station, fields, **more):
    return await station.client.get(f"/start?{urlencode(fields)}", headers=HTML, **more)


def open_steps(page):
    return re.findall(r'is-open">\s*<h2><span class="number">(\d)', page)


def test_each_step_opens_when_the_one_before_is_done(tmp_path):
    async def work(station):
        return [(await opened(station, fields)).text for fields in ({}, SMOKE, UNIT)]

    found = with_station(tmp_path, work)
    assert [open_steps(each) for each in found] == [["1"], ["2"], ["3"]]
    assert all("Start the run" not in each for each in found)
    assert (
        'name="unit.a" value="" maxlength="64" autocomplete="off" autocapitalize="off" spellcheck="false" autofocus'
        in found[1]
    )


@pytest.mark.lengthy
def test_the_button_is_there_after_the_checks_and_starts_the_run(tmp_path):
    async def work(station):
        page = (await opened(station, {**READY, "speed": "60"})).text
        wrong = (await opened(station, {**READY, "set.gate": "1 kg"})).text
        fields = dict(re.findall(r'name="([^"]+)" value="([^"]*)"', page.partition('action="/start">')[2]))
        started = await station.client.post("/start", data={**fields, "unattended": "1"}, headers=HTML)
        again = await station.client.post("/start", data={**fields, "unattended": "1"}, headers=HTML)
        return page, wrong, started, again, station.services.daemon.queue.items()

    page, wrong, started, again, items = with_station(tmp_path, work)
    assert open_steps(page) == ["4", "5"]
    assert "Checked: about" in page
    assert "every instrument is simulated" in page
    assert "This run cannot start" in wrong
    assert "--set gate=1 kg" in wrong
    assert "Start the run" not in wrong
    assert started.status_code == again.status_code == 303
    assert started.headers["location"] == again.headers["location"]  # a form that is sent twice is one item
    (item,) = items
    assert started.headers["location"] == f"/queue/{item.id}"
    assert (item.submission.units, item.submission.speed, item.submission.unattended) == ({"a": "QF-1"}, "60", True)


def test_a_form_of_somebody_else_is_refused_in_words(tmp_path):
    async def work(station):
        answers = [
            await opened(station, {"sequence": "../../etc/passwd", "bench": "demo"}),
            await opened(station, {"sequence": "smoke", "bench": "none"}),
            await opened(station, {f"set.{n}": "x" for n in range(300)}),
            await station.client.post("/start", data=SMOKE, headers=HTML),
            await station.viewer.get("/start", headers=HTML),
        ]
        return [each.status_code for each in answers], station.services.daemon.queue.items()

    codes, items = with_station(tmp_path, work)
    assert codes == [422, 422, 422, 422, 403]
    assert items == []


def test_only_what_differs_from_the_preset_is_set(tmp_path):
    async def work(station):
        sequence = station.services.daemon.sequences.named("tumble_static")
        quick = sequence.shown_with("quick")
        fields = {f"set.{name}": value for name, value in quick.items()} | {"set.gate": "10 s", "preset": "quick"}
        return changed_settings(draft_of(fields), sequence)

    assert with_station(tmp_path, work) == {"gate": "10 s"}


def test_items_are_ordered_held_released_cloned_and_cancelled(tmp_path):
    async def work(station):
        queue = station.services.daemon.queue
        queue.stop("demo", "the run is interrupted <b>")
        from bench.station.queue.items import Submission

        first, second = (
            queue.submit(Submission(sequence="smoke", bench="demo", units={"a": f"QF-{n}"}), "anna") for n in (1, 2)
        )

        async def act(item, action, **data):
            return (await station.client.post(f"/queue/{item.id}/{action}", data=data, headers=HTML)).status_code

        page = (await station.client.get("/queue", headers=HTML)).text
        codes = [
            await act(second, "up"), await act(first, "hold"), await act(first, "release"), await act(second, "clone"),
            await act(first, "cancel", version="0"), await act(second, "cancel"), await act(second, "down"),
        ]  # fmt: skip
        order = [each.submission.units["a"] for each in queue.waiting()]
        gone_on = await station.client.post("/benches/demo/go-on", headers=HTML)
        return page, codes, order, queue.item(second.id), gone_on.status_code

    page, codes, order, second, gone_on = with_station(tmp_path, work)
    assert "the run is interrupted &lt;b&gt;" in page
    assert 'action="/benches/demo/go-on"' in page
    assert codes == [303, 303, 303, 303, 409, 303, 409]  # seen in an older version; not waiting any more
    assert order == ["QF-1", "QF-2"]
    assert second.state is ItemState.CANCELLED
    assert gone_on == 303


def test_the_picture_of_a_plan_runs_no_script(tmp_path):
    async def work(station):
        return await station.client.get("/api/v1/plan.svg?sequence=smoke&bench=demo&place=a")

    picture = with_station(tmp_path, work)
    assert picture.headers["content-type"] == "image/svg+xml"
    assert picture.headers["content-security-policy"] == "default-src 'none'; style-src 'unsafe-inline'; sandbox"
    assert picture.text.startswith("<?xml")


@pytest.mark.lengthy
def test_a_rehearsal_is_a_job_whose_result_the_page_shows(tmp_path):
    async def work(station):
        asked_for = await station.client.post("/start/rehearsal", data=READY, headers=HTML)
        meanwhile = (await opened(station, READY)).text
        await station.services.daemon.jobs.finished()
        return asked_for, meanwhile, (await opened(station, READY)).text

    asked_for, meanwhile, page = with_station(tmp_path, work)
    assert asked_for.status_code == 303
    assert "It is rehearsed" in meanwhile
    assert 'hx-trigger="every 4s"' in meanwhile
    assert "The rehearsal ended: completed" in page


@pytest.mark.lengthy
def test_a_run_that_its_preflight_refuses_is_not_left_alone(tmp_path):
    """No instrument answers at the addresses of the bench: an attended run may be queued, an unattended one may not."""

    async def work(station):
        page = (await opened(station, READY)).text
        refused = await station.client.post("/start", data={**READY, "unattended": "1"}, headers=HTML)
        return page, refused, station.services.daemon.queue.items()

    page, refused, items = with_station(tmp_path, work, str(on_real_wires(tmp_path)))
    assert re.search(r'<th scope="row">instruments</th><td>✗ no</td>', page)
    assert re.search(r'name="unattended" value="1" disabled', page)
    assert "Start the run" in page
    assert refused.status_code == 422
    assert "the preflight does not let this run be unattended" in refused.text
    assert items == []
