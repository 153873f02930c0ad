"""The frame of all pages: log in and out, errors in words, languages, and a policy that no page needs to break."""

import asyncio
import re
from contextlib import asynccontextmanager

import httpx
import pytest

from bench.station.daemon import at_work
from bench.station.settings import read_station
from bench.station.storage.audit import Audit
from bench.web.app import make_app
from bench.web.assets import HERE
from bench.web.identity import Identity
from bench.web.services import Services

HTML = {"accept": "text/html"}
OWN = {**HTML, "origin": "http://localhost"}
ANNA = {"name": "anna", "password": "a long password"}
INLINE = re.compile(r"""\sstyle=|<style|<script(?![^>]*\ssrc=)|\son[a-z]+=|hx-on|javascript:""")


@asynccontextmanager
async def browser(folder, *, insecure=""):
    """A client as a browser is, of a station with one user."""
    async with at_work(read_station(None, folder / "station", runs=str(folder / "runs")), print) as daemon:
        identity = Identity(daemon.database)
        identity.set_user("anna", "operator", ANNA["password"])
        app = make_app(Services(daemon, identity, Audit(daemon.database), insecure))
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as client:
            yield client


def asking(folder, ask, **options):
    async def main():
        async with browser(folder, **options) as client:
            return await ask(client)

    return asyncio.run(main())


def test_who_is_not_logged_in_is_led_to_the_entrance_and_back(tmp_path):
    async def ask(client):
        first = await client.get("/", headers=HTML)
        assert (first.status_code, first.headers["location"]) == (303, "/login?then=/")
        entrance = await client.get("/login?then=/wall", headers=HTML)
        assert 'value="/wall"' in entrance.text
        done = await client.post("/login", data={**ANNA, "then": "/wall"}, headers=OWN)
        assert (done.status_code, done.headers["location"]) == (303, "/wall")
        page = await client.get("/", headers=HTML)
        assert "<summary>anna</summary>" in page.text
        assert "Nothing runs at Simulated accelerometer bench" in page.text
        out = await client.post("/logout", headers=OWN)
        assert out.headers["location"] == "/login"
        assert (await client.get("/", headers=HTML)).status_code == 303

    asking(tmp_path, ask)


@pytest.mark.parametrize("then", ["//evil.example/", "/\\evil.example", "https://evil.example/", "javascript:1", ""])
def test_no_login_leads_elsewhere(tmp_path, then):
    done = asking(tmp_path, lambda client: client.post("/login", data={**ANNA, "then": then}, headers=OWN))
    assert (done.status_code, done.headers["location"]) == (303, "/")


@pytest.mark.parametrize("origin", ["null", "http://evil.example", "https://localhost"])
def test_a_form_of_another_site_logs_nobody_in(tmp_path, origin):
    done = asking(tmp_path, lambda client: client.post("/login", data=ANNA, headers={**HTML, "origin": origin}))
    assert done.status_code == 403
    assert "set-cookie" not in done.headers


def test_a_wrong_password_is_said_in_the_language_of_the_reader(tmp_path):
    async def ask(client):
        wrong = {**ANNA, "password": "<b>wrong"}
        return [
            await client.post("/login", data=wrong, headers={**OWN, "accept-language": language})
            for language in ("en", "zh-CN,zh;q=0.9")
        ]

    english, chinese = asking(tmp_path, ask)
    assert english.status_code == chinese.status_code == 401
    assert "name or password is wrong" in english.text
    assert "姓名或密码错误" in chinese.text
    assert '<html lang="zh">' in chinese.text


def test_language_and_theme_are_chosen_and_kept(tmp_path):
    async def ask(client):
        await client.post("/appearance", data={"language": "zh", "then": "/login"}, headers=OWN)
        await client.post("/appearance", data={"theme": "dark", "then": "/login"}, headers=OWN)
        return await client.get("/login", headers=HTML)

    assert '<html lang="zh" data-theme="dark">' in asking(tmp_path, ask).text


def test_an_unknown_page_and_a_forbidden_one_are_explained(tmp_path):
    async def ask(client):
        await client.post("/login", data=ANNA, headers=OWN)
        return (
            await client.get("/nowhere", headers=HTML),
            await client.post("/benches/demo/go-on", headers=OWN),
            await client.get("/benches/other", headers=HTML),
            await client.get("/api/v1/users", headers=HTML),
        )

    nowhere, forbidden, other, program = asking(tmp_path, ask)
    assert (nowhere.status_code, "There is no such page" in nowhere.text) == (404, True)
    assert (forbidden.status_code, "You may not do this" in forbidden.text) == (403, True)
    assert (other.status_code, "the station has no bench &#39;other&#39;" in other.text) == (422, True)
    assert program.json()["detail"].startswith("anna may not do this")


def test_the_banner_of_an_insecure_network_is_on_every_page(tmp_path):
    text = "Anybody in this network can read along."
    assert text in asking(tmp_path, lambda client: client.get("/login", headers=HTML), insecure=text).text


def test_files_have_addresses_of_their_content_and_no_name_leaves_the_folder(tmp_path):
    async def ask(client):
        page = await client.get("/login", headers=HTML)
        style = await client.get(re.search(r'href="(/static/style[^"]+)"', page.text)[1])
        return style, [
            await client.get(f"/static/{name}") for name in ("../app.py", "%2e%2e/app.py", "vendor", "x.css")
        ]

    style, others = asking(tmp_path, ask)
    assert style.headers["content-type"].startswith("text/css")
    assert "immutable" in style.headers["cache-control"]
    assert {each.status_code for each in others} == {404}


def test_no_page_has_a_script_or_a_style_inside(tmp_path):
    pages = list((HERE / "templates").rglob("*.j2"))
    assert len(pages) > 10
    assert {page.name: found for page in pages if (found := INLINE.findall(page.read_text("utf-8")))} == {}
    answer = asking(tmp_path, lambda client: client.get("/login", headers=HTML))
    assert "unsafe" not in answer.headers["content-security-policy"]
    assert INLINE.findall(answer.text) == []


def test_an_inline_script_is_seen():
    assert all(INLINE.search(text) for text in ('<p style="x">', "<script>", '<p onclick="x">', '<a hx-on:click="x">'))
