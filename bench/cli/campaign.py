"""campaign: many independent nights or reductions, by several processes or a cluster."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.cli.commands import Command, argument, flag, option, options, whole_number
from bench.cli.exits import ABORTED, BENCH_ERROR
from bench.cli.interrupts import terminated_as_interrupted
from bench.cli.streams import remark, say

if TYPE_CHECKING:  # keeps imports out of `bench --help`
    from bench.campaign.ledger import Ledger
    from bench.campaign.tasks import Campaign

FAILURES_SHOWN = 10


def truth(
    part: tuple[str, ...], method: tuple[str, ...], unit: tuple[str, ...], form: tuple[str, ...],
    level: tuple[str, ...], seeds: int, decide: int, block: int, *, figures: bool, **cluster: Any,
) -> int:  # fmt: skip
    """Compare results with the simulated truth: methods × units × forms of the errors of a bench × seeds.

    For the sources of this program. Without --part, --method, --unit, --form and --level all parts of `make truth`.
    """
    from bench.campaign.kinds import of_sources

    return _carried_out(
        lambda: of_sources(
            "truth", parts=part, methods=method, kinds=unit, forms=form, levels=level, seeds=seeds, decide=decide,
            block=block, figures=figures,
        ),
        **cluster,
    )  # fmt: skip


def monte_carlo(only: tuple[str, ...], draws: int, **cluster: Any) -> int:
    """Compare the scatter of results over random draws (GUM supplement 1) with their stated uncertainties.

    For the sources of this program.
    """
    from bench.campaign.kinds import of_sources

    return _carried_out(lambda: of_sources("monte_carlo", trials=only, draws=draws), **cluster)


def wires(trials: int, **cluster: Any) -> int:
    """Try faults on lines and buses, swapped instruments and second masters. For the sources of this program."""
    from bench.campaign.kinds import of_sources

    return _carried_out(lambda: of_sources("wires", trials=trials), **cluster)


def faults(
    sequence: str, bench: str, preset: str | None, settings: tuple[str, ...], seeds: int, first: int, **cluster: Any
) -> int:
    """Rehearse a sequence many times, each time with faults drawn by another seed.

    Each night must leave all devices safe that no fault has broken, lose nothing, and name the cause if it ends early.
    """

    def campaign() -> Campaign:
        from bench.campaign.nights import Faults, night_of

        return Faults(night_of(sequence, bench, preset, settings), range(first, first + seeds))

    return _carried_out(campaign, **cluster)


def reduce(archive: str, *, publish: bool, **cluster: Any) -> int:
    """Reduce all runs of an archive again with the present program, and list what changes.

    Changes of a value or of its standard uncertainty u are listed from 0.1 u, and all changed verdicts. The data are
    the same: u says nothing on whether a change is significant. With --publish the changed results become new versions
    in the archive.
    """

    def campaign() -> Campaign:
        from bench.campaign.reductions import Reductions

        return Reductions(archive, publish=publish)

    return _carried_out(campaign, **cluster)


def _carried_out(
    make: Callable[[], Campaign],
    *,
    out: Path | None,
    workers: int,
    twice: int,
    scheduler: str | None,
    tls_ca: Path | None,
    tls_cert: Path | None,
    tls_key: Path | None,
) -> int:
    from bench.campaign import carry_out, cluster, ledger
    from bench.campaign.program import digest_of, identity
    from bench.cli.shown_progress import Shown

    cluster.dask_distributed()
    files = cluster.TlsFiles(tls_ca, tls_cert, tls_key)
    if scheduler is not None:
        cluster.expect_secured(scheduler)
    campaign = make()
    folder = out or Path("campaigns-done") / campaign.name
    with ledger.opened(folder, digest_of(identity())) as kept, terminated_as_interrupted():
        if kept.others:
            remark(f"{folder}: {kept.others} results of other versions of the program are not used")
        try:
            if not all(map(kept.is_finished, campaign.tasks(kept.known))):
                connected = cluster.here(workers) if scheduler is None else cluster.at_scheduler(scheduler, files)
                with connected as client:
                    carry_out.carry_out(campaign, kept, client, Shown(), twice)
        except KeyboardInterrupt:
            remark(f"interrupted; what is done is in {folder}, and the same command goes on")
            return ABORTED
        return _shown(campaign, kept)


def _shown(campaign: Campaign, kept: Ledger) -> int:
    """Write the results, and what went wrong; return the exit code."""
    tasks = campaign.tasks(kept.known)
    failed = [result for task in tasks if (result := kept.known(task)) is not None and not result.is_finished]
    differing = kept.differing(tasks)
    say(*campaign.lines(kept.known, kept.folder))
    remark(
        *(
            f"{result.key}: failed on {result.worker or 'a worker'}: {result.problem}"
            for result in failed[:FAILURES_SHOWN]
        )
    )
    if failed:
        remark(f"{len(failed)} of {len(tasks)} tasks failed; the same command tries them again")
    for result in differing:
        remark(f"{result.key}: done twice, with different results; the second, of {result.worker}, is in {kept.folder}")
    return BENCH_ERROR if failed or differing else campaign.exit_code(kept.known)


CLUSTER = (
    option(
        "--out DIR", "Folder for results; the same command goes on there. [default: campaigns-done/KIND]", read=Path
    ),
    option("--workers N", "Processes of this computer, without --scheduler.", read=whole_number(1, 512), default=2),
    option(
        "--scheduler URL", "Scheduler of dask.distributed: tls://HOST:PORT; on this computer also tcp://127.0.0.1:PORT."
    ),
    option(
        "--tls-ca FILE",
        "Certificate of the authority of the cluster; default: that of dask's configuration.",
        read=Path,
    ),
    option("--tls-cert FILE", "Certificate of this client; default: that of dask's configuration.", read=Path),
    option("--tls-key FILE", "Private key of this client; default: that of dask's configuration.", read=Path),
    option("--twice N", "Do each N-th task two times, and compare; 0 for none.", read=whole_number(0), default=0),
)
COMMANDS = (
    Command("campaign faults", faults, (
        argument("SEQUENCE", "A sequence file, or the name of a shipped one."),
        option("--bench BENCH", "A bench file, or the name of a shipped one; all instruments are simulated.",
               is_required=True),
        option("--preset NAME", "A preset of the sequence."),
        options("--set NAME=VALUE", "A parameter of the sequence; repeatable.", to="settings"),
        option("--seeds N", "How many nights.", read=whole_number(1), default=100),
        option("--first SEED", "The first seed.", read=whole_number(0), default=1),
        *CLUSTER,
    )),
    Command("campaign reduce", reduce, (
        argument("ARCHIVE", "The archive: a folder, s3://BUCKET/PREFIX or azure://CONTAINER/PREFIX."),
        flag("--publish", "Changed results become new versions; the earlier ones can still be read."),
        *CLUSTER,
    )),
    Command("campaign truth", truth, (
        options("--part PART", "A part of make truth, units for the cells; repeatable; default: all.", to="part"),
        options("--method METHOD", "A method, such as M4a; repeatable; default: all.", to="method"),
        options("--unit KIND", "A kind of unit, such as 'as shipped'; repeatable; default: all.", to="unit"),
        options("--form FORM", "A form of the bench's errors, such as normal; repeatable; default: all.", to="form"),
        options("--level LEVEL", "records or wires; repeatable; default: both.", to="level"),
        option("--seeds N", "Seeds of a cell.", read=whole_number(1), default=40),
        option("--decide N", "Fresh seeds that decide a cell beyond its bars.", read=whole_number(0), default=0),
        option("--block N", "Seeds of one task at the level of records.", read=whole_number(1), default=40),
        flag("--figures", "Every quantity of each cell."),
        *CLUSTER,
    )),
    Command("campaign monte-carlo", monte_carlo, (
        options("--only TRIAL", "A trial, such as thresholds; repeatable; default: all.", to="only"),
        option("--draws N", "Draws of each trial.", read=whole_number(1), default=1500),
        *CLUSTER,
    )),
    Command("campaign wires", wires, (
        option("--trials N", "Readings over all dialects together.", read=whole_number(1), default=20000),
        *CLUSTER,
    )),
)  # fmt: skip
