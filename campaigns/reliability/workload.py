"""A short simulated run, as a program: it writes how many rows were acknowledged, and at its end how it ended."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.errors import BenchError
from bench.runner.quiet import Quiet
from bench.store.writer import RunWriter

STDOUT = 1


def main(runs: Path) -> None:
    """Lines of JSON on standard output."""
    really = RunWriter.commit

    async def commit(self: RunWriter) -> None:
        rows = sum(self._numbers.values())
        await really(self)
        os.write(STDOUT, f"{rows}\n".encode())

    RunWriter.commit = commit  # type: ignore[method-assign]  # of this process alone
    try:
        result = execute(prepare(RunRequest("smoke", runs=runs)), Quiet())
    except BenchError as problem:
        ended = {"how": "not begun", "problems": [str(problem)], "unsafe": {}}
    else:
        outcome = result.outcome
        ended = {"how": outcome.how, "problems": result.problems, "unsafe": dict(outcome.unsafe)}
    os.write(STDOUT, json.dumps(ended).encode() + b"\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
