"""Text in XML documents."""

from __future__ import annotations

import re

_NOT_ALLOWED = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # not even escaped


def xml_text(text: str) -> str:
    """Return a text, or a whole document, with U+FFFD for each character that XML 1.0 does not allow.

    https://www.w3.org/TR/xml/#charsets
    """
    return _NOT_ALLOWED.sub("\N{REPLACEMENT CHARACTER}", text)
