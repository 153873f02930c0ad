"""What commands write: the answer to standard output, remarks on it to standard error."""

from __future__ import annotations

import json
import sys


def say(*lines: object) -> None:
    """Write lines of an answer, at once."""
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    sys.stdout.flush()


def say_json(content: object, indent: int | None = None) -> None:
    """Write an answer as a JSON document."""
    say(json.dumps(content, ensure_ascii=False, indent=indent))


def remark(*lines: object) -> None:
    """Write lines that are no part of the answer."""
    sys.stderr.write("".join(f"{line}\n" for line in lines))
