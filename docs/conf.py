"""Settings of the documentation site, which `make docs` builds from the pages where they are in the repository."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from sphinx.addnodes import pending_xref

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.application import Sphinx

project = "Inertial test bench"
extensions = ["myst_parser"]
root_doc = "README"
include_patterns = [
    "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "docs/**.md", "bench/**/README.md", "simulators/README.md",
]  # fmt: skip
exclude_patterns = [".*", "build", "dist", "runs"]
myst_heading_anchors = 6  # the anchors that a forge makes, so that a link is right in both

html_theme = "furo"
html_title = project
html_copy_source = False
html_show_sphinx = False
html_static_path = ["_site"]
html_css_files = ["site.css"]
html_search_scorer = str(Path(__file__).parent / "_site/scorer.js")
highlight_language = "text"

# A directive would show as text on a forge: the pages have none, and their contents are here. Page → caption → pages.
# A pattern stands for the pages that are not named before it.
CONTENTS = {
    "README": {
        "How to": [
            "Overview <docs/how-to/README>", "docs/how-to/first_steps", "docs/how-to/write_a_sequence",
            "docs/how-to/connect_a_bench", "docs/how-to/rehearse_a_bad_night", "docs/how-to/unattended",
            "docs/how-to/resume_a_run", "docs/how-to/*",
        ],
        "Explanation": ["docs/glossary", "docs/explanation/*"],
        "Equations": [
            "bench/metrology/README", "bench/methods/channel/README", "bench/methods/indexing/README",
            "bench/methods/imu/README", "bench/methods/rate_table/README", "bench/methods/tumble/README",
            "bench/methods/*/README", "simulators/README", "bench/offline/README",
        ],
        "Reference": ["docs/instruments/README", "docs/reference/README"],
        "Project": ["CHANGELOG", "CONTRIBUTING", "docs/decisions/README"],
    },
    "docs/instruments/README": {"": ["*"]},
    "docs/reference/README": {"": ["*"]},
    "docs/decisions/README": {"": ["*"]},
}  # fmt: skip


def add_contents(_app: Sphinx, page: str, source: list[str]) -> None:
    """Append its tables of contents to a page."""
    for caption, pages in CONTENTS.get(page, {}).items():
        named = f":caption: {caption}\n" if caption else ""
        source[0] += f"\n```{{toctree}}\n:hidden:\n:glob:\n{named}\n" + "\n".join(pages) + "\n```\n"


def unlink_folders(_app: Sphinx, page: nodes.document) -> None:
    """Leave of a link to a folder of the repository, which a site cannot show, its text alone."""
    folder = Path(page["source"]).parent
    for link in list(page.findall(pending_xref)):
        if (folder / link["reftarget"]).is_dir():
            link.replace_self(link.children)


def copy_first_page(app: Sphinx, problem: Exception | None) -> None:
    """Write the root page under the name that a browser looks for."""
    if problem is None:
        shutil.copy(app.outdir / f"{root_doc}.html", app.outdir / "index.html")


def setup(app: Sphinx) -> None:
    """Register what this site adds."""
    app.connect("source-read", add_contents)
    app.connect("doctree-read", unlink_folders)
    app.connect("build-finished", copy_first_page)
