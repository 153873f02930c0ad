"""Processor time of the program beside that of a yardstick, in one run: bounds that only a real loss of speed exceeds.

Ratios of processor time, the best of three rounds, hardly depend on the machine or on what else it does. `make
benchmark` measures; these tests only notice when something has become several times slower.
"""

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bench.cli.exits import NOT_JUDGED, PASS
from tests.support.sequences import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.integration]

ROUNDS = 3
BENCH = (sys.executable, "-m", "bench")
NOTHING = (sys.executable, "-c", "pass")
# what a check cannot do without
A_MODEL = (sys.executable, "-c", "import pydantic\nclass One(pydantic.BaseModel):\n    x: int\nOne(x=1)")
# what a run on simulators cannot do without
SIMULATED = (sys.executable, "-c", "import cantools.database, pydantic, scipy.linalg")
COUNTED = "{outer: rate_table, counter: pulse_counter}"
STEPS = 1000
COMMITS = f"""
import sqlite3, sys, tempfile
database = sqlite3.connect(tempfile.mkdtemp(dir=sys.argv[1]) + "/bare.db", isolation_level=None)
database.execute("PRAGMA journal_mode=WAL")
database.execute("PRAGMA synchronous=FULL")
database.execute("CREATE TABLE journal(seq INTEGER PRIMARY KEY, text TEXT)")
for number in range({STEPS}):
    database.execute("BEGIN IMMEDIATE")
    database.execute("INSERT INTO journal VALUES (?, ?)", (number, "a row of the journal"))
    database.execute("COMMIT")
"""
DECODED = """
import sys, time
import cantools, numpy as np
from drivers.can.dbc import Dbc
from drivers.can.frame_block import FrameBlock

text, count = open(sys.argv[1]).read(), 4000
ours, theirs = Dbc(text), cantools.database.load_string(text, "dbc")
ids = np.tile(np.array([0x100, 0x101, 0x102, 0x103], np.uint32), count // 4)
data = np.random.default_rng(1).integers(0, 256, (count, 8)).astype(np.uint8)
block = FrameBlock(ids, np.zeros(count), np.full(count, 8, np.uint8), data)

def by_us():
    for message in ours.messages.values():
        words = message.sent_in(block).words
        for signal in message.signals.values():
            signal.raw(words)

def by_them():
    for frame_id, payload in zip(ids.tolist(), map(bytes, data), strict=True):
        theirs.decode_message(frame_id, payload, decode_choices=False, scaling=False)

def best_s(work):
    took_s = []
    for _ in range(5):
        began_s = time.process_time()
        work()
        took_s.append(time.process_time() - began_s)
    return min(took_s)

print(best_s(by_them) / best_s(by_us))
"""


def cpu_s(*command: str | Path) -> float:
    """Least processor time of a command and its children."""
    unmeasured = {name: value for name, value in os.environ.items() if not name.startswith("COVERAGE")}
    took_s = []
    for _ in range(ROUNDS):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=unmeasured)
        assert done.returncode in (PASS, NOT_JUDGED), done.stderr
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        took_s.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(took_s)


def test_help_takes_little_more_than_python():
    assert cpu_s(*BENCH, "--help") < 7 * cpu_s(*NOTHING)


@pytest.mark.parametrize(
    ("sequence", "bench", "most"), [("tumble_static", "simulated", 3.5), ("imu_start_up", "imu", 4.5)]
)
def test_a_check_takes_a_few_times_the_import_of_what_it_needs(sequence, bench, most):
    check_s = cpu_s(*BENCH, "check", f"sequences/{sequence}.yaml", "--bench", f"config/{bench}.yaml")
    assert check_s < most * cpu_s(*A_MODEL)


def run_s(folder: Path, steps: str, bench: str | Path = "config/simulated.yaml", needs: str = "{}") -> float:
    path = folder / "sequence.yaml"
    path.write_text(f"schema: itb-sequence/1\ntitle: Speed\nneeds: {needs}\nsteps:\n{steps}\n", "utf-8")
    return cpu_s(*BENCH, "run", path, "--bench", bench, "--no-report", "--runs", folder / "runs")


def test_a_run_begins_in_a_few_times_the_import_of_what_it_needs(tmp_path):
    assert run_s(tmp_path, "  - note: Nothing.") < 4 * cpu_s(*SIMULATED)


def test_a_durable_step_takes_a_few_times_a_bare_commit(tmp_path):
    steps_s = run_s(tmp_path, f"  - {{repeat: {STEPS}, steps: [note: Nothing.]}}")
    commits_s = cpu_s(sys.executable, "-c", COMMITS, tmp_path) - cpu_s(sys.executable, "-c", "import sqlite3, tempfile")
    assert steps_s - run_s(tmp_path, "  - note: Nothing.") < 8 * commits_s


def test_an_hour_at_100_hz_takes_a_few_times_one_at_10_hz(tmp_path):
    shutil.copytree(ROOT / "config", tmp_path / "config")
    took_s = {}
    for period in ("100 ms", "10 ms"):
        bench = tmp_path / "config" / "at_a_rate.yaml"
        bench.write_text((ROOT / "config/imu.yaml").read_text("utf-8").replace("period: 100 ms", f"period: {period}"))
        hours, nothing = "  - {acquire: counter, for: 2 h, label: hours}", "  - note: Nothing."
        took_s[period] = run_s(tmp_path, hours, bench, COUNTED) - run_s(tmp_path, nothing, bench, COUNTED)
    assert took_s["10 ms"] < 6 * took_s["100 ms"]


def test_frames_are_decoded_many_times_faster_than_one_by_one():
    done = subprocess.run(
        [sys.executable, "-c", DECODED, "config/if_counter.dbc"], check=True, capture_output=True, text=True, cwd=ROOT
    )
    assert float(done.stdout) > 15
