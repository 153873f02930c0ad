"""Material of hostile documents: all documents of the project, their words and values, and hostile scalars."""

from __future__ import annotations

import contextlib
import random
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from bench.config.document import SIZE_LIMIT_BYTES, parse_document
from bench.config.models import BenchFile
from bench.errors import InputError
from bench.sequence.document.model import SequenceFile
from bench.sequence.steps.verbs import BLOCKS
from drivers.schema.fields import keys_of

Generator = Callable[[random.Random], str | bytes]

ROOT = Path(__file__).parents[2]
PATHS = [
    path
    for folder in ("sequences", "config", "config/uut", "tests/broken", "tests/broken/good")
    for path in sorted((ROOT / folder).glob("*.yaml"))
]
TEXTS = {path: path.read_text("utf-8") for path in PATHS}
SHIPPED = [path for path in PATHS if not {"tests", "campaigns"} & set(path.relative_to(ROOT).parts)]

NUMBERS = (
    "0", "-0", "-1", "1", "0.0", "1e999", "-1e999", "1e-999", "1e308", "1e-308", "1e309", "1e-999999999", "9" * 18,
    "9" * 19, "9" * 20, "9" * 400, "0." + "1" * 400, "0x10", "0o17", "0b1", "010", "+5", "1_000", "1:30:00", ".5", "5.",
    ".inf", "-.Inf", ".nan", "NaN", "1e", "١٢", "５", "½", "²", "Ⅷ", "௧", "1,5", "−5",
)  # fmt: skip
UNITS = ("", " °C", "°", " s", " min", " V", " mA", " °C/min", " K", " µg/Hz^0.5", " m/s²", " /s", "^9" * 20, "(" * 80)
TEXT = (
    "''", '""', "~", "null", "true", "false", "on", "off", "yes", "No", "2026-02-30", "0000-00-00", "9999-12-31", "<<",
    "=", "[]", "{}", "[[]]", "{a: }", "${x}", "${", "${}", "__class__", "../../etc/passwd", "/dev/zero", "nul", "aux",
    "sim+tcp://127.0.0.1:0", "tcp://[::1]:99999", "serial:///dev/null?baud=0", "%s%n", "{0.__class__}", "$(reboot)",
)  # fmt: skip
STRANGE = (  # characters: unseen, wide, combining, right to left, beyond the first plane, halves, line ends, controls
    "\x00", "\x01", "\x07", "\x08", "\x0b", "\x0c", "\x1b", "\x7f", "\x80", "\x85", "\xa0", "\xad", "\u0301", "\u0430",
    "\u05d0", "\u0627", "\u061c", "\u1680", "\u180e", "\u2003", "\u200b", "\u200d", "\u2028", "\u2029", "\u202e",
    "\u2060", "\u2066", "\u2212", "\u2460", "\u3000", "\ud800", "\udfff", "\ue000", "\ufdd0", "\ufdfa", "\ufe0f",
    "\ufeff", "\uff1a", "\uff5b", "\ufffd", "\uffff", "\U0001d7d8", "\U0001f4a9", "\U000e0041", "\U0010ffff", "º", "μ",
    "ß", "İ", "ǆ", "\r", "\t",
)  # fmt: skip
INDICATORS = "-?:,[]{}#&*!|>'\"%@`~<=\\ \n"


def _parsed() -> Iterator[Any]:
    for path, text in TEXTS.items():
        with contextlib.suppress(InputError):  # broken on purpose
            yield parse_document(text, path).value


VALUES = list(_parsed())  # of every document that is YAML


def _by_key() -> dict[str, list[Any]]:
    """Values of each key, anywhere; and of `verb.key`, those in mappings that begin with that verb."""
    found: dict[str, list[Any]] = defaultdict(list)
    open_values: list[Any] = list(VALUES)
    while open_values:
        part = open_values.pop()
        if isinstance(part, dict):
            for key, inside in part.items():
                found[key].append(inside)
                found[f"{next(iter(part))}.{key}"].append(inside)
        open_values += part.values() if isinstance(part, dict) else part if isinstance(part, list) else ()
    return dict(found)


BY_KEY = _by_key()
_ALL = sorted(BY_KEY)
_MODELS = (*BLOCKS.values(), SequenceFile, BenchFile)
KEYS = sorted({key for key in BY_KEY if "." not in key} | {key for model in _MODELS for key in keys_of(model)})
SCALARS = sorted(set(re.findall(r"(?<=: )[^\s#\[{][^#\n]*", "\n".join(TEXTS.values()))))


def document(rng: random.Random) -> str:
    """A document of the project; those that are shipped more often."""
    return TEXTS[rng.choice(SHIPPED if rng.random() < 0.3 else PATHS)]


def number(rng: random.Random) -> str:
    """A number, perhaps with a unit, as somebody might write it to see what happens."""
    return rng.choice(NUMBERS) + rng.choice(UNITS)


def scalar(rng: random.Random) -> str:
    """A scalar as it would stand in a document: a good one, or a nasty one."""
    kind = rng.random()
    if kind < 0.4:
        return rng.choice(SCALARS)
    if kind < 0.6:
        return number(rng)
    if kind < 0.8:
        return rng.choice(TEXT)
    return rng.choice(SCALARS) + rng.choice(STRANGE) + rng.choice(SCALARS)


def value(rng: random.Random, key: str) -> Any:
    """A value for a key, or for `verb.key`: mostly one that stands under it somewhere, else anything."""
    if rng.random() < 0.7 and key in BY_KEY:
        return rng.choice(BY_KEY[key])
    if rng.random() < 0.2:
        return rng.choice(BY_KEY[rng.choice(_ALL)])
    return rng.choice([scalar(rng), rng.randint(-2, 10), rng.random(), True, False, None, [], {}, [[]], ""])


def size(rng: random.Random, most: int = SIZE_LIMIT_BYTES) -> int:
    """A size of any magnitude; one in five as large as a document may be."""
    return most if rng.random() < 0.2 else int(most ** rng.uniform(0.2, 1))
