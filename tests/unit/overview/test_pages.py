"""Pages of all benches: what they show, to whom, and that they are as safe as those of a station."""

import asyncio
import platform
import re
from datetime import timedelta

import pytest
from fastapi.routing import APIRoute

from bench.archive.destination import Destination
from bench.archive.publish import push
from bench.errors import InputError
from bench.overview.board import MOST_SHOWN, Viewer
from bench.overview.pages import _stream
from bench.overview.server import ROUTERS, zone_of
from bench.web.access import Scope, routes_of, scope_of
from tests.support.overview import NOW
from tests.support.overview_pages import HTML, PASSWORD, all_benches
from tests.unit.web.test_entrance import INLINE

HOSTILE = "<img src=x onerror=alert(1)>{{ 7 * 7 }}\"'"
ORIGIN = {"origin": "http://localhost"}


def with_pages(folder, act, **more):
    async def main():
        async with all_benches(folder, **more) as pages:
            return await act(pages)

    return asyncio.run(main())


def test_a_board_shows_each_bench_with_what_a_technician_asks(tmp_path):
    async def act(pages):
        url = "http://lab.example.org:8421/benches/a"
        pages.told.online().state(units=("QF-1",), sentence="Soaking at −40 °C", url=url)
        pages.told.asks("Turn it over.").reading(-39.5)
        pages.told.state("b", url=url, sentence="Soaking at −40 °C").idle("c").result("r", "FAIL", "c")
        pages.told.later(minutes=5).online()
        page = await pages.get("/")
        for text in (
            "Needs an answer", "Turn it over.", "since 13:00, for 5 min", f'href="{url}"', "Answer at the station",
            "QF-1", "−39.5 °C", "Soaking at −40 °C", "ends about 14:30", "Nothing runs",
            "Last run: Smoke test · QF-1 · FAIL", "step 2 of 4", "Laboratory",
        ):  # fmt: skip
            assert text in page, text
        assert page.index("Bench a") < page.index("Bench b") < page.index("Bench c")
        chinese = await pages.get("/", **{"accept-language": "zh"})
        for text in ("等待回答", "自 13:00 起，已 5 min", "到该工作站回答", "约 14:30 结束"):
            assert text in chinese, text

    with_pages(tmp_path, act)


def test_names_that_are_markup_are_text_on_every_page(tmp_path):
    async def act(pages):
        hostile = {"title": HOSTILE, "run": HOSTILE, "run_title": HOSTILE, "units": (HOSTILE,), "sentence": HOSTILE}
        pages.told.online(title=HOSTILE, version=HOSTILE, computer=HOSTILE)
        pages.told.state(HOSTILE.replace("/", ""), problems=(HOSTILE,), stopped=HOSTILE, held_by=(HOSTILE,), **hostile)
        pages.told.state("b", **hostile).asks(HOSTILE, "b").alarm(1, HOSTILE, "b").tell("lab/b/results", b"[]")
        keys = [card.key for card in pages.told.cards()]
        for path in ("/", "/wall", *(f"/bench/{key}" for key in keys)):
            for language in ("en", "zh"):
                page = await pages.get(path, **{"accept-language": language})
                assert "&lt;img src=x onerror" in page
                assert "<img" not in page
                assert ">49" not in page
                assert INLINE.findall(page.replace(" onerror=alert", "")) == []

    with_pages(tmp_path, act)


def test_a_link_to_a_computer_itself_is_for_that_computer_alone(tmp_path):
    async def act(pages):
        url = "http://127.0.0.1:8421/benches/a"
        pages.told.online(computer="elsewhere").state(url=url).asks()
        assert url not in await pages.get("/")
        pages.told.online(computer=platform.node())
        assert url in await pages.get("/")

    with_pages(tmp_path, act)


def test_a_station_is_chosen_and_what_is_gone_is_hidden(tmp_path):
    async def act(pages):
        pages.told.online("one", title="First").state("a", "one").online("two", title="Second").state("b", "two")
        pages.told.offline("old", retained=True).state("o", "old", at=NOW - timedelta(days=99), retained=True)
        every = await pages.get("/")
        assert all(f"Bench {name}" in every for name in "abo")
        hidden = await pages.get("/?gone=hide")
        assert "Bench o" not in hidden
        assert "Bench a" in hidden
        one = await pages.get("/?station=two")
        assert "Bench b" in one
        assert "Bench a" not in one
        assert "Bench a" in await pages.get("/?station=nowhere")

    with_pages(tmp_path, act)


def test_a_broker_that_is_away_is_said_and_since_when(tmp_path):
    async def act(pages):
        pages.told.online().state()
        pages.site.subscription.problem, pages.site.subscription.since = "[Errno 111] refused", NOW
        page = await pages.get("/")
        assert "No connection to the broker since 13:00." in page
        assert "[Errno 111] refused" in page
        assert "Bench a" in page

    with_pages(tmp_path, act)


def test_without_benches_and_with_too_many_of_them(tmp_path):
    async def act(pages):
        assert "No bench is known yet" in await pages.get("/")
        for number in range(MOST_SHOWN + 5):
            pages.told.online(f"lab{number // 10}").idle(str(number), station=f"lab{number // 10}")
        page = await pages.get("/")
        assert page.count('class="bench-card') == MOST_SHOWN
        assert "5 more benches are not shown" in page

    with_pages(tmp_path, act)


