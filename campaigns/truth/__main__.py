"""`make truth`: results against the simulated truth on a perfect and on a full bench, then with errors planted."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from bench.app.request import RunRequest
from campaigns.truth import judge
from campaigns.truth.campaign import campaign, compare, full_bench, perfect_bench
from campaigns.truth.planted import PLANTED, comparisons_with


def main() -> int:
    options = _options()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        benches = {
            "perfect": perfect_bench(folder / "config", options.bench),
            "full": full_bench(folder / "config", options.bench),
        }
        problems: list[str] = []
        folders: dict[str, list[Path]] = {}
        for name, bench in benches.items():
            requests = [
                RunRequest(
                    sequence="tumble_static", bench=str(bench), preset=options.preset, seed=seed,
                    uut_model=options.uut_model, settings=tuple(options.set), runs=folder / name,
                )
                for seed in range(1, options.seeds + 1)
            ]  # fmt: skip
            folders[name] = campaign(requests, options.processes)
            comparisons = compare(folders[name])
            print(f"\n{name} bench, {options.seeds} seeds")
            print("\n".join(judge.table(comparisons)))
            found = judge.judge_perfect(comparisons) if name == "perfect" else judge.judge_full(comparisons)
            problems += [f"{name} bench: {problem}" for problem in found]
        if options.bench == "simulated":  # the mistakes are those of counting
            problems += _plant(folders["perfect"])
    for problem in problems:
        print(problem)
    print("\ntruth: " + ("FAILED" if problems else "ok"))
    return 1 if problems else 0


def _plant(folders: list[Path]) -> list[str]:
    """Every planted error must be seen on the perfect bench."""
    print("\nplanted errors, each reduced anew from the perfect bench's runs")
    unseen = []
    for name, plant in PLANTED.items():
        seen = judge.judge_perfect(comparisons_with(plant, folders))
        print(f"{name:<40} {'seen: ' + seen[0] if seen else 'NOT SEEN'}")
        if not seen:
            unseen.append(f"planted error not seen: {name}")
    return unseen


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--bench", default="simulated", help="the name of a shipped bench")
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--uut-model", type=Path, default=None, metavar="FILE")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
