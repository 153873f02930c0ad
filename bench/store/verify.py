"""Verification of the record of a run.

A *sealed* run is verified by the hashes of its files and the head of its chain. An interrupted one is *unsealed*: its
chain shows up to which row it is intact. A run older than the chain is *unchained*.
"""

from __future__ import annotations

import contextlib
import hashlib
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from bench.errors import StoreError
from bench.store import database
from bench.store.chain import ChainCheck, Link, beginning
from bench.store.kept_json import LIMIT_BYTES, read_kept
from bench.store.ledger import LedgerEntry, entries_of
from bench.store.manifest_form import MANIFEST_FORM
from bench.store.reader import RunReader, digest_of
from bench.store.runs import MANIFEST, SEAL, RunSummary, summary
from bench.store.seal import file_hash, read_seal, sealable
from bench.store.wal import unreadable_part
from drivers.schema.bounded import UnfitFileError, expect_bounded, read_bounded

Kind = Literal["running", "sealed", "unsealed", "unchained", "unreadable"]


class Record(NamedTuple):
    """Result of verifying the record of a run.

    `commits`, `rows` and `head` are those of the intact part. `damage` lists the parts that have changed since they
    were written; `remarks` are further notes for a person.
    """

    folder: Path
    kind: Kind
    commits: int = 0
    rows: int = 0
    head: str = ""
    damage: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def with_damage(self, *damage: str) -> Record:
        """Return the result with more damage."""
        return self._replace(damage=(*self.damage, *damage))

    @property
    def in_words(self) -> str:
        """Summary in one line, without the list of damage."""
        if self.damage:
            intact = f"; intact up to row {self.rows} (commit {self.commits})" if self.rows else ""
            return f"DAMAGED{intact}"
        if self.kind == "sealed":
            return f"sealed, {self.rows} rows, head {self.head[:16]}"
        if self.kind == "unchained":
            return "unsealed, no chain (written by an earlier version); its manifest agrees"
        return f"intact up to row {self.rows} ({'under way' if self.kind == 'running' else 'unsealed'})"


def examine(folder: Path, *, thoroughly: bool = True) -> Record:
    """Verify a run directory; with `thoroughly`, every row and block of a sealed one, otherwise its files only."""
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
    return record if found.state == "interrupted" else record.with_damage(*_why_unsealed(folder))


def _unreadable(found: RunSummary, problem: str) -> Record:
    """Return the record of a run whose database cannot be opened, with the entries of the ledger."""
    folder = found.path
    files = _hashes(found)
    with contextlib.suppress(StoreError):
        files = read_seal(folder).files
    known = [problem, *_unread(folder)[0]]
    with contextlib.suppress(OSError):
        if ledger := list(entries_of(str(found.manifest.get("run", found.id)))):
            last = ledger[-1]
            known.append(f"the ledger has commit {last.number} with {last.rows} rows of this run, of {last.utc}")
        elif found.state == "interrupted":
            known.append("the ledger has no entry for this run: it may have been killed before its first commit")
    return Record(folder, "unreadable", damage=tuple(dict.fromkeys((*changed_files(folder, files), *known))))


def _why_unsealed(folder: Path) -> Iterator[str]:
    """Yield the defect of the manifest of a finished run without seal, or the missing seal that it refers to."""
    try:
        read_kept(folder / MANIFEST, MANIFEST_FORM)
    except StoreError as problem:
        yield str(problem)
    else:
        yield f"{folder / SEAL}: there is no such file"


def _sealed(found: RunSummary, *, thoroughly: bool) -> Record:
    """Verify a sealed record by its files; if these have changed, or on request, also by chain and digest."""
    folder = found.path
    try:
        seal = read_seal(folder)
    except StoreError as problem:
        return _chained(found, "sealed").with_damage(str(problem))
    damage = list(changed_files(folder, seal.files))
    links: tuple[Link, ...] = ()
    intact = (seal.commits, seal.rows, seal.head)
    if thoroughly or any(database.FILE_NAME in each for each in damage):
        chain = _check_chain(folder)
        links = chain.links
        damage += chain.damage
        if not links or _end(links[-1]) != intact:
            damage.append(f"the chain does not end as the seal says, at commit {seal.commits}, row {seal.rows}")
        if chain.damage or not links:
            intact = _end(chain.intact)
        if thoroughly and not damage and seal.digest and digest_of(folder) != seal.digest:
            damage.append("the data have changed since they were sealed")
    contradictions, remarks = _by_ledger(found, links, _seal_bytes(folder))
    remarks += _others(folder, seal.files, "seal")
    return Record(folder, "sealed", *intact, tuple(damage + contradictions), tuple(remarks))


