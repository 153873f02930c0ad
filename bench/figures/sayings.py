"""Translation of sentences that the program has made elsewhere: refusals, reasons, problems, and lines of a preflight.

`translations/said_zh.json` has the sentences with their places in braces, as "run '{run}' is in progress; wait for its
end". A sentence is recognised by the text between its places, and the text in a place is translated in the same way.
Not translated are words of instruments and other programs, and names: text in quotes, in a place "{name}", and in a
place "{name_…}", which holds a name without spaces or a list of such names. A place "{tail…}" may be empty. Several
sentences, a list of sentences, and a sentence after its subject are translated part by part.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import NamedTuple

from markupsafe import Markup, escape

from bench.figures.languages import ENGLISH, TRANSLATIONS, catalogue_of, current, tr

PLACE = re.compile(r"\{(\w+)\}")
QUOTED = re.compile(r"(?<=')\{(\w+)\}(?=')")
# What a sentence is about before it: file and line, a run, a device, a key of a file.
ABOUT = re.compile(r"(?P<what>\S.*?:\d+(?::\d+)?|[^\s:]+|\d[^:]*|'.*?'|\".*?\"): (?P<text>.+)", re.DOTALL)
# A name, and what is said of it.
SUBJECT = re.compile(
    r"(?P<what>(?!(?:it|that|none|nothing)\b)[a-z\d.][\w.]*|'.*?') (?P<text>(?:is|has|was|needs|names) .+)", re.DOTALL
)
# Of a check: severity, sentence, and rule.
FOUND = re.compile(r"(?:(?P<severity>warning): )?(?P<text>.+?)(?P<rule> \[[a-z]+(?:-[a-z]+)*\])?", re.DOTALL)
NAME = r"(?:'[^']*'|\"[^\"]*\"|[^\s,;]+(?: \([A-Z]+\))?)"
IN_QUOTES = re.compile(r"'[^']*'|\"[^\"]*\"")  # names, and answers of instruments
NAMES = re.compile(r", | or | and ")  # between names of a list
PROSE = re.compile(r"[A-Za-z]{2,}[^\w,]* [^\w,]*[a-z]{2,}")  # two words
LEFT = 'lang="en"'  # of what is not translated
MARKED = re.compile(f"<span {LEFT}>(.*?)</span>", re.DOTALL)
DEPTH = 12  # of sentences within a sentence
LONGEST = 1000  # characters of a sentence that is looked up
SHORT, SHORT_AT_BEGIN = 8, 4  # characters of a sentence that says nothing if a place of it is not known
WIDE = "[\u3000-\u9fff]"  # Chinese characters, between which there are no spaces
SENTENCES = re.compile(r"(?<=[^.]\.) (?=\S)")  # the space between two of them


class _Saying(NamedTuple):
    """Sentence of the program: pattern, its longest text without a place, places in quotes, and translation.

    `is_short` if it may be found within any text.
    """

    pattern: re.Pattern[str]
    longest: str
    quoted: frozenset[str]
    is_short: bool
    target: str


def said(text: str) -> Markup:
    """Return a sentence in the current language as HTML; what is not known in it is marked as English."""
    if current() == ENGLISH or not text:
        return escape(text)
    return Markup("\n").join(_within(line, current(), DEPTH) for line in text.split("\n"))


def plain(text: str) -> str:
    """Return a sentence in the current language without markup, for a place in another text."""
    return text if current() == ENGLISH else said(text).striptags()


def _within(text: str, language: str, depth: int) -> Markup:
    """Return a sentence, or what stands in a place: names and numbers as they are."""
    found = _translated(text, language, depth)
    return _english(text) if found is None else found


@lru_cache(maxsize=5000)
def _translated(text: str, language: str, depth: int) -> Markup | None:
    """Return the first translation that leaves nothing in English, else the one that leaves least; None for none."""
    if len(text) > LONGEST or not depth:
        return None
    best, least = None, 0
    for found in _translations(text, language, depth - 1):
        if LEFT not in found:
            return found
        left = sum(map(len, MARKED.findall(found)))
        if best is None or left < least:
            best, least = found, left
    return best


def _translations(text: str, language: str, depth: int) -> Iterator[Markup]:
    """Yield the translations of a text as a whole, and of its parts."""
    if (usual := tr(text)) != text or text in catalogue_of(language):
        yield escape(usual)
        return
    found = FOUND.fullmatch(text)
    if found is not None and (found["severity"] or found["rule"]):
        severity = _within(found["severity"], language, depth) + tr(": ") if found["severity"] else Markup("")
        yield severity + _within(found["text"], language, depth) + (found["rule"] or "")
        return
    # Parts that are all known come first: a place before them could hold the rest of the text as well.
    parts = list(_parts(text, language, depth))
    yield from (found for found, are_known in parts if are_known)
    yield from _after(ABOUT, tr(": "), text, language, depth)
    for saying in _sayings(language):
        if saying.longest in text and (match := saying.pattern.fullmatch(text)) is not None:
            places = {key: _placed(key, value, saying, language, depth) for key, value in match.groupdict().items()}
            said_so = _filled(saying.target, places)
            if LEFT not in said_so or not saying.is_short:
                yield said_so
    yield from _after(SUBJECT, " ", text, language, depth)
    yield from (found for found, _ in parts)
    for between in (", ", " and "):  # these are within sentences as well
        yield from (found for found, _ in _joined(text, between, language, depth) if LEFT not in found)


def _after(form: re.Pattern[str], joined: str, text: str, language: str, depth: int) -> Iterator[Markup]:
    """Yield what follows the words that a sentence is about, if it is known; names among these words stay."""
    match = form.fullmatch(text)
    if match is not None and (said_so := _translated(match["text"], language, depth)) is not None:
        what = match["what"]
        is_text = PROSE.search(what) and ":" not in what
        yield (_within(what, language, depth) if is_text else escape(what)) + joined + said_so


def _parts(text: str, language: str, depth: int) -> Iterator[tuple[Markup, bool]]:
    """Yield the translation of several sentences or of one with a full stop, and of a list; true if all are known."""
    sentences = SENTENCES.split(text)
    known = [_ended(each, language, depth) for each in sentences] if len(sentences) > 1 or text.endswith(".") else []
    if any(each is not None for each in known):
        shown = [_english(old) + " " if new is None else new for old, new in zip(sentences, known, strict=True)]
        yield Markup("").join(shown).rstrip(), not any(LEFT in each for each in shown)
    yield from _joined(text, "; ", language, depth)


def _joined(text: str, between: str, language: str, depth: int) -> Iterator[tuple[Markup, bool]]:
    """Yield the translation of a list of sentences or names, if any is known; true if all are."""
    parts = text.split(between)
    known = [_translated(each, language, depth) for each in parts] if len(parts) > 1 else []
    if any(each is not None for each in known):
        shown = [_english(old) if new is None else new for old, new in zip(parts, known, strict=True)]
        are_known = None not in known and not any(LEFT in each for each in shown)
        yield escape(tr(between)).join(shown), are_known


def _ended(text: str, language: str, depth: int) -> Markup | None:
    """Return the translation of one sentence of several, with its full stop; None if it is not known."""
    if text.endswith(".") and (found := _translated(text.removesuffix("."), language, depth)) and LEFT not in found:
        return found + tr(".")
    return _translated(text, language, depth)


def _filled(target: str, places: Mapping[str, Markup]) -> Markup:
    """Return a translation with what stands in its places."""
    for name, found in places.items():
        if re.match(WIDE, found):
            target = re.sub(f"(?<={WIDE}) {{{name}}}", f"{{{name}}}", target)
        if re.match(WIDE, found[-1:]):
            target = re.sub(f"{{{name}}} (?={WIDE})", f"{{{name}}}", target)
    return Markup(target).format(**places)  # noqa: S704  our own file


def _placed(place: str, text: str, saying: _Saying, language: str, depth: int) -> Markup:
    """Return what stands in a place of a sentence."""
    if place in saying.quoted:
        return escape(text)
    if place.startswith("name_"):
        return escape(tr(" and ")).join(NAMES.split(text))
    return _english(text) if place == "name" else _within(text, language, depth)


def _english(text: str) -> Markup:
    """Return a text that is not translated, marked as English if it has words outside of quotes."""
    is_prose = PROSE.search(IN_QUOTES.sub("''", text))
    return Markup('<span lang="en">{}</span>').format(text) if is_prose else escape(text)


@lru_cache
def _sayings(language: str) -> tuple[_Saying, ...]:
    """Return the sentences of a language, those with the most text between their places first."""
    texts = sayings_of(language)
    ordered = sorted(texts, key=lambda text: (-len(PLACE.sub("", text)), "{name_" not in text))
    return tuple(_saying(text, texts[text]) for text in ordered)


def sayings_of(language: str) -> Mapping[str, str]:
    """Return the sentences of a language by the English ones; empty for English."""
    file = TRANSLATIONS / f"said_{language}.json"
    found: Mapping[str, str] = json.loads(file.read_text(encoding="utf-8")) if language != ENGLISH else {}
    return found


def _saying(text: str, target: str) -> _Saying:
    parts = [part if n % 2 else part.replace("{{", "{").replace("}}", "}") for n, part in enumerate(PLACE.split(text))]
    form = "".join(_place(part, parts[n - 1]) if n % 2 else re.escape(part) for n, part in enumerate(parts))
    is_short = len("".join(parts[::2]).strip()) < (SHORT_AT_BEGIN if parts[0] else SHORT)
    quoted = frozenset(QUOTED.findall(text))
    return _Saying(re.compile(form, re.DOTALL), max(parts[::2], key=len), quoted, is_short, target)


def _place(name: str, before: str) -> str:
    """Return the pattern of a place after a text; a tail directly behind another place is a further sentence."""
    if name.startswith("tail"):
        return f"(?P<{name}>.*?)" if before else f"(?P<{name}>(?:; .*?)?)"
    return f"(?P<{name}>{NAME}(?:(?:{NAMES.pattern}){NAME})*)" if name.startswith("name_") else f"(?P<{name}>.+?)"
