"""A run in the register of benches that may be energised: what it finds there, what it leaves."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from bench.config.bench import LoadedBench
from bench.engine.ending import Outcome
from bench.errors import StoreError
from bench.runner.held import energising_addresses, is_followed
from bench.store.energised import energised, note_energised, note_safe


class Register:
    """The entry of one run; a bench without real connections has none. Trouble with it is a notice."""

    def __init__(self, loaded: LoadedBench, run: Path, notice: Callable[[str], object]) -> None:
        self._bench, self._run, self._notice = loaded.document.path, run, notice
        self._connections = {role: str(address) for role, address in energising_addresses(loaded.bench).items()}

    def begin(self, at: datetime) -> dict[str, str]:
        """Enter this run, before anything is opened; the instruments that others may have left on, with these runs."""
        found: dict[str, str] = {}
        if not self._connections:
            return found
        try:
            for each in energised(lambda problem: self._notice(str(problem))):
                mine = {role: at for role, at in each.connections.items() if at in self._connections.values()}
                held = [role for role, at in mine.items() if is_followed(at)]
                left = [role for role in mine if role not in held]
                if held:
                    self._notice(
                        f"{', '.join(held)}: held at its set point after {Path(each.run).name}, and stays there."
                    )
                if left:
                    found |= dict.fromkeys(left, Path(each.run).name)
                    self._notice(
                        f"{Path(each.run).name} ended without making {', '.join(left)} safe. This run makes them safe "
                        "before its first step."
                    )
            note_energised(self._run, self._bench, at, self._connections)
        except StoreError as problem:
            self._notice(f"{problem}: 'bench make-safe' will need --bench {self._bench}")
        return found

    def end(self, outcome: Outcome) -> None:
        """Take out what this run has made safe; a chamber that is held is not safe yet."""
        left = {*outcome.unsafe, *outcome.not_reached, *outcome.held}
        try:
            note_safe({address for role, address in self._connections.items() if role not in left})
        except StoreError as problem:
            self._notice(str(problem))
