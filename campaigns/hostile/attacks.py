"""Hostile features of YAML itself: depth, size, aliases, tags, escapes, encodings."""

from __future__ import annotations

import random
import re

from campaigns.hostile import corpus
from campaigns.hostile.corpus import size

_PLACE = re.compile(r"(?<=: )[^\s#\[{][^#\n]*")


def depth(rng: random.Random) -> str:
    """Lists and mappings in one another, closed or left open."""
    opening, closing = rng.choice((
        ("[", "]"), ("{", "}"), ("{a: ", "}"), ("[a, ", "]"), ("[[], ", "]"), ("{[", "]: 1}"), ("[{a: [", "]}]"),
        ("- ", ""), ("? ", ""), ("- - ", ""), ("- a: ", ""), ("-\n", ""), ("[\n", "]\n"), ("[" + " " * 120, "]"),
        ("{? ", "}"), ("!a [", "]"), ("&a [", "]"), ("[# x\n", "]"), ("'a': {", "}"),
    ))  # fmt: skip
    levels = size(rng) // len(opening + closing)
    if rng.random() < 0.3:
        return "\n".join(" " * level + rng.choice(("a:", "-", "? a", "- a:")) for level in range(min(levels, 700)))
    return opening * levels + "1" + closing * rng.choice((0, levels))


