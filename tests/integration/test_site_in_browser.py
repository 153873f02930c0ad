"""The site of the documentation, without a server and a network: Chromium searches it and lays it out."""

from __future__ import annotations

import fcntl
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

import pytest

from tests.support.runs import ROOT

pytestmark = [pytest.mark.integration, pytest.mark.peer("sphinx")]
in_browser = pytest.mark.peer("chromium")
QUIET = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
PAGES = ["README", "docs/instruments/README", "bench/methods/tumble/README"]


def build(source: Path, site: Path) -> subprocess.CompletedProcess[str]:
    """Build as `make docs` does; what has not changed since the last time in this folder is not built again."""
    command = ["sphinx", "-q", "-W", "--keep-going", "-j", "2", "-c", str(ROOT / "docs")]
    where = ["-d", str(site.with_name("doctrees")), str(source), str(site)]
    return subprocess.run([sys.executable, "-m", *command, *where], capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def site() -> Path:
    """The site of `make docs`, up to date; workers of one test run build it once."""
    folder = ROOT / "build/docs"
    folder.parent.mkdir(exist_ok=True)
    with (folder.parent / "docs.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = build(ROOT, folder)
    assert (done.returncode, done.stderr) == (0, "")
    return folder


@pytest.fixture
def opened(site: Path, tmp_path: Path) -> Callable[..., str]:
    """Opens a page of the site, by its name and query; the page as it is then."""

    def open_page(name: str, *options: str) -> str:
        path, _, query = name.partition("?")
        address = (site / path).as_uri() + (f"?{query}" if query else "")
        profile = f"--user-data-dir={tmp_path / 'profile'}"
        command = [shutil.which("chromium"), *QUIET, profile, "--virtual-time-budget=8000", "--dump-dom", *options]
        return subprocess.run([*command, address], capture_output=True, text=True, timeout=60, check=True).stdout

    return open_page


def test_what_a_browser_opens_first_is_the_readme(site: Path) -> None:
    assert (site / "index.html").read_bytes() == (site / "README.html").read_bytes()


def test_no_page_loads_anything_from_elsewhere(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    loaded = re.compile(r"<(?:script|link|img)\b[^>]*(?:src|href)=\"(?:https?:)?//[^\"]*")
    assert len(pages) > 150
    assert [(page.name, found) for page in pages for found in loaded.findall(page.read_text("utf-8"))] == []


def test_every_page_has_light_and_dark_and_a_search(site: Path) -> None:
    page = (site / "docs/how-to/unattended.html").read_text("utf-8")
    assert "prefers-color-scheme: dark" in (site / "_static/styles/furo.css").read_text("utf-8").replace(
        ":dark", ": dark"
    )
    assert "theme-toggle" in page
    assert 'action="../../search.html"' in page


@in_browser
@pytest.mark.parametrize(
    ("words", "page"),
    [
        ("guardian", "docs/glossary.html"),
        ("dwell", "docs/glossary.html"),
        ("watlow", "docs/instruments/watlow_f4t.html"),
    ],
)
def test_the_search_finds_pages_for_users_before_decisions(opened, words: str, page: str) -> None:
    found = re.findall(r'<li class="kind-[^>]*><a href="([^"#]*)', opened(f"search.html?q={quote(words)}"))
    assert page in found[:3]
    kinds = ["decisions" in each or "CHANGELOG" in each for each in found]
    assert kinds == sorted(kinds)


@in_browser
@pytest.mark.parametrize("width", [500, 900, 1500])
@pytest.mark.parametrize("page", PAGES)
def test_nothing_is_wider_than_the_window(site: Path, opened, page: str, width: int) -> None:
    measured = site / f"{page}.measured-{width}.html"
    script = "<script>document.title = `${innerWidth} ${document.documentElement.scrollWidth}`</script></body>"
    measured.write_text((site / f"{page}.html").read_text("utf-8").replace("</body>", script), "utf-8")
    name = measured.relative_to(site).as_posix()
    shown = opened(name, "--hide-scrollbars", f"--window-size={width},900")
    measured.unlink()
    title = re.search(r"<title>(\d+) (\d+)</title>", shown)
    assert title is not None
    assert title[1] == title[2] == str(width)


@pytest.mark.parametrize("link", ["[a](docs/none.md)", "[a](docs/here.md#none)", "[a](#none)", "![a](none.png)"])
def test_a_link_that_leads_nowhere_is_an_error(tmp_path: Path, link: str) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs/here.md").write_text("# Here\n", "utf-8")
    (tmp_path / "README.md").write_text(f"# Start\n\n{link}\n", "utf-8")
    done = build(tmp_path, tmp_path / "site")
    assert done.returncode != 0
    assert re.search(r"README.md:3: WARNING: .*none", done.stderr)
