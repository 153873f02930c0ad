"""Peak memory in MB of a night of so many hours, its report included: `python -m benchmarks.long_night 15`.

Two temperatures with the same few measurements, however long the bench waits at them.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.runner.quiet import Quiet
from benchmarks.cost import peak_mb

BENCH = Path(__file__).parents[1] / "config" / "simulated.yaml"
SEQUENCE = """\
schema: itb-sequence/1
title: A long night
needs:
  {{chamber: thermal_chamber, head: positioner, output: output, supply: power_supply, unit_temperature: thermometer}}
setup:
  - set: supply
    voltage: 15 V
    current_limit: 120 mA
    output: on
steps:
  - for_each: temperature
    in: [30 °C, 20 °C]
    steps:
      - ramp: chamber
        to: ${{temperature}}
        at: 1 °C/min
      - for_each: hour
        in: {{from: 1, to: {hours}}}
        steps:
          - wait: 1 h
      - for_each: position
        in: [1°, 91°, 181°, 271°]
        steps:
          - {{move: head, to: "${{position}}", settle: 5 s}}
          - {{acquire: output, for: 60 s, label: tumble}}
teardown:
  - set: supply
    output: off
results:
  - method: temperature_tumble
    data: tumble
    settings: {{degree: 1}}
"""


def main() -> None:
    """Run the night in a folder that is removed."""
    hours = int(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long_night.yaml"
        path.write_text(SEQUENCE.format(hours=max(1, hours // 2)), "utf-8")
        result = execute(prepare(RunRequest(str(path), bench=str(BENCH), runs=Path(folder) / "runs")), Quiet())
    if result.outcome.how != "completed":
        raise SystemExit("\n".join(result.problems))
    print(peak_mb())


if __name__ == "__main__":
    main()
