"""The run's end of its guardian: no guardian, no energy; a beat while the loop turns; its loss ends the run."""

from __future__ import annotations

import asyncio
import hashlib
import socket
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

from bench.config.bench import LoadedBench
from bench.engine.ending import EndRequest
from bench.errors import BenchError
from bench.guardian.watch import ARMED, BEAT, CANNOT, LONGEST, OVER
from bench.runner.held import energising_addresses
from bench.runner.signals import Sent, Signals

BEAT_S = 0.5
ARMED_WITHIN_S = 60.0  # on a computer with much else to do
ENDS_WITHIN_S = 5.0
LOST = EndRequest("guardian", "its guardian has died, which would make the bench safe if this process died")
MEMORY_PRESSURE = Path("/proc/self/oom_score_adj")
TAKEN_FIRST = "500"  # by the kernel when memory runs out: the run, and not its guardian


class GuardError(BenchError):
    """The guardian of a run could not be started; nothing was energised."""

    code = "guardian"


class Guard:
    """The guardian of a run on a bench with real instruments that move or energise something; else nothing.

    Lifetime: `start`, `watched` around everything that opens instruments, `over` when they are safe. Without `over` the
    guardian makes the bench safe as soon as this process ends.
    """

    def __init__(self, loaded: LoadedBench, run: Path) -> None:
        self._loaded, self._run = loaded, run
        self._process: subprocess.Popen[bytes] | None = None
        self._link: socket.socket | None = None

    def start(self, process: int) -> None:
        """Start the guardian of this process."""
        if not energising_addresses(self._loaded.bench):
            return
        document = self._loaded.document
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with far:
            digest = hashlib.sha256(document.text.encode()).hexdigest()
            words = [str(far.fileno()), str(process), str(self._run.absolute()), str(document.path.absolute()), digest]
            self._process = subprocess.Popen(  # noqa: S603  this program itself
                [sys.executable, "-m", "bench.guardian", *words],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, pass_fds=(far.fileno(),), start_new_session=True,
            )  # fmt: skip
        self._link = near
        with suppress(OSError):  # a run in a container may not; it is an advantage, not a condition
            MEMORY_PRESSURE.write_text(TAKEN_FIRST, "ascii")

    @asynccontextmanager
    async def watched(self, signals: Signals) -> AsyncIterator[None]:
        """Beat while inside, once the guardian is ready; its death ends the run. Raises GuardError at the beginning."""
        if self._link is None:
            yield
            return
        _wait_until_armed(self._link)
        beating = asyncio.create_task(self._beat(self._link, signals), name="guardian")
        try:
            yield
        finally:
            beating.cancel()

    async def _beat(self, link: socket.socket, signals: Signals) -> None:
        while True:
            try:
                link.send(BEAT)
            except BlockingIOError:  # it stands still, and has not died
                pass
            except OSError:
                signals.tell(Sent("the death of its guardian", LOST))
                return
            await asyncio.sleep(BEAT_S)

    def over(self) -> None:
        """The instruments are safe, or what is not is on record: the guardian is dismissed."""
        if self._link is None or self._process is None:
            return
        with suppress(OSError):
            self._link.setblocking(True)
            self._link.settimeout(ENDS_WITHIN_S)
            self._link.send(OVER)
        self._link.close()
        self._link = None
        try:
            self._process.wait(ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _wait_until_armed(link: socket.socket) -> None:
    """Return when the guardian is ready; raises GuardError. Blocks the loop, in which there is nothing else yet."""
    link.settimeout(ARMED_WITHIN_S)
    try:
        answer = link.recv(LONGEST)
    except TimeoutError:
        answer = CANNOT + f"no answer within {ARMED_WITHIN_S:g} s".encode()
    except OSError as problem:
        answer = CANNOT + str(problem).encode()
    if answer != ARMED:
        why = answer.removeprefix(CANNOT).decode(errors="replace") or "it has ended"
        raise GuardError(f"The guardian of the run could not be started ({why}). Nothing was energised.")
    link.setblocking(False)