def _chained(found: RunSummary, kind: Kind) -> Record:
    """Verify a record without seal by its chain, its first manifest and the ledger."""
    folder = found.path
    chain = _check_chain(folder)
    damage = list(chain.damage)
    is_first = found.state in ("running", "interrupted")  # the manifest is replaced at the end of the run
    if is_first and chain.links and chain.links[0].head != beginning(folder / MANIFEST):
        damage.append(f"{folder / MANIFEST}: is not the one with which the run started")
    damage += changed_files(folder, _hashes(found))
    of_log, may_be = ([], []) if kind == "running" else _unread(folder)
    contradictions, remarks = _by_ledger(found, chain.links, _seal_bytes(folder))
    if found.state == "interrupted":
        remarks += _others(folder, {*_hashes(found), database.FILE_NAME, MANIFEST}, "chain")
    return Record(folder, kind, *_end(chain.intact), tuple(damage + of_log + contradictions), tuple(may_be + remarks))


def _others(folder: Path, known: Collection[str], by: str) -> list[str]:
    """Return remarks on files that the record does not cover: added by others, or written after the last commit."""
    return [f"not covered by the {by}: {name}" for name in sealable(folder) if name not in known]


def _unread(folder: Path) -> tuple[list[str], list[str]]:
    """Return the damage of the log beside the database, and remarks on what damage or a power cut can explain."""
    log = folder / database.LOG_NAME
    try:
        unread = unreadable_part(log)
    except OSError as problem:
        return [f"{log}: cannot be read ({problem})"], []
    if unread is None:
        return [], []
    finding = [f"{log}: {unread.in_words}"]
    return (finding, []) if unread.damage else ([], finding)


def _seal_bytes(folder: Path) -> bytes:
    """Return the bytes of the seal file; empty if it cannot be read."""
    try:
        return read_bounded(folder / SEAL, LIMIT_BYTES)
    except UnfitFileError:
        return b""


def _end(link: Link | None) -> tuple[int, int, str]:
    """Return commits, rows and head up to a link."""
    return (0, 0, "") if link is None else (link.number, link.total, link.head.hex())


def _check_chain(folder: Path) -> ChainCheck:
    try:
        with RunReader(folder) as reader:
            if reader.ignores_log():
                return ChainCheck((), None, (f"{database.FILE_NAME}: does not match the log beside it",))
            return reader.check_chain()
    except StoreError as problem:
        return ChainCheck((), None, (str(problem),))


def _hashes(found: RunSummary) -> Mapping[str, str]:
    hashes: Mapping[str, str] = found.manifest.get("hashes", {})
    return hashes


def changed_files(folder: Path, hashes: Mapping[str, str]) -> Iterator[str]:
    """Yield a description of each file that has changed, is missing or cannot be read."""
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
    """Return the contradictions with the ledger, and remarks on it. Without links only the seal is compared."""
    try:
        ledger = list(entries_of(str(found.manifest.get("run", found.id))))
    except OSError as problem:
        return [], [f"the ledger of this computer cannot be read ({problem})"]
    if not ledger:
        return [], ["the ledger of this computer has no entry for this run"]
    began = links[0].head.hex() if links else ""
    ledger = [each for each in ledger if each.beginning == began] or ledger  # a run elsewhere may have its name
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


def _contradictions(ledger: Sequence[LedgerEntry], links: Sequence[Link]) -> Iterator[str]:
    last = ledger[-1]
    if last.number >= len(links):
        yield (
            f"rows are missing at the end: the ledger has commit {last.number} with {last.rows} rows in all, of "
            f"{last.utc}; here are {len(links) - 1} commits with {links[-1].total}"
        )
    if other := [each for each in ledger if each.number < len(links) and links[each.number].head.hex() != each.head]:
        yield f"commit {other[0].number} is not the one in the ledger, of {other[0].utc}"


def _unchained(found: RunSummary) -> Record:
    """Verify a record older than the chain by the hashes and the digest in its manifest, if it has them."""
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
