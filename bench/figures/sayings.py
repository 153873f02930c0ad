"""Translation of sentences that the program has made elsewhere: refusals, reasons, and lines of a preflight.

`translations/said_zh.json` has the sentences with their places in braces, as "run '{run}' is in progress; wait for its
end". A sentence is recognised by the text between its places, and what stands in them is translated in the same way, or
stays as it is: names, and words of instruments and other programs.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from functools import lru_cache

from markupsafe import Markup, escape

from bench.figures.languages import ENGLISH, TRANSLATIONS, catalogue_of, current, tr

PLACE = re.compile(r"\{(\w+)\}")
RUN = re.compile(r"(\d{8}T\d{6}Z\S*): (.+)", re.DOTALL)  # name of a run before a sentence about it
PROSE = re.compile(r"[A-Za-z]{2,}\W* \W*[a-z]{2,}")  # two words
DEPTH = 3  # of sentences within a sentence
LONGEST = 2000  # characters of a sentence that is looked up
BETWEEN = ("; ", ", ")  # sentences and names of a list


def said(text: str) -> Markup:
    """Return a sentence in the current language as HTML; what is not known in it is marked as English."""
    if current() == ENGLISH or not text:
        return escape(text)
    return Markup("\n").join(_whole(line, current()) for line in text.split("\n"))


def _whole(text: str, language: str) -> Markup:
    found = _translated(text, language, DEPTH)
    return _english(text) if found is None else found


@lru_cache(maxsize=2000)
def _translated(text: str, language: str, depth: int) -> Markup | None:
    """Return the translation of a sentence; None if it is not known."""
    if len(text) > LONGEST:
        return None
    if (usual := tr(text)) != text or text in catalogue_of(language):
        return escape(usual)
    if not depth:
        return None
    for pattern, target in _sayings(language):
        if (match := pattern.fullmatch(text)) is not None:
            places = match.groupdict().items()
            return Markup(target).format(**{key: _within(value, language, depth - 1) for key, value in places})  # noqa: S704  our own file
    if (about := RUN.fullmatch(text)) is not None and (what := _translated(about[2], language, depth - 1)) is not None:
        return Markup("{}{}{}").format(about[1], tr(": "), what)
    return None


def _within(text: str, language: str, depth: int) -> Markup:
    """Return what stands in a place: a sentence, or a list of them; names and numbers as they are."""
    if (found := _translated(text, language, depth)) is not None:
        return found
    for between in BETWEEN:
        parts = text.split(between)
        known = [_translated(each, language, depth) for each in parts] if len(parts) > 1 else []
        if any(each is not None for each in known):
            shown = (_english(old) if new is None else new for old, new in zip(parts, known, strict=True))
            return escape(tr(between)).join(shown)
    return _english(text)


def _english(text: str) -> Markup:
    """Return a text that is not translated, marked as English if it has words."""
    return Markup('<span lang="en">{}</span>').format(text) if PROSE.search(text) else escape(text)


@lru_cache
def _sayings(language: str) -> tuple[tuple[re.Pattern[str], str], ...]:
    """Return patterns and translations, those with the most text between their places first."""
    texts = sayings_of(language)
    ordered = sorted(texts, key=lambda text: -len(PLACE.sub("", text)))
    return tuple((_pattern(text), texts[text]) for text in ordered)


def sayings_of(language: str) -> Mapping[str, str]:
    """Return the sentences of a language by the English ones; empty for English."""
    file = TRANSLATIONS / f"said_{language}.json"
    found: Mapping[str, str] = json.loads(file.read_text(encoding="utf-8")) if language != ENGLISH else {}
    return found


def _pattern(text: str) -> re.Pattern[str]:
    parts = PLACE.split(text)
    names = (
        f"(?P<{part}>.+?)" if n % 2 else re.escape(part.replace("{{", "{").replace("}}", "}"))
        for n, part in enumerate(parts)
    )  # fmt: skip
    return re.compile("".join(names), re.DOTALL)
