"""Pages of sequences and bench files: who sees and changes what, and that nothing which is refused is lost."""

from __future__ import annotations

import asyncio
import html
import re

import pytest

from bench.web.access import ROLES, Person
from bench.web.pages.source import difference_lines, source_lines
from tests.support.runs import ROOT
from tests.support.station_pages import HTML, _bearer, asked

SMOKE = (ROOT / "sequences/smoke.yaml").read_text("utf-8")
HOSTILE = "<script>alert(1)</script>"
MINE = SMOKE.replace("title: Smoke test", f"title: '{HOSTILE}'  # {HOSTILE}")
BUTTONS = ("/edit", "/copy", 'action="/sequences/mine/release')


def with_station(tmp_path, work):
    async def run():
        async with asked(tmp_path, tmp_path / "runs") as station:
            return await work(station)

    return asyncio.run(run())


async def put(station, name, text, base="", message="begun"):
    content = {"text": text, "base": base, "message": message}
    return await station.client.put(f"/api/v1/sequences/{name}", json=content)


def fields(page):
    """Hidden fields of a page, and the text of its editor."""
    found = dict(re.findall(r'<input type="hidden" name="([^"]+)" value="([^"]*)"', page))
    text = re.search(r"<textarea[^>]*>\n(.*?)</textarea>", page, re.DOTALL)
    return {**found, **({"text": html.unescape(text[1])} if text else {})}


@pytest.mark.lengthy
def test_a_sequence_is_copied_edited_compared_and_released(tmp_path):
    async def work(station):
        client, daemon = station.client, station.services.daemon

        async def send(path, **data):
            return await client.post(path, data=data, headers=HTML)

        # A copy of a shipped sequence.
        copy = fields((await client.get("/sequences/smoke/copy", headers=HTML)).text)
        assert (copy["base"], copy["text"]) == ("", SMOKE)
        more = {"base": "", "bench": "demo", "message": "from smoke"}
        refused = await send("/sequences/smoke/copy", **more, name="../mine", text=MINE, do="save")
        assert refused.status_code == 422
        assert html.unescape(refused.text).count(HOSTILE) >= 2  # it is in the text area still
        saved = await send("/sequences/smoke/copy", **more, name="mine", text=MINE.replace("\n", "\r\n"), do="save")
        assert (saved.status_code, saved.headers["location"]) == (303, "/sequences/mine?bench=demo")

        # Two editors.
        ann, bob = [fields((await client.get("/sequences/mine/edit", headers=HTML)).text) for _ in range(2)]
        assert ann["text"] == MINE
        change = {"bench": "demo", "do": "save", "message": "longer gate"}
        first = await send("/sequences/mine/edit", **change, base=ann["base"], text=MINE.replace("5 s", "6 s"))
        assert first.status_code == 303
        second = await send("/sequences/mine/edit", **change, base=bob["base"], text=MINE.replace("5 s", "7 s"))
        assert second.status_code == 409
        assert "nothing was saved" in second.text
        assert '<span class="removed">-    default: 6 s' in second.text
        assert '<span class="added">+    default: 7 s' in second.text
        again = fields(second.text)
        assert again["text"] == MINE.replace("5 s", "7 s")
        assert 'value="longer gate"' in second.text
        assert "6 s" in daemon.texts.text("mine").text
        over = await send("/sequences/mine/edit", **change, base=again["base"], text=again["text"])
        assert over.status_code == 303

        # Versions and their difference.
        newest, before, begun = (await client.get("/api/v1/sequences/mine/versions")).json()
        assert (begun["by"], begun["message"], newest["message"]) == ("anna", "from smoke", "longer gate")
        path = f"/sequences/mine/difference?old={before['id']}&new={newest['id']}"
        page = (await client.get(path, headers=HTML)).text
        assert "-    default: 6 s" in page
        assert "+    default: 7 s" in page

        # A check without saving, as the form does it and as the script does it.
        wrong = again["text"].replace("move: head", "move: haed", 1)
        checked = await send("/sequences/mine/edit", text=wrong, base="", bench="demo", do="check")
        line = wrong[: wrong.index("haed")].count("\n") + 1
        assert f'href="#L{line}"' in checked.text
        assert "haed" in checked.text
        typed = (await send("/sequences/mine/check", text=wrong, bench="demo")).json()
        assert (typed["found"][0]["line"], typed["found"][0]["severity"]) == (line, "error")
        good = (await send("/sequences/mine/check", text=again["text"], bench="demo")).json()
        assert good["found"] == []
        assert 'src="data:image/svg+xml,' in good["html"]
        cursor = {"text": "sch", "at": 3, "bench": "demo"}
        assert (await client.post("/api/v1/completion", json=cursor)).json()["options"][0]["label"] == "schema"
        unreadable = await send("/sequences/mine/edit", **change, base=newest["id"], text="a: 1\n")
        assert unreadable.status_code == 422
        assert "mine.yaml:1:1: a: unknown key" in unreadable.text

        # Release: of what was seen, with a reason.
        page = (await client.get("/sequences/mine?bench=demo", headers=HTML)).text
        seen = {"bench": "demo", "digest": fields(page)["digest"]}
        assert (await send("/sequences/mine/release", **seen, comment=" ")).status_code == 422
        stale = await send("/sequences/mine/release", bench="demo", digest="0" * 64, comment="tried")
        assert "changed since this page was shown" in stale.text
        assert daemon.releases.all() == []
        assert (await send("/sequences/mine/release", **seen, comment="tried")).status_code == 303
        assert (
            await send("/sequences/mine/edit", **change, base=daemon.texts.text("mine").digest, text=MINE)
        ).is_redirect
        page = (await client.get("/sequences/mine", headers=HTML)).text
        assert "changed since its release" in page
        assert '<span class="removed">-    default: 7 s' in page
        assert "changed since its release" in (await client.get("/sequences", headers=HTML)).text

        # A bench file.
        page = (await client.get("/bench-files/demo", headers=HTML)).text
        assert "if_counter.dbc" in page
        released = await send("/bench-files/demo/release", digest=fields(page)["digest"], comment="as built")
        assert released.status_code == 303
        assert "✓ released" in (await client.get("/bench-files/demo", headers=HTML)).text

        entries = [(each["action"], each["of"], each.get("reason")) for each in station.services.audit.entries()]
        assert entries == [
            ("save sequence", "mine", "from smoke"), ("save sequence", "mine", "longer gate"),
            ("save sequence", "mine", "longer gate"), ("release sequence", "mine", "tried"),
            ("save sequence", "mine", "longer gate"), ("release bench", "demo", "as built"),
        ]  # fmt: skip

        # What is released this way is what a station of released versions starts.
        inputs = (await client.get("/api/v1/benches/demo/files")).json()["texts"]
        texts = dict(daemon.releases.newest("sequence", "mine").texts)
        daemon.releases.expect_released("mine", "demo", {**inputs, **texts})

    with_station(tmp_path, work)


