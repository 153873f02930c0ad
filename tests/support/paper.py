"""Small pages that can be set on paper."""

from __future__ import annotations

from bench.report.paper import pdf


def page_of(body: str, lang: str = "en") -> str:
    """Return a page with the texts in the margins of a report, and nothing else but a body."""
    texts = "".join(f'<span class="{name}">{name}</span>' for name in ("title", "number", "bench"))
    running = f'<div class="running">{texts}<span class="page">{{page}} of {{pages}}</span></div>'
    return f'<!doctype html>\n<html lang="{lang}"><head><title>A page</title></head><body>{running}{body}</body></html>'


def pdf_of(body: str) -> bytes:
    """Return the PDF of a page with a body."""
    return pdf(page_of(body))
