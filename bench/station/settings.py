"""Settings of a station: `station.yaml`."""

from __future__ import annotations

import platform
import re
from collections.abc import Mapping
from datetime import timedelta
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BeforeValidator, Field, StringConstraints

from bench.client.address import default_folder
from bench.config.bench import LoadedBench, load_bench
from bench.config.devices import Text
from bench.config.load import find, load_file, shipped
from bench.errors import InputError
from bench.report.dcc import versions
from bench.station.alerts.settings import AlertsEntry, AlertSettings, read_alerts
from bench.station.mqtt.settings import MqttSettings, with_files
from bench.station.names import BENCH, WORD
from bench.station.signoff.key import KeyFiles, SignatureEntry, key_files
from drivers.schema.fields import NOT_EMPTY, StrictModel
from drivers.schema.suggest import did_you_mean

Name = Annotated[str, StringConstraints(pattern=f"^{BENCH}$")]
Launch = Literal["process", "service"]
DEMO = "demo"
WHERE = "station.json"  # file with the address at which the station answers


class BenchEntry(StrictModel):
    """Bench of a station."""

    title: Text = Field("", description="name on pages; without it the title of the bench file")
    file: str = Field(description="bench file: a path, relative to this file, or the name of a shipped one")


class CertificatesEntry(StrictModel):
    """Digital Calibration Certificates that a station issues."""

    version: versions.Name = Field(versions.DEFAULT, description="version of their schema")


def _as_entry(given: object) -> object:
    """Return the entry that true, or false, stands for."""
    return {True: {}, False: None}[given] if isinstance(given, bool) else given


class StationFile(StrictModel):
    """File `station.yaml`."""

    schema_: Literal["itb-station/1"] = Field(alias="schema", description="version of the file format")
    title: Text = Field("Bench station", description="name of the station on pages and in messages")
    benches: Annotated[Mapping[Name, BenchEntry], NOT_EMPTY] = Field(description="benches by name")
    runs: str = Field("runs", description="folder of run directories, relative to this file")
    laboratory: str = Field("", description="file lab.yaml of the laboratory, relative to this file, for certificates")
    signature: SignatureEntry | None = Field(None, description="key that signs approved reports; without it, none is")
    dcc: Annotated[CertificatesEntry | None, BeforeValidator(_as_entry)] = Field(
        None,
        description="true: with an approved report its Digital Calibration Certificate is issued; `{version: 3.3.0}`: "
        "in another version of the schema",
    )
    report_prefix: str = Field(
        "",
        pattern=r"^[A-Za-z0-9-]{0,20}$",
        description="first part of report numbers; default: the computer's name",
    )
    released_only: bool = Field(
        False, description="operators start only sequences and bench files that an engineer has released"
    )
    sequences: str = Field(
        "",
        description="folder of the laboratory's sequences, relative to this file; without it `sequences` in the folder "
        "of the station",
    )
    log_out_after_min: int = Field(0, ge=0, le=720, description="minutes without use until a session ends; 0 for 12 h")
    launch: Launch = Field("process", description="how a run starts: as a process, or as a service of systemd")
    archive: str = Field(
        "",
        description="archive to which runs go when they are approved: a folder, relative to this file, "
        "s3://BUCKET/PREFIX or azure://CONTAINER/PREFIX; without it they stay here only",
    )
    mqtt: MqttSettings | None = Field(None, description="broker to which the station publishes")
    alerts: AlertsEntry | None = Field(None, description="alerts to people; without it there are none")


