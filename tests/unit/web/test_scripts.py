"""Our scripts are JavaScript that node reads, and no larger than the page may weigh."""

import re
import shutil
import subprocess

import pytest

from bench.web.assets import HERE
from bench.web.pages.files import compressed

SCRIPTS = sorted((HERE / "static").glob("*.js"))


@pytest.mark.peer("node")
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_node_reads_it(script):
    done = subprocess.run(
        [shutil.which("node"), "--check", "--input-type=module"],
        input=script.read_bytes(),
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")


OF_THE_EDITOR = {"codemirror.min.js", "editor.js"}


def test_the_page_of_a_bench_loads_less_than_300_kilobytes():
    files = [path for path in (HERE / "static").rglob("*") if path.suffix in (".js", ".css", ".svg")]
    files = [path for path in files if path.name not in OF_THE_EDITOR]
    assert len(files) > 6
    assert sum(path.stat().st_size for path in files) < 250_000  # the page itself is about 30 kB


def test_the_editor_is_on_its_page_alone_and_is_sent_with_less_than_150_kilobytes():
    using = [
        path.name for path in (HERE / "templates").rglob("*.j2") if re.search("codemirror|editor.js", path.read_text())
    ]
    assert using == ["edit.html.j2"]
    assert len(compressed(HERE / "static/vendor/codemirror.min.js")) < 150_000
