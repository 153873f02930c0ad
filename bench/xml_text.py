"""Text in XML documents."""

from __future__ import annotations

import re

_NOT_ALLOWED = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")  # not even escaped


def xml_text(text: str) -> str:
    """Return a text, or a whole document, with U+FFFD for each character that XML 1.0 does not allow.

    https://www.w3.org/TR/xml/#charsets
    """
    return _NOT_ALLOWED.sub("\N{REPLACEMENT CHARACTER}", text)
