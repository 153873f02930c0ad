"""Documents of the project with something changed: a few lines, a few characters or bytes, or a part of their value."""

from __future__ import annotations

import copy
import json
import random
import re
from collections.abc import Callable, Iterator
from typing import Any

from campaigns.hostile import corpus

Lines = list[str]
_VALUE = re.compile(r"(: +)([^\s#][^#]*)")
_KEY = re.compile(r"[\w/]+(?=:)")


def by_lines(rng: random.Random) -> str:
    """Lines swapped, deleted, doubled, moved, taken from elsewhere, indented otherwise, or given other keys, values."""
    lines = corpus.document(rng).split("\n")
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        rng.choice(_LINE_CHANGES)(rng, lines)
        lines = lines or [""]
    return "\n".join(lines)


def by_characters(rng: random.Random) -> str:
    """Characters lost, doubled, exchanged, or strange ones among them."""
    text = list(corpus.document(rng))
    for _ in range(rng.choice((1, 1, 2, 4, 20))):
        at, new = rng.randrange(len(text)), rng.choice((*corpus.INDICATORS, *corpus.STRANGE, *"0aZ.$"))
        text[at : at + rng.choice((0, 1, 1, 2))] = rng.choice(([], [new], [new, new], [text[at], text[at]]))
        text = text or [new]
    return "".join(text)


def by_bytes(rng: random.Random) -> bytes:
    """Bits turned and bytes lost, as by a bad disk; or a file that ends too early."""
    data = bytearray(corpus.document(rng).encode())
    for _ in range(rng.choice((1, 2, 5))):
        at = rng.randrange(len(data))
        match rng.randrange(4):
            case 0:
                data[at] ^= 1 << rng.randrange(8)
            case 1:
                data[at : at + 1] = rng.randbytes(rng.randrange(4)) or b"#"
            case 2:
                data = data[: at + 1]
            case _:
                data[at : at + 16] = bytes(16)
    return bytes(data)


def by_parts(rng: random.Random) -> str:
    """Parts of a document's value exchanged, lost, doubled or wrapped, and written as JSON, which is YAML too."""
    tree = copy.deepcopy(rng.choice(corpus.VALUES))
    for _ in range(rng.choice((1, 1, 2, 4, 8))):
        places = list(_places(tree))
        if not places:
            break
        inside, key = rng.choice(places)
        rng.choice(_PART_CHANGES)(rng, inside, key)
    return json.dumps(tree, ensure_ascii=False)


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every part of a value, as what it is in and its key or number there."""
    for key, part in list(tree.items()) if isinstance(tree, dict) else list(enumerate(tree)):
        yield tree, key
        if isinstance(part, (dict, list)):
            yield from _places(part)


def _exchanged(rng: random.Random, inside: Any, key: Any) -> None:
    inside[key] = copy.deepcopy(corpus.value(rng, str(key)))


def _lost(rng: random.Random, inside: Any, key: Any) -> None:
    del inside[key]


def _doubled(rng: random.Random, inside: Any, key: Any) -> None:
    if isinstance(inside, list):
        inside[key:key] = copy.deepcopy([inside[key]] * rng.choice((1, 2, 30)))
    else:
        inside[rng.choice(corpus.KEYS)] = copy.deepcopy(inside[key])


def _wrapped(rng: random.Random, inside: Any, key: Any) -> None:
    inside[key] = [inside[key]] if rng.random() < 0.5 else {rng.choice(corpus.KEYS): inside[key]}


def _renamed(rng: random.Random, inside: Any, key: Any) -> None:
    part = inside[key]
    del inside[key]
    if isinstance(inside, dict):
        inside[rng.choice((*corpus.KEYS, key[:-1], key + "s", ""))] = part


_PART_CHANGES: list[Callable[[random.Random, Any, Any], None]] = [
    _exchanged, _exchanged, _exchanged, _lost, _doubled, _wrapped, _renamed,
]  # fmt: skip


def _swap(rng: random.Random, lines: Lines) -> None:
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[one], lines[other] = lines[other], lines[one]


def _delete(rng: random.Random, lines: Lines) -> None:
    begin, end = _some(rng, lines)
    del lines[begin:end]


def _double(rng: random.Random, lines: Lines) -> None:
    begin, end = _some(rng, lines)
    lines[end:end] = lines[begin:end] * rng.choice((1, 1, 2, 50))


def _move(rng: random.Random, lines: Lines) -> None:
    begin, end = _some(rng, lines)
    moved, lines[begin:end] = lines[begin:end], []
    at = rng.randint(0, len(lines))
    lines[at:at] = moved


def _splice(rng: random.Random, lines: Lines) -> None:
    other = corpus.document(rng).split("\n")
    begin, end = _some(rng, other)
    at = rng.randint(0, len(lines))
    lines[at:at] = other[begin:end]


def _indent(rng: random.Random, lines: Lines) -> None:
    begin, end = _some(rng, lines)
    by = rng.choice((-4, -2, -1, 1, 2, 3, 40))
    for number in range(begin, end):
        lines[number] = " " * by + lines[number] if by > 0 else lines[number][-by:]


def _retype(rng: random.Random, lines: Lines) -> None:
    at = rng.randrange(len(lines))
    lines[at] = _VALUE.sub(lambda found: found[1] + corpus.scalar(rng), lines[at])


def _rename(rng: random.Random, lines: Lines) -> None:
    at = rng.randrange(len(lines))
    lines[at] = _KEY.sub(lambda found: rng.choice(corpus.KEYS), lines[at])


def _join(rng: random.Random, lines: Lines) -> None:
    at = rng.randrange(len(lines))
    lines[at : at + 2] = ["".join(lines[at : at + 2])]


def _some(rng: random.Random, lines: Lines) -> tuple[int, int]:
    """A few lines that follow each other."""
    begin = rng.randrange(len(lines))
    return begin, min(begin + rng.choice((1, 1, 1, 3, 10)), len(lines))


_LINE_CHANGES: list[Callable[[random.Random, Lines], None]] = [
    _swap, _delete, _double, _move, _splice, _indent, _retype, _retype, _retype, _rename, _join,
]  # fmt: skip
