"""A page as a PDF: A4, with its number and the number of the page on each."""

from __future__ import annotations

from bench.report.extras import imported


def pdf(page: str) -> bytes:
    """The page as it prints, tagged for screen readers; equal pages give equal bytes. InputError without WeasyPrint."""
    weasyprint = imported("weasyprint", "pdf")
    content: bytes = weasyprint.HTML(string=page).write_pdf(pdf_tags=True, pdf_identifier=b"inertial-test-bench")
    return content
