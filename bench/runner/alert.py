"""Alerts to an absent person, by the program that a bench file names."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Sequence

LIMIT_S = 30.0


def alert(program: Sequence[str], title: str, text: str) -> str:
    """Run the program with the title as its last argument and the text on its standard input.

    Return the error, or "". Takes at most LIMIT_S.
    """
    try:
        done = subprocess.run(  # noqa: S603  the program is configured in the bench file
            [*program, title], input=text, text=True, errors="replace", timeout=LIMIT_S, check=False,
            capture_output=True, start_new_session=True,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"the alert program {program[0]} has not ended within {LIMIT_S:g} s"
    except (OSError, ValueError) as problem:
        return f"the alert program {program[0]} cannot be run ({problem})"
    if done.returncode == 0:
        return ""
    output = (done.stderr or done.stdout).strip()[-200:]
    return f"the alert program {program[0]} ended with code {done.returncode}{f': {output}' if output else ''}"


def program_id(program: Sequence[str]) -> str:
    """Return the identification of an alert program in a record."""
    return hashlib.sha256(json.dumps(list(program)).encode()).hexdigest()