def long(rng: random.Random) -> str:
    """One scalar, key, comment or gap of any length."""
    part = rng.choice((
        "a", "a b ", "a\n", "a\n\n", "\n", " ", "  \n", "\t", "#", "# x\n", "0", "9", "°", "\U0001f4a9", "a: ", "''",
        "-", ".", "\\x41", "\\u00b0", "\\U0001f4a9", "\\\n", "\\", "%20", "ab-cd_", "x,", ":", "&a ", "!a", "--- ",
        "\n#\n",
    ))  # fmt: skip
    frame = rng.choice((
        "{}", "a: {}", "'{}'", '"{}"', "a: |\n  {}", "a: >-\n  {}", "|9\n{}", "a: '{}'", 'a: "{}"', "{}: 1", "'{}': 1",
        '? {}\n: 1', "!{} a", "!<{}> a", "!!{} a", "&{} a", "*{}", "%{}", "%TAG ! {}\n---\na", "%YAML {}\n---\na",
        "[{}]", "{{{}}}", "a: 1\n{}", "title: {}", "- {}\n", "#{}",
    ))  # fmt: skip
    run = part * (size(rng) // len(part.encode()))
    return frame.format(run.replace("\n", "\n  ") if "|" in frame or ">" in frame else run)


def many(rng: random.Random) -> str:
    """As many values, keys, lines, documents or mistakes as there is room for."""
    unit = rng.choice((
        "- 1\n", "-\n", "a{}: 1\n", "? a{}\n: 1\n", "- {{}}\n", "- []\n", "- a: 1\n  b: 2\n", "- 'x'\n", '- "\\x41"\n',
        "- |\n x\n", "- {{wait: 1 s}}\n", "---\n", "...\n", "---\na: 1\n", "- &a{} 1\n", "- *a\n", "- !!str a\n",
        "%A b\n", "a: 1\n", "'a{}':\n", "- ${{x}}\n", "- 1 °C\n", "- - - 1\n", "- a b\n  c\n", "{}:\n- 1\n",
        "a{}: {{b: {{c: []}}}}\n",
    ))  # fmt: skip
    text = "".join(unit.format(index) for index in range(size(rng) // (len(unit) + 2)))
    if rng.random() < 0.4:
        return rng.choice(("steps:\n", "needs:\n", "devices:\n", "results:\n", "parameters:\n")) + _inside(text)
    if rng.random() < 0.4:
        item = rng.choice(("1,", ",", "a,", "[],", "{},", "'',", "a: 1,", "? a,", "'a':1,", "{a: b},", "[[1]],"))
        return rng.choice(("[", "{", "steps: [", "needs: {")) + item * (size(rng) // len(item)) + rng.choice("]} ")
    return text


def _inside(text: str) -> str:
    return "".join(f"  {line}\n" for line in text.splitlines())


def aliases(rng: random.Random) -> str:
    """Anchors, aliases, merge keys: bombs, circles, and single ones in good documents."""
    if rng.random() < 0.3:
        width = rng.choice((2, 9, 100))
        bomb = [f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * width)}]" for level in range(1, 30)]
        return "\n".join(["a0: &a0 lol", *bomb])
    return placed(rng, rng.choice((
        "&a [*a]", "&a {b: *a}", "*nothing", "&a", "& a", "*", "&a &b c", "&\x00 x", "&a*a x", "{<<: {a: 1}}",
        "{<<: *a}", "\n  <<: [{a: 1}, {b: 2}]", "&° x", "&[a] x", "*a : 1", "&é 5 °C",
    )))  # fmt: skip


def tags(rng: random.Random) -> str:
    """Tags, of Python too, and what directives do to them."""
    tag = rng.choice((
        "!!python/object/apply:os.system [reboot]", "!!python/name:os.system", "!!python/tuple [1]", "!!binary aGk=",
        "!!set {a, b}", "!!omap [a: 1]", "!!timestamp 2026-01-01", "!!float 5", "!!int '5'", "!!str", "!", "!!",
        "!a!b c", "!<tag:yaml.org,2002:int> 5", "!<", "!<>", "!%C3%28 a", "!%zz a", "!é a", "!! !! a", "!a &b c",
        "!!null", "!<!> a",
    ))  # fmt: skip
    head = rng.choice(
        ("", "", "%TAG ! tag:x,2000:\n---\n", "%TAG !a! !b\n---\n", "%YAML 1.1\n---\n", "%YAML 9.9\n---\n")
    )
    return head + placed(rng, tag)


def escapes(rng: random.Random) -> str:
    """Backslashes in quotes, finished or not."""
    escape = rng.choice((
        "\\x", "\\x4", "\\xzz", "\\x00", "\\x1b[31m", "\\u", "\\ud800", "\\ud83d\\ude00", "\\udc00", "\\U00110000",
        "\\UFFFFFFFF", "\\U0000000", "\\N", "\\_", "\\L", "\\P", "\\e", "\\a", "\\0", "\\ ", "\\\t", "\\\n   ", "\\q",
        "\\", "\\/", "\\u202e", "\\ufeff", "\\uffff", "\\x85", "\\u-123", "\\x+1", "\\u００４１", "\\U0010FFFF",
    ))  # fmt: skip
    before, after, end = rng.choice(("", "a", "20 °C")), rng.choice(("", "b", escape)), rng.choice(('"', '"', ""))
    return placed(rng, f'"{before}{escape}{after}{end}')


def strange_scalars(rng: random.Random) -> str:
    """Nasty numbers, texts and characters where good ones stood."""
    return placed(rng, rng.choice((corpus.number, corpus.scalar))(rng))


def encodings(rng: random.Random) -> bytes:
    """Other encodings than UTF-8, other line ends, marks and bytes that do not belong."""
    text = corpus.document(rng)
    data = text.encode(
        rng.choice(("utf-8", "utf-8", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-7", "utf-8-sig"))
    )
    intruder = rng.choice((
        b"\x00", b"\xff\xfe", b"\xfe\xff", b"\xef\xbb\xbf", b"\xc0\xaf", b"\xe0\x80\xaf", b"\xed\xa0\x80",
        b"\xf5\x80\x80\x80", b"\xf4\x90\x80\x80", b"\xc3", b"\x80", b"\x1a", b"\xf8\x88\x80\x80\x80", b"\xef\xbf\xbe",
        b"\xc2\x85", b"\x0c",
    ))  # fmt: skip
    match rng.randrange(5):
        case 0:
            return data
        case 1:
            return intruder * rng.choice((1, 1, 2, 1000)) + data
        case 2:
            at = rng.randrange(len(data))
            return data[:at] + intruder + data[at:]
        case 3:
            return data.replace(
                b"\n", rng.choice((b"\r", b"\r\n", b"\r\r\n", b"\n\r", b"\xc2\x85", b"\xe2\x80\xa8", b"\x0b"))
            )
        case _:
            return rng.randbytes(size(rng, 4096))


def soup(rng: random.Random) -> str:
    """Pieces of YAML in any order."""
    pieces = (
        *corpus.INDICATORS, *corpus.STRANGE, ": ", "- ", "? ", "\n  ", "\n    ", "---\n", "...\n", "a", "b: ", "|\n",
        ">-\n", "|2+", "'", '"', "\\", "${", "}", " #", "<<: ", "5", "%YAML 1.2\n", "!!str ", "&a ", "*a ",
        "steps:\n  - ",
    )  # fmt: skip
    return "".join(rng.choices(pieces, k=size(rng, 400)))


def placed(rng: random.Random, scalar: str) -> str:
    """A document in which something else stands in the place of one value; sometimes it stands alone."""
    text = corpus.document(rng)
    places = list(_PLACE.finditer(text))
    if not places or rng.random() < 0.1:
        return scalar
    place = rng.choice(places)
    return text[: place.start()] + scalar + text[place.end() :]
