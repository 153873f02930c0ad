"""The run's side of its guardian: no energy without a guardian, a beat while the loop turns; its loss ends the run."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

from bench.clock import Stopwatch
from bench.config.bench import LoadedBench
from bench.engine.ending import EndRequest, Outcome
from bench.engine.pulse import GUARDIAN_LATE, GUARDIAN_OK, Pulse
from bench.errors import BenchError
from bench.guardian.watch import ARMED, BEAT_S, CANNOT, LONGEST, Over, beat, over
from bench.runner.held import energising_addresses
from bench.runner.signals import EndSignal, Signals
from bench.store.writer import RunWriter

UNREAD_BYTES = 8192  # about ten beats
STILL_BEATS = 20  # beats that do not fit into the buffer, after which the guardian counts as hung
ARMED_WITHIN_S = 60.0  # on a loaded computer
ENDS_WITHIN_S = 5.0
PROGRAM = (  # with the module search path of the run, so that files in this directory cannot change the program
    "import json, os, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from bench.guardian.main import main; os._exit(main(*sys.argv[2:]))"  # os._exit waits for no thread that writes
)
LOST = EndRequest("guardian", "its guardian has died; nothing would make the bench safe if this process died")
STILL = EndRequest("guardian", "its guardian hangs; nothing would make the bench safe if this process died")
MEMORY_PRESSURE = Path("/proc/self/oom_score_adj")
ABOVE, MOST = 500, 1000  # added to the value that the guardian has; the maximum of the kernel


class GuardError(BenchError):
    """Failure to start the guardian of a run; nothing was energised."""

    code = "guardian"


@dataclass
class Guard:
    """Guardian of a run: data for its beats, and the state of the bench at its dismissal."""

    roles: tuple[str, ...] = ()
    pulse: Pulse = field(default_factory=Pulse)
    end: Over = field(default_factory=Over)

    def leaves(self, outcome: Outcome) -> None:
        """Record how the run has left its bench, from its outcome."""
        open_ = {*outcome.unsafe, *outcome.not_reached, *outcome.held}
        self.end = Over(tuple(role for role in self.roles if role not in open_), tuple(outcome.held))


@asynccontextmanager
async def guarded(loaded: LoadedBench, run: Path, signals: Signals, writer: RunWriter) -> AsyncIterator[Guard]:
    """Run the block under a guardian: opening the instruments of a bench, the run, and making it safe.

    The guardian is ready at the beginning, or GuardError is raised. Its death ends the run. At the end, also after an
    error, it is dismissed and supervises the chambers alone; if the end never comes it makes the bench safe. Benches
    without real instruments that can be energised get no guardian.
    """
    roles = tuple(energising_addresses(loaded.bench))
    if not roles:
        yield Guard()
        return
    link, process = _start(loaded, run)
    guard = Guard(roles, Pulse([role for role in roles if loaded.bench.devices[role].safe_state.hold_s]))
    try:
        _wait_until_armed(link)
        guard.pulse.guardian = GUARDIAN_OK
        beating = asyncio.create_task(_send_heartbeats(link, process.pid, signals, guard, writer), name="guardian")
        try:
            with _killed_before_its_guardian():
                yield guard
        finally:
            beating.cancel()
    except Exception:
        _dismiss(link, process, Over())
        raise
    _dismiss(link, process, guard.end)


def try_guardian(loaded: LoadedBench, folder: Path) -> float:
    """Start and dismiss a guardian with nothing energised; return the duration in s. Raises GuardError."""
    watch = Stopwatch()
    if not energising_addresses(loaded.bench):
        return 0.0
    link, process = _start(loaded, folder)
    try:
        _wait_until_armed(link)
        return watch.elapsed_s()
    finally:
        _dismiss(link, process, Over())


def _start(loaded: LoadedBench, run: Path) -> tuple[socket.socket, subprocess.Popen[bytes]]:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNREAD_BYTES)
    document = loaded.document
    digest = hashlib.sha256(document.text.encode()).hexdigest()
    words = [json.dumps(sys.path), str(far.fileno()), str(os.getpid())]
    words += [str(run.absolute()), str(document.path.absolute()), digest]
    try:
        with far:
            process = subprocess.Popen(  # noqa: S603  runs this program itself
                [sys.executable, "-P", "-c", PROGRAM, *words],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, pass_fds=(far.fileno(),), start_new_session=True,
            )  # fmt: skip
    except OSError as problem:
        near.close()
        raise GuardError(f"The guardian of the run could not be started ({problem}). Nothing was energised.") from None
    return near, process


@contextmanager
def _killed_before_its_guardian() -> Iterator[None]:
    """Let the kernel choose this process before its guardian, which has the same value, when memory runs out."""
    inherited = None
    with suppress(OSError, ValueError):  # not permitted in some containers; it is only an improvement
        inherited = int(MEMORY_PRESSURE.read_text("ascii"))
        MEMORY_PRESSURE.write_text(str(min(inherited + ABOVE, MOST)), "ascii")
    try:
        yield
    finally:
        if inherited is not None:
            with suppress(OSError):
                MEMORY_PRESSURE.write_text(str(inherited), "ascii")


async def _send_heartbeats(
    link: socket.socket, guardian: int, signals: Signals, guard: Guard, writer: RunWriter
) -> None:
    """Send beats for ever; a guardian that takes none gets SIGCONT, and the run ends if that does not help."""
    untaken = 0
    for turns in count():
        polls = {role: polls for role, polls in guard.pulse.polls.items() if role in guard.roles}
        commits, waits = writer.commits
        try:
            link.send(beat(turns, commits, polls, waits=waits, may_hold=guard.pulse.may_hold()))
            untaken, guard.pulse.guardian = 0, GUARDIAN_OK
        except BlockingIOError:
            untaken, guard.pulse.guardian = untaken + 1, GUARDIAN_LATE
            os.kill(guardian, signal.SIGCONT)  # somebody may have stopped it
            if untaken > STILL_BEATS:
                signals.request_end(EndSignal("a guardian that hangs", STILL))
                return
        except OSError:
            signals.request_end(EndSignal("the death of its guardian", LOST))
            return
        await asyncio.sleep(BEAT_S)


def _dismiss(link: socket.socket, process: subprocess.Popen[bytes], end: Over) -> None:
    """End the guardian, by force if it hangs. Supervision of the chambers is another process by then."""
    with link, suppress(OSError):
        link.settimeout(ENDS_WITHIN_S)
        link.send(over(end))
    try:
        process.wait(ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _wait_until_armed(link: socket.socket) -> None:
    """Wait until the guardian is ready. Raises GuardError. Blocks the loop, in which nothing else runs yet."""
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
