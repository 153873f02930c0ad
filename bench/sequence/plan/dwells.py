"""Assignment of acquisitions to dwells by the ids of steps, of a plan or of a record."""

from __future__ import annotations


def first_visit(step_id: str) -> str:
    """Id of a step without the suffix `~2`, `~3`, … of a repeated execution."""
    return step_id.partition("~")[0]


def loop_values(step_id: str) -> dict[str, float]:
    """Values of the loop variables around a step, in the customary units of ids."""
    found = {}
    for part in step_id.split("/"):
        name, equals, value = part.partition("=")
        if equals:
            try:
                found[name] = float(value.partition("#")[0])
            except ValueError:
                continue
    return found


class DwellNames:
    """Names of dwells during a pass through the steps of a run.

    A dwell begins with a ramp, extends over the block that contains the ramp, and is named after it. Without a ramp it
    is the block around that of the acquisition.
    """

    def __init__(self) -> None:
        self._block = self._dwell = ""

    def ramped(self, step_id: str) -> None:
        """Note a ramp: later acquisitions in its block belong to another dwell."""
        self._block, _, visit = step_id.rpartition("/")
        self._dwell = self._block if visit == "ramp" else step_id

    def of(self, step_id: str) -> str:
        """Name of the dwell of an acquisition."""
        inside = self._block and step_id.startswith(f"{self._block}/")
        return self._dwell if inside else step_id.rsplit("/", 2)[0]
