"""Chromium, without a network, opens, lays out and prints the report of a run."""

import re
import shutil
import subprocess

import pytest

from tests.support.runs import run_short

pytestmark = [pytest.mark.integration, pytest.mark.peer("chromium")]

QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--hide-scrollbars", "--enable-logging=stderr",
)  # fmt: skip


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    return run_short(tmp_path_factory.mktemp("runs"), units=("<b>QF-0001",), no_report=False).path / "report.html"


@pytest.fixture
def chromium(tmp_path):
    """Opens a file with more options; its standard output and what the page had to complain about."""

    def open_file(path, *options):
        profile = tmp_path / "profile"
        command = [shutil.which("chromium"), *QUIET, f"--user-data-dir={profile}", *options, path.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=50, check=True)
        return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]

    return open_file


def test_the_page_is_what_was_written_and_nothing_complains(report, chromium):
    page, complaints = chromium(report, "--dump-dom")
    assert complaints == []
    assert re.findall(r'<section id="([\w-]+)">', page) == [
        "run", "verdicts", "course", "unit-a-0", "meaning", "signatures", "provenance", "annex"
    ]  # fmt: skip
    assert page.count("<svg ") == page.count("</svg>") == 6
    assert "&lt;b&gt;QF-0001 in place a" in page
    assert page.count("<details>") == 3


@pytest.mark.parametrize("width", [1200, 820, 500])
def test_nothing_is_wider_than_the_window(report, chromium, tmp_path, width):
    measured = tmp_path / "measured.html"
    script = "<script>document.title = `${innerWidth} ${document.documentElement.scrollWidth}`</script>"
    opened = report.read_text("utf-8").replace("<details>", "<details open>")
    measured.write_text(opened.replace("</body>", f"{script}</body>"), "utf-8")
    page, _ = chromium(measured, "--dump-dom", f"--window-size={width},900")
    assert re.search(r"<title>(.*)</title>", page)[1] == f"{width} {width}"


def test_it_prints_on_a_few_pages(report, chromium, tmp_path):
    paper = tmp_path / "report.pdf"
    chromium(report, "--no-pdf-header-footer", f"--print-to-pdf={paper}")
    pages = re.findall(rb"/Type /Page\b", paper.read_bytes())
    assert 4 <= len(pages) <= 11
