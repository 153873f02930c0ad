"""Other people's programs at the same work, each in an environment of its own.

`NAME.txt` has the requirements of an environment; a script prints one line of JSON with its figures.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
LIMIT_S = 3600.0  # a peer that has not ended by then hangs
ENVIRONMENTS = HERE.parents[1] / "build" / "peers"


def python_of(name: str) -> Path:
    """The interpreter of the environment `name`, which is rebuilt if its requirements or this interpreter change."""
    folder, requirements = ENVIRONMENTS / name, HERE / f"{name}.txt"
    wanted = f"{requirements.read_text('utf-8')}{Path(sys.executable).resolve()}, Python {sys.version}\n"
    python, mark = folder / "bin" / "python", folder / "made_from.txt"
    if not mark.exists() or mark.read_text("utf-8") != wanted:
        print(f"making the environment of {name} in {folder}", file=sys.stderr, flush=True)
        venv.create(folder, clear=True, with_pip=True)
        quiet: list[str | Path] = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*quiet, "-r", requirements], check=True)
        mark.write_text(wanted, "utf-8")
    return python


def version_of(name: str, package: str) -> str:
    """The version of a package in an environment."""
    asked = f"from importlib.metadata import version; print(version({package!r}))"
    return subprocess.run([python_of(name), "-c", asked], check=True, text=True, capture_output=True).stdout.strip()


def figures(name: str, script: str, *arguments: str | os.PathLike[str]) -> dict[str, Any]:
    """What `script` of this folder printed as its last line, run in the environment `name`."""
    command = [python_of(name), HERE / script, *arguments]
    done = subprocess.run(command, text=True, capture_output=True, timeout=LIMIT_S)
    if done.returncode != 0:
        raise RuntimeError(f"{script} ended with {done.returncode}:\n{done.stdout}\n{done.stderr}")
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result