class Settings(NamedTuple):
    """Settings of a station, with absolute paths; `benches` are bench files by name.

    `folder` holds the station's own records, `sequences` are those of the laboratory, if they are elsewhere. `dcc` is
    the version of the schema of Digital Calibration Certificates, "" if none are issued.
    """

    title: str
    folder: Path
    runs: Path
    benches: Mapping[str, Path]
    titles: Mapping[str, str]
    sequences: Path | None = None
    mqtt: MqttSettings | None = None
    laboratory: Path | None = None
    signature: KeyFiles | None = None
    dcc: str = ""
    report_prefix: str = "R"
    released_only: bool = False
    idle: timedelta | None = None
    launch: Launch = "process"
    zones: Mapping[str, str] = MappingProxyType({})  # time zones of the benches
    recorded: Mapping[str, str] = MappingProxyType({})  # titles of the benches in the records of runs
    alerts: AlertSettings | None = None
    archive: str = ""

    @property
    def zone(self) -> str:
        """Time zone of the station: that of its first bench."""
        return next(iter(self.zones.values()), "UTC")

    @property
    def alert_routes(self) -> tuple[str, ...]:
        """Routes that learn of the end of a run, as `BENCH=KEY`."""
        return self.alerts.for_the_night if self.alerts is not None else ()

    @property
    def own_sequences(self) -> Path:
        """Folder of the sequences of the laboratory; it may not exist yet."""
        return self.sequences if self.sequences is not None else self.folder / "sequences"

    def bench_file(self, name: str) -> Path:
        """Return the bench file of a name. Raises InputError."""
        if name not in self.benches:
            raise InputError(f"the station has no bench '{name}'; it has {', '.join(self.benches)}")
        return self.benches[name]

    def bench_of(self, file: str) -> str | None:
        """Return the name of the bench with a bench file; None for a file of somebody else."""
        return next((name for name, path in self.benches.items() if str(path) == file), None)

    def sequence_file(self, name: str) -> Path:
        """Return the file of a sequence: the laboratory's own, else a shipped one. Raises InputError."""
        if not re.fullmatch(WORD, name):
            raise InputError(f"'{name[:64]}' is no name of a sequence")
        folders = [self.own_sequences, *shipped("sequences")]
        found = next((file for folder in folders if (file := folder / f"{name}.yaml").is_file()), None)
        if found is None or "/" in name:
            known = sorted({file.stem for folder in folders for file in folder.glob("*.yaml")})
            raise InputError(f"the station has no sequence '{name}'{did_you_mean(name, known)}")
        return found

    def bench(self, name: str) -> LoadedBench:
        """Load the bench file of a name. Raises InputError."""
        return load_bench(self.bench_file(name))


def read_station(file: Path | None, folder: Path | None = None, **instead: Any) -> Settings:
    """Return the settings of a file; without one, a station with the shipped simulated bench. Raises InputError.

    `instead` replaces `runs`, `launch` or `benches`, a mapping of names to bench files.
    """
    folder = (folder or default_folder()).absolute()
    if file is None:
        benches = instead.get("benches") or {DEMO: "simulated"}
        entries = {name: BenchEntry(file=str(path)) for name, path in benches.items()}
        found = StationFile(schema="itb-station/1", benches=entries)
        beside = Path.cwd()
    else:
        found, beside = load_file(file, StationFile), file.absolute().parent
    benches = {name: _bench_file(entry.file, beside) for name, entry in found.benches.items()}
    loaded = {name: load_bench(path).bench for name, path in benches.items()}
    titles = {name: entry.title or loaded[name].title for name, entry in found.benches.items()}
    zones = {name: bench.site.time_zone for name, bench in loaded.items()}
    runs = (beside / (instead.get("runs") or found.runs)).absolute()
    alerts = read_alerts(found.alerts, beside, benches) if found.alerts is not None else None
    return Settings(
        found.title,
        folder,
        runs,
        benches,
        titles,
        sequences=(beside / found.sequences) if found.sequences else None,
        laboratory=(beside / found.laboratory) if found.laboratory else None,
        signature=key_files(found.signature, beside.absolute()) if found.signature is not None else None,
        dcc=found.dcc.version if found.dcc is not None else "",
        report_prefix=found.report_prefix or _own_prefix(),
        released_only=found.released_only,
        idle=timedelta(minutes=found.log_out_after_min) if found.log_out_after_min else None,
        launch=instead.get("launch") or found.launch,
        zones=zones,
        recorded={name: bench.title for name, bench in loaded.items()},
        alerts=alerts,
        archive=_place(found.archive, beside),
        mqtt=with_files(found.mqtt, beside.absolute()) if found.mqtt is not None else None,
    )


def _place(archive: str, beside: Path) -> str:
    """Return the place of an archive, a folder with its whole path."""
    return archive if not archive or "://" in archive else str(beside / archive)


def _own_prefix() -> str:
    """Return a prefix made from the name of this computer."""
    return re.sub(r"[^A-Za-z0-9]+", "-", platform.node()).strip("-")[:20] or "R"


def bench_name(file: str) -> str:
    """Return the name of a bench for its file: letters, digits and underscores of its stem."""
    name = re.sub(r"[^a-z0-9_]+", "_", Path(file).stem.lower())
    return name if re.fullmatch(BENCH, name) else f"bench_{name}"[:32]


def _bench_file(name: str, beside: Path) -> Path:
    beside_it = beside / name
    return (beside_it if beside_it.is_file() else find(name, "config")).absolute()