@pytest.mark.lengthy
def test_everybody_reads_and_hostile_text_is_text(tmp_path):
    async def work(station):
        assert (await put(station, "mine", MINE, message=HOSTILE)).status_code == 200
        (version,) = (await station.client.get("/api/v1/sequences/mine/versions")).json()
        identity = station.services.identity
        operator = identity.new_token(
            Person("otto", ROLES["operator"], "token", is_user=False), "t", ROLES["operator"], 1
        )
        found = {}
        for language in ("en", "zh"):
            for path in ("", "/mine", f"/mine/difference?old={version['id']}&new=now", "/smoke"):
                headers = {**HTML, "cookie": f"bench_language={language}"}
                answer = await station.viewer.get(f"/sequences{path}", headers=headers)
                assert answer.status_code == 200, path
                assert HOSTILE not in answer.text
                assert not re.search(r"<style|\sstyle=|\son[a-z]+=|javascript:", answer.text), path
                assert not any(re.findall(r"<script[^>]*>(.*?)</script>", answer.text, re.DOTALL))
                assert not any(each in answer.text for each in BUTTONS)
                found[language, path] = answer.text
            for path in ("/sequences/mine/edit", "/sequences/mine/copy"):
                page = await station.client.get(path, headers={**HTML, "cookie": f"bench_language={language}"})
                assert HOSTILE not in page.text
                assert not re.search(r"<style|\sstyle=|\son[a-z]+=|javascript:", page.text), path
        assert "放行版本" in found["zh", "/mine"]
        assert "Released version" in found["en", "/mine"]
        page = (await station.client.get("/sequences/mine", headers=HTML)).text
        assert all(each in page for each in BUTTONS)
        page = (await station.client.get("/sequences/mine", headers={**HTML, **_bearer(operator)})).text
        assert not any(each in page for each in BUTTONS)
        assert "/start?sequence=mine" in page
        assert (await station.client.get("/sequences/smoke/edit", headers=HTML)).status_code == 422  # shipped
        for path in ("/sequences/none", "/sequences/%2e%2e%2fx", "/sequences/mine?bench=none", "/bench-files/none"):
            assert (await station.client.get(path, headers=HTML)).status_code in (404, 422), path

    with_station(tmp_path, work)


def test_styles_of_the_editor_alone_are_admitted_each_time_anew(tmp_path):
    async def work(station):
        pages = [await station.client.get("/sequences/smoke/copy", headers=HTML) for _ in range(2)]
        other = await station.client.get("/sequences", headers=HTML)
        return [each.headers["content-security-policy"] for each in (*pages, other)], pages[0].text

    (first, second, other), page = with_station(tmp_path, work)
    nonce = re.search(r'data-nonce="([^"]+)"', page)[1]
    assert f"style-src 'self' 'nonce-{nonce}';" in first
    assert "script-src 'self';" in first
    assert first != second
    assert "nonce" not in other
    assert "unsafe" not in first


def test_a_large_file_is_sent_compressed_to_who_reads_it(tmp_path):
    async def work(station):
        path = "/static/vendor/codemirror.min.js"
        small, large = [
            await station.client.get(path, headers={"accept-encoding": how}) for how in ("gzip", "identity")
        ]
        return small, large

    small, large = with_station(tmp_path, work)
    assert (small.headers["content-encoding"], small.headers["vary"]) == ("gzip", "accept-encoding")
    assert int(small.headers["content-length"]) < 0.4 * len(large.content)
    assert small.content == large.content


def test_lines_of_a_source_and_of_a_difference_have_their_kinds():
    lines = source_lines("a: <b>  # 'c'\n\nd: |\n  e\n  f\n")
    assert len(lines) == 5
    assert lines[0].startswith('<span class="nt">a</span>')
    assert "&lt;b&gt;" in lines[0]
    kinds = [each.kind for each in difference_lines(["--- a", "+++ b", "@@ -1 +1 @@", "--- x", "+++ y", " z"])]
    assert kinds == ["file", "file", "place", "removed", "added", ""]
