"""Translation of the words of a report to the language of its reader.

A text is written in English where it is used, as `tr("Dwell {number}", number=3)`, and looked up in the catalogue of
the language, `translations/zh.json` for reports and `translations/zh_….json` for pages of a station, whose keys are
those texts, and then in the catalogues of plug-ins. Texts in no catalogue are shown in English.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path

from bench.sequence.method import shipped_first
from drivers.installed import loaded

ENGLISH = "en"
LANGUAGES = (ENGLISH, "zh")
TRANSLATIONS = Path(__file__).parent / "translations"
_language: ContextVar[str] = ContextVar("language", default=ENGLISH)
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?![\w])")


@contextmanager
def language(name: str) -> Iterator[None]:
    """Translate texts within the context to the language of this name, one of `LANGUAGES`."""
    before = _language.set(name)
    try:
        yield
    finally:
        _language.reset(before)


def current() -> str:
    """Name of the current language."""
    return _language.get()


def tr(text: str, /, **values: object) -> str:
    """A text in the language of the report; `values` replace their names in braces.

    A text generated elsewhere may contain any numbers: "degree 3" is found as "degree {0}".
    """
    catalogue = catalogue_of(current())
    if values:
        return catalogue.get(text, text).format(**values)
    if text in catalogue or not catalogue:
        return catalogue.get(text, text)
    numbers = _NUMBER.findall(text)
    count = iter(range(len(numbers)))
    pattern = _NUMBER.sub(lambda _: f"{{{next(count)}}}", text)
    return catalogue[pattern].format(*numbers) if numbers and pattern in catalogue else catalogue.get(text, text)


@lru_cache
def catalogue_of(name: str) -> Mapping[str, str]:
    """Translations of a language by the English texts; empty for English."""
    if name == ENGLISH:
        return {}
    found: dict[str, str] = {}
    for part in sorted(TRANSLATIONS.glob(f"{name}*.json")):
        found |= json.loads(part.read_text(encoding="utf-8"))
    for target in {method.translations: None for method in shipped_first() if method.translations}:
        found = {**loaded(target).get(name, {}), **found}
    return found
