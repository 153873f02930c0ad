"""Structure of JUnit reports as in junit-10.xsd of the xUnit plug-in of Jenkins, the strictest schema in use.

GitLab reads name, classname, time, failure or error, and system-out of each case, and ignores a second case of a name.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

SECONDS = re.compile(r"(([0-9]{0,3},)*[0-9]{3}|[0-9]{0,3})*(\.[0-9]*)?")


class Allowed(NamedTuple):
    """Children and attributes of an element, and whether it has text."""

    children: set[str]
    required: set[str]
    optional: set[str]
    has_text: bool = False


_PROBLEM = Allowed(set(), set(), {"type", "message"}, has_text=True)
_TEXT = Allowed(set(), set(), set(), has_text=True)
SCHEMA = {
    "testsuites": Allowed({"testsuite"}, set(), {"name", "time", "tests", "failures", "errors"}),
    "testsuite": Allowed(
        {"testsuite", "properties", "testcase", "system-out", "system-err"},
        {"name", "tests", "failures", "errors"},
        {"group", "time", "skipped", "timestamp", "hostname", "id", "package", "file", "log", "url"},
    ),
    "testcase": Allowed(
        {"skipped", "error", "failure", "system-out", "system-err"}, {"name"}, {"time", "classname", "group"}
    ),
    "failure": _PROBLEM, "error": _PROBLEM, "skipped": _PROBLEM, "system-out": _TEXT, "system-err": _TEXT,
}  # fmt: skip


def parsed(text: str) -> Element:
    """The root of a report that is valid."""
    root = ElementTree.fromstring(text.encode("ascii"))
    assert list(problems(root)) == []
    return root


def cases(text: str) -> dict[str, Element]:
    """The cases of a valid report by name."""
    return {each.attrib["name"]: each for each in parsed(text).iter("testcase")}


def problems(root: Element) -> Iterator[str]:
    """What the schema forbids in a report, and wrong counts."""
    if root.tag not in ("testsuites", "testsuite"):
        yield f"the root is {root.tag}"
    for element in root.iter():
        yield from _problems_of(element)
    for suite in root.iter("testsuite"):
        found = {"tests": list(suite.iter("testcase")), "failures": list(suite.iter("failure"))}
        found["errors"] = list(suite.iter("error"))
        yield from (f"{name} are {len(each)}" for name, each in found.items() if suite.get(name) != str(len(each)))
    names = Counter((case.get("classname"), case.get("name")) for case in root.iter("testcase"))
    yield from (f"{name} occurs {count} times" for name, count in names.items() if count > 1)


def _problems_of(element: Element) -> Iterator[str]:
    allowed = SCHEMA.get(element.tag)
    if allowed is None:
        yield f"there is no element {element.tag}"
        return
    given = set(element.attrib)
    yield from (f"{element.tag} lacks {name}" for name in allowed.required - given)
    yield from (f"{element.tag} has no {name}" for name in given - allowed.required - allowed.optional)
    yield from (f"{element.tag} contains {child.tag}" for child in element if child.tag not in allowed.children)
    if not allowed.has_text and any((text or "").strip() for text in (element.text, *(each.tail for each in element))):
        yield f"{element.tag} contains text"
    if not SECONDS.fullmatch(element.get("time", "0")):
        yield f"the time of {element.tag} is {element.get('time')}"
