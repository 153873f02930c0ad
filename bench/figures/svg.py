"""Figures as SVG inside a page: equal figures give equal bytes, without external references."""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import matplotlib
from markupsafe import Markup, escape
from matplotlib import font_manager
from matplotlib.figure import Figure

from bench.figures.languages import ENGLISH, current, language
from bench.xml_text import xml_text

# First letters of the files of fonts that have the characters of a language, the best first.
FONTS = {"zh": ("notosanscjk", "sourcehansans", "wqy-", "droidsansfallback", "msyh", "simhei", "simsun")}
WIDTH_IN = 7.1  # width between the margins of an A4 page, so that print has the sizes given here
LEFT_IN = 0.68

# Background of a label on lines, so that none crosses its text.
CLEAR: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.6}
STYLE: dict[Any, Any] = {
    "figure.dpi": 72,  # one dot is one point
    "svg.fonttype": "none",  # text remains text: in the font of the page, searchable, readable by a screen reader
    "svg.hashsalt": "inertial-test-bench",
    "text.parse_math": False,
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 8,
    "axes.titley": 1.0,  # the default position; None would measure all ticks, a tenth of the time of a figure
    "axes.linewidth": 0.6,
    "axes.edgecolor": "#444444",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e2e5e9",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "#d0d4d9",
    "lines.linewidth": 1.1,
}
_NO_METADATA: dict[str, Any] = dict.fromkeys(("Date", "Creator", "Format", "Type"))
_SIZE_AND_NAMESPACES = re.compile(r' (?:xmlns(?::xlink)?|width|height|version)="[^"]*"')
_FIGURE = re.compile(r'<svg role="img" aria-label="(?P<what>[^"]*)".*?</svg>', re.DOTALL)  # as `rendered` writes it
_IDS = re.compile(r'( id="| href="#|url\(#)')


@contextmanager
def drawing() -> Iterator[None]:
    """Create and render figures within the context in one style, whatever the user's own settings.

    Without a font for the characters of the language, texts within it are in English.
    """
    font = font_of(current())
    with matplotlib.rc_context(), language(current() if font else ENGLISH):
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        matplotlib.rcParams["font.family"] = [*dict.fromkeys([font or "DejaVu Sans", "DejaVu Sans"])]
        yield


@lru_cache
def font_of(name: str) -> str | None:
    """Name of an installed font that has the characters of a language; None without one."""
    if name == ENGLISH:
        return "DejaVu Sans"
    paths = sorted(map(Path, font_manager.findSystemFonts()), key=lambda path: ("egular" not in path.name, path.name))
    for family in FONTS[name]:
        for path in paths:
            if path.name.lower().startswith(family):
                font_manager.fontManager.addfont(path)
                # matplotlib logs for each lookup that the font has only one weight.
                logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)
                return chinese_face([each.name for each in font_manager.fontManager.ttflist if each.fname == str(path)])
    return None


def chinese_face(names: Sequence[str]) -> str:
    """The face of a collection of fonts that has the Chinese forms of characters (SC); the first of any other file."""
    return next((name for name in names if name.endswith(" SC")), names[0])


def new_figure(
    height_in: float, *, width_in: float = WIDTH_IN, top_in: float = 0.24, bottom_in: float = 0.42
) -> Figure:
    """An empty figure, by default of the width of the page, with room for a title above and a label below its axes."""
    figure = Figure(figsize=(width_in, height_in))
    figure.subplots_adjust(
        left=LEFT_IN / width_in, right=0.985, top=1 - top_in / height_in, bottom=bottom_in / height_in, wspace=0.2
    )
    return figure


def as_document(figure: Figure) -> str:
    """The figure as a separate document."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata=_NO_METADATA)
    return xml_text(buffer.getvalue())


def rendered(figure: Figure, name: str, description: str) -> Markup:
    """The figure as an `<svg>` element; `name` makes its ids unique in the page."""
    opening, _, content = as_document(figure).partition("<svg")[2].partition(">")
    content = _IDS.sub(rf"\g<1>{name}-", content.replace("xlink:href=", "href="))
    attributes = _SIZE_AND_NAMESPACES.sub("", opening)
    svg = f'<svg role="img" aria-label="{escape(description)}"{attributes}>{content.rstrip()}'
    return Markup(svg)  # noqa: S704  matplotlib escapes the text in a figure


def as_files(page: str) -> tuple[str, dict[str, str]]:
    """Replace the figures of a page by images, and return it with their documents by file name.

    The description of a figure becomes the alternative text of its image.
    """
    files: dict[str, str] = {}

    def image(figure: re.Match[str]) -> str:
        name = f"figure-{len(files)}.svg"
        files[name] = figure[0].replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"', 1)
        return f'<img alt="{figure["what"]}" src="{name}"/>'

    return _FIGURE.sub(image, page), files
