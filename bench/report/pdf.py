"""A page as a PDF: A4, with its number and the number of the page on each."""

from __future__ import annotations

import os
from types import ModuleType

from bench.report.optional import imported


def library() -> ModuleType:
    """Import WeasyPrint; InputError with advice on installation if it is missing."""
    return imported("weasyprint", "pdf", "libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0")


def pdf(page: str) -> bytes:
    """PDF of the page, tagged for screen readers; equal pages give equal bytes. InputError without WeasyPrint."""
    os.environ.setdefault("SOURCE_DATE_EPOCH", "0")  # otherwise its embedded fonts contain their time of writing
    content: bytes = library().HTML(string=page).write_pdf(pdf_tags=True, pdf_identifier=b"inertial-test-bench")
    return content
