"""Cases a second of HardPy with its storage of JSON files: COUNT.

The session of pytest less the one of a single case. The whole document is written again at each step, so that long
tests are slower than short ones.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CASE = """
def test_{number}():
    hardpy.set_case_measurement(hardpy.NumericMeasurement(value=5.0, name="m", lower_limit=0, upper_limit=10))
"""


def session_s(count: int) -> float:
    """Duration of a session with so many cases."""
    with tempfile.TemporaryDirectory() as folder:
        command = [Path(sys.executable).parent / "hardpy", "init", folder, "--no-create-database", "--storage-type"]
        subprocess.run([*command, "json"], check=True, capture_output=True)
        cases = "".join(CASE.format(number=number) for number in range(count))
        (Path(folder) / "test_1.py").write_text(f"import hardpy\n{cases}", "utf-8")
        began_s = time.perf_counter()
        command = [sys.executable, "-m", "pytest", "-q", "."]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        took_s = time.perf_counter() - began_s
    assert f"{count} passed" in done.stdout, done.stdout
    return took_s


asked = int(sys.argv[1])
one_s = session_s(1)
print(json.dumps({"steps_per_s": (asked - 1) / (session_s(asked) - one_s)}))
