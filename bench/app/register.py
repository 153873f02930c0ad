"""A run in the register of benches that may be energised: what it finds there, what it leaves."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from bench.config.bench import LoadedBench
from bench.engine.ending import Outcome
from bench.errors import StoreError
from bench.runner.held import energising_addresses
from bench.store.energised import energised, note_energised, note_safe


class Register:
    """The entry of one run; a bench without real connections has none. Trouble with it is a notice."""

    def __init__(self, loaded: LoadedBench, run: Path, notice: Callable[[str], object]) -> None:
        self._bench, self._run, self._notice = loaded.document.path, run, notice
        self._connections = {role: str(address) for role, address in energising_addresses(loaded.bench).items()}

    def begin(self, at: datetime) -> None:
        """Name the runs that may have left these instruments on, then enter this one, before anything is opened."""
        if not self._connections:
            return
        try:
            for each in energised(lambda problem: self._notice(str(problem))):
                left = [role for role, address in each.connections.items() if address in self._connections.values()]
                if left:
                    self._notice(
                        f"{Path(each.run).name} ended without making {', '.join(left)} safe. Each of them is as that "
                        "run left it until a step sets it, or until this run ends."
                    )
            note_energised(self._run, self._bench, at, self._connections)
        except StoreError as problem:
            self._notice(f"{problem}: 'bench make-safe' will need --bench {self._bench}")

    def end(self, outcome: Outcome) -> None:
        """Take out what this run has made safe."""
        left = {*outcome.unsafe, *outcome.not_reached}
        try:
            note_safe({address for role, address in self._connections.items() if role not in left})
        except StoreError as problem:
            self._notice(str(problem))
