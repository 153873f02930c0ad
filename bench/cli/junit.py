"""JUnit XML as read by GitLab, Jenkins and other CI servers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple
from xml.etree.ElementTree import Element, SubElement, tostring

from bench.xml_text import xml_text


class Problem(NamedTuple):
    """Reason why a case has not passed: *failure* of what was tested, or *error* of the test."""

    how: Literal["failure", "error"]
    type: str
    lines: Sequence[str]


class Case(NamedTuple):
    """One test case; `output` are lines that do not fail it."""

    group: str
    name: str
    wall_s: float
    problem: Problem | None = None
    output: Sequence[str] = ()


def junit(title: str, cases: Sequence[Case]) -> str:
    """Return a document with one suite, in ASCII, so that the encoding of a terminal does not matter."""
    counts = {
        "tests": str(len(cases)),
        "failures": str(sum(case.problem is not None and case.problem.how == "failure" for case in cases)),
        "errors": str(sum(case.problem is not None and case.problem.how == "error" for case in cases)),
        "time": f"{sum(case.wall_s for case in cases):.3f}",
    }
    root = Element("testsuites", {"name": title, **counts})
    suite = SubElement(root, "testsuite", {"name": title, **counts})
    for case in cases:
        _add(suite, case)
    document: bytes = tostring(root, encoding="us-ascii", xml_declaration=True)
    return document.decode("ascii")


def _add(suite: Element, case: Case) -> None:
    names = {"classname": xml_text(case.group), "name": xml_text(case.name), "time": f"{case.wall_s:.3f}"}
    element = SubElement(suite, "testcase", names)
    if case.problem is not None:
        first, more = case.problem.lines[0], len(case.problem.lines) - 1
        message = xml_text(f"{first} (and {more} more)" if more else first)
        reason = SubElement(element, case.problem.how, {"type": case.problem.type, "message": message})
        reason.text = xml_text("\n".join(case.problem.lines))
    if case.output:
        SubElement(element, "system-out").text = xml_text("\n".join(case.output))
