"""Whether the record of a run is as it was written, and what that is known by.

A *sealed* run is known by the hashes of its files and the head of its chain. One that was interrupted is *unsealed*:
its chain tells up to which row it is intact. One from before there were chains is *unchained*.
"""

from __future__ import annotations

import contextlib
import hashlib
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from bench.errors import StoreError
from bench.store import database
from bench.store.chain import Link, Walked, beginning
from bench.store.kept_json import LIMIT_BYTES, read_kept
from bench.store.ledger import Noted, noted
from bench.store.manifest_form import MANIFEST_FORM
from bench.store.reader import RunReader, digest_of
from bench.store.runs import MANIFEST, SEAL, RunSummary, summary
from bench.store.seal import file_hash, read_seal, sealable
from bench.store.wal import unread_part
from drivers.schema.bounded import UnfitFileError, expect_bounded, read_bounded

Kind = Literal["running", "sealed", "unsealed", "unchained", "unreadable"]


@dataclass(frozen=True)
class Record:
    """What is known of the record of a run.

    `commits`, `rows` and `head` are of the part up to which everything is as written. `damage` is what is not as it was
    written; `remarks` are what a person may want to know beside.
    """

    folder: Path
    kind: Kind
    commits: int = 0
    rows: int = 0
    head: str = ""
    damage: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def in_words(self) -> str:
        """The answer in one line; without the damage in its parts."""
        if self.damage:
            intact = f"; intact up to row {self.rows} (commit {self.commits})" if self.rows else ""
            return f"DAMAGED{intact}"
        if self.kind == "sealed":
            return f"sealed, {self.rows} rows, head {self.head[:16]}"
        if self.kind == "unchained":
            return "unsealed, no chain (written by an earlier version); its manifest agrees"
        return f"intact up to row {self.rows} ({'under way' if self.kind == 'running' else 'unsealed'})"


def examine(folder: Path, *, thoroughly: bool = True) -> Record:
    """Examine a run directory; a sealed one by its files alone unless `thoroughly`, which reads every row and block."""
    found = summary(folder)
    if found.state == "running":
        return _chained(found, "running")
    try:
        with RunReader(folder) as reader:
            version = reader.format
    except StoreError as problem:
        return _unreadable(found, str(problem))
    if version == 1:
        return _unchained(found)
    if found.state != "interrupted" and (folder / SEAL).exists():
        return _sealed(found, thoroughly=thoroughly)
    record = _chained(found, "unsealed")
    return record if found.state == "interrupted" else _with(record, *_why_unsealed(folder))


def _unreadable(found: RunSummary, problem: str) -> Record:
    """A record whose database cannot be opened: what else is known of it."""
    folder = found.path
    files = _hashes(found)
    with contextlib.suppress(StoreError):
        files = read_seal(folder).files
    known = [problem, *_unread(folder)[0]]
    with contextlib.suppress(OSError):
        if ledger := list(noted(str(found.manifest.get("run", found.id)))):
            last = ledger[-1]
            known.append(f"the ledger has commit {last.number} with {last.rows} rows of this run, of {last.utc}")
        elif found.state == "interrupted":
            known.append("the ledger has no entry for this run: it may have been killed before its first commit")
    return Record(folder, "unreadable", damage=tuple(dict.fromkeys((*changed_files(folder, files), *known))))


def _why_unsealed(folder: Path) -> Iterator[str]:
    """What is wrong with the manifest of a run that is over and has no seal; that there is none, where it says so."""
    try:
        read_kept(folder / MANIFEST, MANIFEST_FORM)
    except StoreError as problem:
        yield str(problem)
    else:
        yield f"{folder / SEAL}: there is no such file"


def _sealed(found: RunSummary, *, thoroughly: bool) -> Record:
    """A sealed record: by its files, and where these have changed or it is asked for by its chain and digest."""
    folder = found.path
    try:
        seal = read_seal(folder)
    except StoreError as problem:
        return _with(_chained(found, "sealed"), str(problem))
    damage = list(changed_files(folder, seal.files))
    links: tuple[Link, ...] = ()
    intact = (seal.commits, seal.rows, seal.head)
    if thoroughly or any(database.FILE_NAME in each for each in damage):
        walked = _walked(folder)
        links = walked.links
        damage += walked.damage
        if not links or _end(links[-1]) != intact:
            damage.append(f"the chain does not end as the seal says, at commit {seal.commits}, row {seal.rows}")
        if walked.damage or not links:
            intact = _end(walked.intact)
        if thoroughly and not damage and seal.digest and digest_of(folder) != seal.digest:
            damage.append("the data have changed since they were sealed")
    told, remarks = _by_ledger(found, links, _seal_bytes(folder))
    remarks += _others(folder, seal.files, "seal")
    return Record(folder, "sealed", *intact, tuple(damage + told), tuple(remarks))


