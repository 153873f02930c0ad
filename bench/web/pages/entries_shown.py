"""Entries of a journal as the page of a run shows them."""

from __future__ import annotations

import re

from markupsafe import Markup, escape

from bench.figures.languages import tr
from bench.figures.sayings import said
from bench.web.news import SENTENCES
from bench.web.pages.results_shown import state_in_words

FACTS = re.compile(r"; (?=\w+: )")  # between the facts of an entry in one text
TEXTS = re.compile(r'"((?:[^"\\]|\\.)*)"')  # in JSON
STATES = frozenset({"how", "state", "action", "wish", "command", "title", "what"})  # values that `tr` knows


def kind_in_words(kind: str) -> str:
    """Return the kind of an entry in words; the release of a hold is no release of a file."""
    return tr("hold released" if kind == "released" else kind.replace("_", " "))


def facts_in_words(text: str) -> Markup:
    """Return the facts of an entry, as "text: …; by: …", with its sentences and states in the current language."""
    facts = [fact.partition(": ") for fact in FACTS.split(text)]
    return escape(tr("; ")).join(escape(tr(key + colon)) + _value(key, value) for key, colon, value in facts)


def _value(key: str, value: str) -> Markup:
    if value.startswith(("{", "[")):  # JSON, which may be cut
        parts = enumerate(TEXTS.split(value))
        return Markup("").join(Markup('"{}"').format(said(each)) if n % 2 else escape(each) for n, each in parts)
    return said(value) if key in SENTENCES else escape(state_in_words(value) if key in STATES else value)
