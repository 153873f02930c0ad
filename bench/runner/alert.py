"""Alerts to a person who is not there, by the program that a bench file names."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Sequence

LIMIT_S = 30.0


def alert(program: Sequence[str], title: str, text: str) -> str:
    """Run the program with the title as its last argument and the text on its standard input.

    Returns why that failed, or "". Takes at most LIMIT_S.
    """
    try:
        done = subprocess.run(  # noqa: S603  what the bench file names
            [*program, title], input=text, text=True, errors="replace", timeout=LIMIT_S, check=False,
            capture_output=True, start_new_session=True,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"the alert program {program[0]} has not ended within {LIMIT_S:g} s"
    except (OSError, ValueError) as problem:
        return f"the alert program {program[0]} cannot be run ({problem})"
    if done.returncode == 0:
        return ""
    said = (done.stderr or done.stdout).strip()[-200:]
    return f"the alert program {program[0]} ended with code {done.returncode}{f': {said}' if said else ''}"


def route(program: Sequence[str]) -> str:
    """What names an alert program in a record."""
    return hashlib.sha256(json.dumps(list(program)).encode()).hexdigest()