def _chained(found: RunSummary, kind: Kind) -> Record:
    """A record without a seal: by its chain, the manifest with which it began, and what the ledger has."""
    folder = found.path
    walked = _walked(folder)
    damage = list(walked.damage)
    is_first = found.state in ("running", "interrupted")  # another one is written at the end
    if is_first and walked.links and walked.links[0].head != beginning(folder / MANIFEST):
        damage.append(f"{folder / MANIFEST}: is not the one with which the run started")
    damage += changed_files(folder, _hashes(found))
    of_log, may_be = ([], []) if kind == "running" else _unread(folder)
    told, remarks = _by_ledger(found, walked.links, _seal_bytes(folder))
    if found.state == "interrupted":
        remarks += _others(folder, {*_hashes(found), database.FILE_NAME, MANIFEST}, "chain")
    return Record(folder, kind, *_end(walked.intact), tuple(damage + of_log + told), tuple(may_be + remarks))


def _others(folder: Path, known: Collection[str], by: str) -> list[str]:
    """Remarks on files that a record does not cover: of other people, or written after its last commit."""
    return [f"not covered by the {by}: {name}" for name in sealable(folder) if name not in known]


def _unread(folder: Path) -> tuple[list[str], list[str]]:
    """Damage to the log beside the database, and what may be damage or a power cut."""
    log = folder / f"{database.FILE_NAME}-wal"
    try:
        unread = unread_part(log)
    except OSError as problem:
        return [f"{log}: cannot be read ({problem})"], []
    if unread is None:
        return [], []
    told = [f"{log}: {unread.in_words}"]
    return (told, []) if unread.damage else ([], told)


def _seal_bytes(folder: Path) -> bytes:
    """The seal as it stands on the disk; empty where it is no file that can be read."""
    try:
        return read_bounded(folder / SEAL, LIMIT_BYTES)
    except UnfitFileError:
        return b""


def _with(record: Record, *damage: str) -> Record:
    return replace(record, damage=(*record.damage, *damage))


def _end(link: Link | None) -> tuple[int, int, str]:
    """Commits, rows and head up to a link."""
    return (0, 0, "") if link is None else (link.number, link.total, link.head.hex())


def _walked(folder: Path) -> Walked:
    try:
        with RunReader(folder) as reader:
            if reader.passes_over_a_log():
                return Walked((), None, (f"{database.FILE_NAME}: does not match the log beside it",))
            return reader.walked()
    except StoreError as problem:
        return Walked((), None, (str(problem),))


def _hashes(found: RunSummary) -> Mapping[str, str]:
    hashes: Mapping[str, str] = found.manifest.get("hashes", {})
    return hashes


def changed_files(folder: Path, hashes: Mapping[str, str]) -> Iterator[str]:
    """The files whose hashes are others."""
    for name, expected in hashes.items():
        path = folder / name
        try:
            expect_bounded(path, sys.maxsize)
            if file_hash(path) != expected:
                yield f"{path}: has changed since it was written"
        except UnfitFileError as problem:
            yield f"{path}: {problem}"
        except (OSError, ValueError) as problem:
            yield f"{path}: cannot be read ({problem})"


def _by_ledger(found: RunSummary, links: Sequence[Link], seal: bytes) -> tuple[list[str], list[str]]:
    """What contradicts the ledger, and remarks on it. Without links only the seal is looked at."""
    try:
        ledger = list(noted(str(found.manifest.get("run", found.id))))
    except OSError as problem:
        return [], [f"the ledger of this computer cannot be read ({problem})"]
    if not ledger:
        return [], ["the ledger of this computer has no entry for this run"]
    began = links[0].head.hex() if links else ""
    ledger = [each for each in ledger if each.beginning == began] or ledger  # runs elsewhere may have its name
    seals = {each.seal for each in ledger if each.seal}
    if seals and hashlib.sha256(seal).hexdigest() not in seals:
        return [
            f"{found.path / SEAL}: is not the one in the ledger"
            if seal
            else f"{found.path / SEAL}: the ledger has a seal of this run, but there is no readable seal here"
        ], []
    if not links:
        return [], []
    own = [each for each in ledger if each.beginning == links[0].head.hex()]
    if not own:
        return ["the ledger has a run of this name that began with another manifest"], []
    return list(_contradictions(own, links)), []


def _contradictions(ledger: Sequence[Noted], links: Sequence[Link]) -> Iterator[str]:
    last = ledger[-1]
    if last.number >= len(links):
        yield (
            f"rows are missing at the end: the ledger has commit {last.number} with {last.rows} rows in all, of "
            f"{last.utc}; here are {len(links) - 1} commits with {links[-1].total}"
        )
    if other := [each for each in ledger if each.number < len(links) and links[each.number].head.hex() != each.head]:
        yield f"commit {other[0].number} is not the one in the ledger, of {other[0].utc}"


def _unchained(found: RunSummary) -> Record:
    """A record from before there were chains: by the hashes and the digest in its manifest, if it got one."""
    damage = list(changed_files(found.path, _hashes(found)))
    if not found.manifest:
        damage.append(f"{found.path / MANIFEST}: cannot be read")
    try:
        digest = digest_of(found.path)
        if digest != found.manifest.get("digest", digest):
            damage.append(f"{found.path}: the data are not those that the manifest was written for")
    except StoreError as problem:
        damage.append(str(problem))
    return Record(found.path, "unchained", damage=tuple(damage))
