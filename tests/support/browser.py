"""A browser with which a test looks at the pages of a station."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tests.support.runs import ROOT

OPTIONS = ("--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
AXE = ROOT / "build/test_assets/axe.min.js"
GRAVE = ("serious", "critical")


class Seen:
    """A page, and its errors in the console: of scripts, of the content security policy, of failed loads."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.complaints: list[str] = []
        page.on("console", lambda message: message.type == "error" and self.complaints.append(message.text))
        page.on("pageerror", lambda problem: self.complaints.append(str(problem)))

    def log_in(self, url: str, code: str) -> None:
        """Log in with the code of the first start."""
        self.page.goto(url)
        self.page.fill("#code", code)
        self.page.click("main button")
        self.page.wait_for_url(url)

    def grave(self) -> list[str]:
        """Return the serious findings of axe-core in the page."""
        self.page.evaluate(AXE.read_text("utf-8"))
        found = json.loads(self.page.evaluate("axe.run().then(JSON.stringify)"))
        assert len(found["passes"]) > 5
        return [
            f"{each['id']}: {node['target']} {node['failureSummary']}"
            for each in found["violations"] if each["impact"] in GRAVE for node in each["nodes"]
        ]  # fmt: skip


@contextmanager
def browsing(**context: Any) -> Iterator[Seen]:
    """Chromium with one page until the block ends; `context` are options such as viewport and color_scheme."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=list(OPTIONS))
        try:
            yield Seen(browser.new_context(**{"viewport": {"width": 1280, "height": 800}, **context}).new_page())
        finally:
            browser.close()
