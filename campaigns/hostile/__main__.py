"""`make hostile`: mutated and hostile documents; each is read, or refused in our own words, within 100 ms."""

from __future__ import annotations

import argparse
import sys

from campaigns.hostile.campaign import Account, campaign
from campaigns.hostile.documents import hostile
from campaigns.hostile.trial import LIMIT_S

SHOWN = 20


def main() -> int:
    options = _options()
    if options.show is not None:
        document = hostile(options.seed, options.show)
        print(f"{document.kind}, {len(document.data)} bytes", file=sys.stderr)
        sys.stdout.buffer.write(document.data)
        return 0
    account = campaign(options.seed, options.first, options.count, options.jobs, options.kind)
    print(f"documents {options.first} to {options.first + options.count - 1} of seed {options.seed}")
    _tell(account)
    failed = bool(account.offences or account.slow)
    print("\nhostile: " + ("FAILED" if failed else "ok"))
    return 1 if failed else 0


def _tell(account: Account) -> None:
    for (way, outcome), count in sorted(account.outcomes.items()):
        print(f"  {way:<12} {outcome:<40} {count:>8}")
    for way in account.times_s:
        told = ", ".join(f"{part:g} %: {time_ms:.1f} ms" for part, time_ms in account.percentiles_ms(way))
        print(f"  {way:<12} time  {told}")
    print(f"  memory of one process at most {account.peak_kib / 1024:.0f} MiB")
    if long_s := account.long_plans_s:
        print(f"  {len(long_s)} plans of very many steps above {1e3 * LIMIT_S:g} ms, the longest {max(long_s):.1f} s")
    for alike in account.alike():
        one = alike[0]
        print(f"\n{len(alike)} x {one.outcome}: document {one.index} ({one.kind}) as {one.way}\n{one.detail}")
    if account.slow:
        print(f"\n{len(account.slow)} readings too slow, also alone and by the processor's time; the slowest:")
    for reading in sorted(account.slow, key=lambda one: -one.time_s)[:SHOWN]:
        said = f"{reading.outcome} {reading.detail.rpartition('.yaml')[2][:100]!r}"
        print(f"  {1e3 * reading.time_s:>8.1f} ms document {reading.index} ({reading.kind}) as {reading.way}: {said}")
    if account.offences or account.slow:
        print("\nto see one: python -m campaigns.hostile --seed SEED --show DOCUMENT")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first document")
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--kind", default="", help="only those of a kind that begins so, such as attacks or plans.steps"
    )
    parser.add_argument("--show", type=int, metavar="DOCUMENT", help="write one document instead, read nothing")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
