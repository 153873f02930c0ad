"""The tests on a rate table against the truth: what a perfect bench would find of the units as drawn (equations 8.8).

    python -m campaigns.truth.table --seeds 40 --wires 3

runs all six sequences on perfect and on full benches, at the level of records and through all wires, and holds every
figure against its truth. With `--output codes` or `--output volts` all seeds go through all wires; on volts there are
ranges alone.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.app.request import RunRequest
from campaigns.truth import judge
from campaigns.truth.campaign import Comparison, campaign, full_bench, perfect_bench, results_of
from campaigns.truth.replay import at_record_level
from campaigns.truth.table_truth import truths

BENCHES = {
    "gyro_range": "gyro", "gyro_response": "gyro", "gyro_sweep": "gyro", "accel_range": "centrifuge",
    "accel_response": "response", "accel_sweep": "response",
}  # fmt: skip
BENCHES_BY_OUTPUT = {
    "pulses": BENCHES,
    "codes": {
        "gyro_range": "gyro_telemetry", "gyro_response": "gyro_telemetry", "gyro_sweep": "gyro_telemetry",
        "accel_range": "table_telemetry", "accel_response": "table_telemetry", "accel_sweep": "table_telemetry",
    },
    "volts": {"gyro_range": "gyro_volts", "accel_range": "table_volts"},
}  # fmt: skip
UNITS = ("rate_gyro", "response_60hz")
# What is left over in a converter when it is latched follows from bias and rate: with one bias for all seeds, all would
# have much the same errors of counting.
DRAWN = (("at_reference: 1 °/h", "at_reference: {mean: 1 °/h, sd: 0.5 °/h}"),
         ("at_reference: 0.8 mg", "at_reference: {mean: 0.8 mg, sd: 0.1 mg}"))  # fmt: skip
LONG_ON = ("warm_up=40 min",)  # so that the units are as warm as they become
TRUE_CLOCK = ("clock: {mean: 0 ppm, sd: 5 ppm}", "clock: 0 ppm")  # of a perfect bench, where a certificate says so
KINDS = ("perfect", "full")
RECORDS, WIRES = "at record level", "through all wires"
FAR = 5.0  # times its uncertainty is what no single value may be off
SHORT = {
    "gyro_range": (*LONG_ON, "rates=[50 °/s, 200 °/s, 400 °/s]", "record=5 s", "rest=5 s"),
    "gyro_response": (*LONG_ON, "frequencies=[10.37 Hz, 30.37 Hz, 57.37 Hz, 61.37 Hz, 90.37 Hz]", "record=4 s"),
    "accel_range": (*LONG_ON, "accelerations=[0.5 g, 1 g, 10 g, 20 g]", "record=5 s", "rest=5 s"),
    "accel_response": (
        *LONG_ON, "frequencies=[10.37 Hz, 30.37 Hz, 57.37 Hz, 61.37 Hz, 90.37 Hz]", "record=4 s",
        "lever_record=20 s",
    ),
    "gyro_sweep": (*LONG_ON, "lowest=20 Hz", "highest=100 Hz", "over=40 s"),
    "accel_sweep": (*LONG_ON, "lowest=20 Hz", "highest=100 Hz", "over=30 s", "lever_record=20 s"),
}  # fmt: skip


def table_bench(folder: Path, name: str, *, perfect: bool = False) -> Path:
    """A bench with a rate table in a folder of its own, with biases of its units that differ from seed to seed."""
    path = perfect_bench(folder, name) if perfect else full_bench(folder, name)
    for unit, drawn in zip(UNITS, DRAWN, strict=True):
        file = folder / "uut" / f"{unit}.yaml"
        text = file.read_text("utf-8")
        assert drawn[0] in text, file
        text = text.replace(*drawn)
        file.write_text(text.replace(*TRUE_CLOCK) if perfect else text, "utf-8")
    return path


def compare_table(folder: Path, results: dict | None = None, output: str = "pulses") -> list[Comparison]:
    """Every figure of a run with a truth beside it; those of one kind by the number of their point."""
    return compared(json.loads((folder / "truth.json").read_text("utf-8")), results or results_of(folder), output)


def compared(truth: dict, results: dict, output: str = "pulses") -> list[Comparison]:
    """The same of a truth and of results at hand."""
    true = truths(truth, results, output)
    return [
        Comparison.of(
            truth["seed"],
            found,
            true[found["quantity"]](found["at"] | {"steps": found["steps"]}),
            found["at"].get("point", 0),
        )
        for found in results["findings"]
        if found["quantity"] in true
    ]


def check_held(folder: Path, worth: dict[str, float], output: str = "pulses", at_least: int = 6) -> None:
    """Asserts that a run holds its truth, with uncertainties below what they are worth, and without a flag."""
    comparisons = compare_table(folder, output=output)
    assert len(comparisons) >= at_least
    ratios = np.array([each.ratio for each in comparisons])
    assert np.max(np.abs(ratios)) < 4
    assert np.sqrt(np.mean(ratios**2)) < 2
    assert {each.quantity: each.u for each in comparisons if each.u > worth.get(each.quantity, np.inf)} == {}
    results = results_of(folder)
    assert results["verdict"] == "PASS"
    assert [flag for unit in results["units"] for flag in unit["flags"]] == []


def table(comparisons: list[Comparison]) -> Iterator[str]:
    """A line for each quantity: rms of error over u, share within k = 3, mean u."""
    for quantity in dict.fromkeys(each.quantity for each in comparisons):
        chosen = [each for each in comparisons if each.quantity == quantity]
        ratios = np.array([each.ratio for each in chosen])
        yield (
            f"{quantity:<28} n {len(chosen):>4}  rms(error/u) {np.sqrt(np.mean(ratios**2)):6.3f}  mean "
            f"{np.mean(ratios):+.3f}  k=3 {np.mean(np.abs(ratios) <= 3):.1%}  u {np.mean([c.u for c in chosen]):.3g}"
        )


def one_a_run(comparisons: Iterable[Comparison]) -> Iterator[Comparison]:
    """One of each quantity of a run, another point from seed to seed: those of one run share errors of the bench."""
    runs: dict[tuple[int, str], list[Comparison]] = {}
    for each in comparisons:
        runs.setdefault((each.seed, each.quantity), []).append(each)
    return (found[seed % len(found)] for (seed, _), found in runs.items())


def problems_of(found: Sequence[Comparison], kind: str, *, by_records: bool) -> list[str]:
    """Results beyond the bounds of a perfect or a full bench; for few seeds, through all wires, only large ones."""
    if by_records:
        judged = found if kind == "perfect" else list(one_a_run(found))
        return list(judge.beyond(judge.by_quantity(judged), kind))
    return [str(each) for each in found if abs(each.ratio) > FAR]


def main() -> int:
    """Print how errors compare with their uncertainties; 1 when those of a kind do not fit."""
    options = _options()
    bad = []
    with tempfile.TemporaryDirectory() as temporary:
        for kind, output in itertools.product(options.kind or KINDS, options.output or ["pulses"]):
            for sequence in [each for each in BENCHES_BY_OUTPUT[output] if each in (options.only or BENCHES)]:
                folder = Path(temporary) / kind / output / sequence
                for how, found in _found(folder, sequence, output, kind, options):
                    what = f"{sequence} by {output} on a {kind} bench, {how}"
                    print(f"\n{what}\n" + "\n".join(table(found)), flush=True)
                    bad += [f"{what}: {each}" for each in problems_of(found, kind, by_records=how == RECORDS)]
    print("\n".join(bad) or "\ntruth: ok")
    return 1 if bad else 0


def _found(
    folder: Path, sequence: str, output: str, kind: str, options: argparse.Namespace
) -> Iterator[tuple[str, list[Comparison]]]:
    """The figures of all seeds of a sequence, and how they were got."""
    bench = table_bench(folder / "config", BENCHES_BY_OUTPUT[output][sequence], perfect=kind == "perfect")
    requests = [
        RunRequest(sequence, bench=str(bench), preset="quick", seed=seed, settings=LONG_ON, runs=folder)
        for seed in range(1, options.seeds + 1)
    ]
    wires = requests
    if output == "pulses":  # only they are replayed
        runs = at_record_level(requests, compared, options.processes)
        yield RECORDS, list(itertools.chain.from_iterable(runs))
        wires = requests[: options.wires]
    folders = campaign(wires, options.processes)
    yield WIRES, [each for run in folders for each in compare_table(run, output=output)]


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40, help="at record level, or of what is not replayed")
    parser.add_argument(
        "--wires", type=int, default=3, metavar="SEEDS", help="how many of them through all wires as well"
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", choices=sorted(BENCHES), action="append")
    parser.add_argument("--kind", choices=KINDS, action="append", help="of bench; both without it")
    parser.add_argument("--output", choices=sorted(BENCHES_BY_OUTPUT), action="append", help="pulses without it")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
