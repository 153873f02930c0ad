"""Mean rates of all windows of a night as a script with pandas finds them: ROWS, RESULT.

ROWS is a file of NumPy with a row for each latch: window, tick, then both counters of each channel. RESULT says at
how many bits they wrap, and gets the rates. Times are from a Parquet file, and from a frame in memory.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd

rows, result = np.load(sys.argv[1]), Path(sys.argv[2])
given = json.loads(result.read_text("utf-8"))
channels = range((rows.shape[1] - 2) // 2)
positive, negative = ([f"{sign}_{channel}" for channel in channels] for sign in ("positive", "negative"))
path = result.with_suffix(".parquet")
pd.DataFrame(rows, columns=["window", "tick", *positive, *negative]).to_parquet(path)


def rates_pps(frame: pd.DataFrame) -> pd.DataFrame:
    """Mean rate of each channel over each window."""
    steps = frame.groupby("window").diff()
    steps["tick"] %= 1 << given["tick_bits"]
    counters = [*positive, *negative]
    steps[counters] %= 1 << given["counter_bits"]
    sums = steps.groupby(frame["window"]).sum()
    pulses = sums[positive].to_numpy() - sums[negative].to_numpy()
    return pd.DataFrame(pulses / (sums[["tick"]].to_numpy() * given["tick_period_s"]), index=sums.index)


began_s = time.perf_counter()
frame = pd.read_parquet(path)
rates_pps(frame)
file_s = time.perf_counter() - began_s
began_s = time.perf_counter()
found = rates_pps(frame)
memory_s = time.perf_counter() - began_s
result.write_text(json.dumps({**given, "rates_pps": found.to_numpy().tolist()}), "utf-8")
print(json.dumps({"file_s": file_s, "memory_s": memory_s, "rows": len(rows)}))
