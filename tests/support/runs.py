"""Whole runs on a simulated bench in virtual time, for tests."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from bench.app.execute import RunResult, execute
from bench.app.request import RunRequest, prepare
from bench.runner.quiet import Quiet

ROOT = Path(__file__).parents[2]
SHORT = (  # the tumble at three temperatures, as short as its soak allows
    "temperatures=[20 °C, 30 °C, 20 °C]", "warm_up=0 s", "soak=30 min", "gate=10 s", "ramp_rate=3 °C/min",
)  # fmt: skip


def copy_bench(folder: Path, *edits: tuple[str, str], faults: str = "") -> Path:
    """The demonstration bench in a folder of its own, its text edited; every edit must find its text.

    `faults` is the value of `simulation.faults`, as YAML.
    """
    shutil.copytree(ROOT / "config", folder, dirs_exist_ok=True)
    path = folder / "simulated.yaml"
    text = path.read_text("utf-8")
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    if faults:
        text += f"  faults: {faults}\n"
    path.write_text(text, "utf-8")
    return path


def run_short(folder: Path, *, bench: Path | None = None, sequence: str = "tumble_static", **wishes: Any) -> RunResult:
    """A short run in `folder`; `wishes` are those of RunRequest."""
    wishes.setdefault("settings", SHORT if sequence == "tumble_static" else ())
    request = RunRequest(sequence, bench=str(bench or ROOT / "config" / "simulated.yaml"), runs=folder, **wishes)
    return execute(prepare(request), Quiet())


def read_json(result: RunResult, name: str) -> Any:
    """A JSON file of a run directory."""
    return json.loads((result.path / name).read_text("utf-8"))