def test_the_stream_brings_what_changes_and_the_board_when_a_bench_moves(tmp_path):
    async def act(pages):
        boards = pages.site.boards
        pages.told.online().state("a").state("b")
        stream = _stream(boards, Viewer("en"))

        async def following():
            boards._cards = None
            boards._parts.clear()
            return re.findall(r"^event: (.*)$", await anext(stream), re.MULTILINE)

        assert await following() == ["board", "status"]
        card = pages.told.cards()[0]
        pages.told.reading(20.0)
        assert await following() == [f"n-{card.key}"]
        pages.told.state("a", sentence="Soaking")
        assert await following() == [f"m-{card.key}"]
        pages.told.asks()
        assert (await following())[0] == "board"
        await stream.aclose()

    with_pages(tmp_path, act)


def test_nothing_is_shown_to_nobody_and_nothing_can_be_commanded(tmp_path):
    async def act(pages):
        pages.told.online().state()
        key = pages.told.card().key
        for path in ("/", "/wall", "/live", f"/bench/{key}", "/unit", "/api/v1/users"):
            answer = await pages.nobody.get(path)
            assert answer.status_code == 401, path
            assert "Bench a" not in answer.text
            if not path.startswith("/api"):
                led = await pages.nobody.get(path, headers=HTML)
                assert (led.status_code, led.headers["location"]) == (303, f"/login?then={path}")
        assert (await pages.viewer.get("/bench/0000", headers=HTML)).status_code == 404
        assert (await pages.viewer.post("/api/v1/runs/r/abort")).status_code == 404

    with_pages(tmp_path, act)


def test_only_the_routes_of_people_change_anything():
    routes = [route for router in ROUTERS for route in routes_of(router.routes) if isinstance(route, APIRoute)]
    changing = {(route.path, scope_of(route)) for route in routes if route.methods - {"GET", "HEAD"}}
    assert {path for path, scope in changing if scope not in (Scope.ADMIN, Scope.OPEN)} == {
        "/api/v1/logout", "/api/v1/tokens",
    }  # fmt: skip
    assert {path for path, scope in changing if scope is Scope.OPEN} == {
        "/login", "/logout", "/appearance", "/api/v1/login", "/api/v1/login/code",
    }  # fmt: skip


def test_the_answers_have_the_policy_of_a_station(tmp_path):
    async def act(pages):
        page = await pages.viewer.get("/", headers=HTML)
        policy = page.headers["content-security-policy"]
        assert "default-src 'self'" in policy
        assert "unsafe" not in policy
        assert page.headers["x-frame-options"] == "DENY"
        other = await pages.viewer.get("/", headers={"host": "evil.example"})
        assert other.status_code == 421
        session = await pages.nobody.post("/login", data={"name": "anna", "password": PASSWORD}, headers=ORIGIN)
        assert session.status_code == 303
        cookie = session.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
        for headers in ({}, {"origin": "http://evil.example"}, {"origin": "null"}):
            assert (await pages.nobody.post("/logout", headers=headers)).status_code == 403
        cross = await pages.nobody.get(
            "/", headers={**HTML, "sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors"}
        )
        assert cross.status_code == 403

    with_pages(tmp_path, act)


def test_a_cookie_behind_tls_is_for_tls_and_this_host_alone(tmp_path):
    async def act(pages):
        own = {"origin": "https://localhost"}
        session = await pages.nobody.post("/login", data={"name": "anna", "password": PASSWORD}, headers=own)
        assert session.headers["set-cookie"].startswith("__Host-bench_session=")
        assert "Secure" in session.headers["set-cookie"]
        assert session.headers["strict-transport-security"]

    with_pages(tmp_path, act, secure=True)


def test_who_guesses_passwords_has_to_wait(tmp_path):
    async def act(pages):
        answers = [
            (
                await pages.nobody.post("/login", data={"name": "anna", "password": f"wrong {n}"}, headers=ORIGIN)
            ).status_code
            for n in range(5)
        ]
        assert answers == [401, 401, 401, 429, 429]

    with_pages(tmp_path, act)


@pytest.mark.leaves("threads of the libraries of the archive")
def test_the_history_of_a_bench_and_a_unit_is_from_the_archive(tmp_path, smoke_copy):
    archive = tmp_path / "archive"
    push(smoke_copy, Destination(str(archive)))

    async def act(pages):
        title = "Simulated accelerometer bench"
        pages.told.online(computer=platform.node()).idle()
        pages.told.tell("lab/a/state", f'{{"title": "Left", "bench": "{title}"}}'.encode())
        page = await pages.get(f"/bench/{pages.told.card().key}")
        assert "Smoke test" in page
        assert '<a href="/unit?serial=QF-0001">QF-0001</a>' in page
        unit = await pages.get("/unit?serial=QF-0001")
        assert "1 runs" in unit
        assert "Drift per year" in unit
        none = await pages.get("/unit?serial=%3Cb%3E")
        assert "no results of a unit" in none
        assert "<b>" not in none
        assert "Serial number" in await pages.get("/unit")

    with_pages(tmp_path, act, archive=str(archive))


@pytest.mark.leaves("threads of the libraries of the archive")
def test_an_archive_that_is_not_there_is_said_on_the_page(tmp_path):
    async def act(pages):
        pages.told.online().state()
        page = await pages.get(f"/bench/{pages.told.card().key}")
        assert 'class="problem" role="alert"' in page
        assert str(tmp_path / "nowhere") in page

    with_pages(tmp_path, act, archive=str(tmp_path / "nowhere"))


def test_the_time_zone_of_the_page(monkeypatch):
    monkeypatch.setenv("TZ", "Asia/Shanghai")
    assert zone_of("") == "Asia/Shanghai"
    assert zone_of("Europe/Berlin") == "Europe/Berlin"
    with pytest.raises(InputError, match="--zone Nowhere: is not known"):
        zone_of("Nowhere")
