"""A page as a PDF: A4, with its number and the number of the page on each."""

from __future__ import annotations

import os
from types import ModuleType

from bench.report.optional import imported


def library() -> ModuleType:
    """Return WeasyPrint; InputError with what to install where it is missing."""
    return imported("weasyprint", "pdf", "libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0")


def pdf(page: str) -> bytes:
    """The page as it prints, tagged for screen readers; equal pages give equal bytes. InputError without WeasyPrint."""
    os.environ.setdefault("SOURCE_DATE_EPOCH", "0")  # or its embedded fonts state when they were written
    content: bytes = library().HTML(string=page).write_pdf(pdf_tags=True, pdf_identifier=b"inertial-test-bench")
    return content
