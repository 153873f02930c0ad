"""Entry of a run in the register of energised benches."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from bench.config.bench import LoadedBench
from bench.engine.ending import Outcome
from bench.errors import StoreError
from bench.runner.found_on import LeftOn
from bench.runner.held import energising_addresses, is_followed
from bench.store.energised import energised, note_energised, note_safe
from bench.store.machine_state import problem_to_write


class Register:
    """Register entry of one run; none for a bench without real connections. Errors are shown as notices."""

    def __init__(self, loaded: LoadedBench, run: Path, notice: Callable[[str], object]) -> None:
        self._bench, self._run, self._notice = loaded.document.path, run, notice
        self._connections = {role: str(address) for role, address in energising_addresses(loaded.bench).items()}

    def begin(self, at: datetime) -> LeftOn:
        """Register this run before anything is opened; return what other runs may have left on."""
        found: dict[str, str] = {}
        held: set[str] = set()
        if not self._connections:
            return LeftOn()
        if problem := problem_to_write():
            self._notice(f"{problem}. Until then 'bench make-safe' of other users does not know of this run.")
        roles = {address: role for role, address in self._connections.items()}
        try:
            for each in energised(lambda problem: self._notice(str(problem))):
                mine = {role: address for address, role in roles.items() if address in each.connections.values()}
                followed = [role for role, address in mine.items() if is_followed(address)]
                left = [role for role in mine if role not in followed]
                if followed:
                    held.update(followed)
                    self._notice(f"{', '.join(followed)}: held at its set point after {each.name}, and stays there.")
                if left:
                    found |= dict.fromkeys(left, each.name)
                    self._notice(
                        f"{each.name} ended without making {', '.join(left)} safe. This run makes them safe before its "
                        "first step."
                    )
            note_energised(self._run, self._bench, at, self._connections)
        except StoreError as problem:
            self._notice(f"{problem}: 'bench make-safe' will need --bench {self._bench}")
        return LeftOn(found, held)

    def end(self, outcome: Outcome) -> None:
        """Remove the instruments that this run has made safe; a held chamber is not safe yet."""
        left = {*outcome.unsafe, *outcome.not_reached, *outcome.held}
        try:
            note_safe({address for role, address in self._connections.items() if role not in left})
        except StoreError as problem:
            self._notice(str(problem))
