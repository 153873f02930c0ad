"""Cells of the campaign on altered units: a method, a kind of unit, and a form of the bench's errors.

A cell is run seed by seed, at the level of records or through all wires. What each seed found is a line of a file of
the cell, so that a campaign that was stopped goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import traceback
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from multiprocessing import Pool
from pathlib import Path

from bench.app.request import RunRequest
from bench.config.bench import load_bench
from campaigns.truth import (
    campaign,
    channel,
    coefficients,
    imu,
    imu_start_up,
    indexing,
    ladder,
    ramp,
    repeatability,
    table,
    verified,
    verified_pair,
)
from campaigns.truth.altered import alter_file
from campaigns.truth.campaign import ROOT, Comparison, full_bench, results_of, run_one
from campaigns.truth.foreign import bench_errors
from campaigns.truth.replay import Template, replayed, template_of

Compare = Callable[[dict, dict], Iterable[Comparison]]
ACCELEROMETERS = ("as shipped", "negative scale", "hysteresis", "misaligned", "warm", "noisy", "nonlinear")
GYROS = ("as shipped", "negative scale", "g-sensitive", "misaligned", "warm", "noisy", "nonlinear")
RECORDS, WIRES = "records", "wires"


def _tumble(truth: dict, results: dict) -> list[Comparison]:
    return campaign.compared(truth, results) + coefficients.compared(truth, results)


def _channel(truth: dict, results: dict) -> Iterable[Comparison]:
    return channel.compared(truth, results).values()


def _channel_in(folder: Path) -> Iterable[Comparison]:
    return channel.compare_channel(folder).values()


@dataclass(frozen=True)
class Method:
    """A method as the campaign runs it. Without `compare` its truth needs more than its files: wires alone.

    One that verifies a calibration has `compare_with`, which gets it as well; the sequence `calibrated_by` finds it.
    """

    name: str
    sequence: str
    bench: str
    unit: str
    kinds: Sequence[str]
    compare: Compare | None
    settings: tuple[str, ...] = ()
    of_folder: Callable[[Path], Iterable[Comparison]] | None = None
    calibration: Path | None = None
    preset: str | None = "quick"
    on_bench: str = ""  # the unit that the bench file names, in place of which it is
    compare_with: Callable[[dict, dict, dict], Iterable[Comparison]] | None = None
    calibrated_by: str = ""
    units: tuple[str, ...] = ()  # by place, of a bench with several

    @property
    def at_records(self) -> bool:
        """True if it can be run at the level of records."""
        return self.compare is not None or self.compare_with is not None

    def found(self, truth: dict, results: dict, known: dict | None = None) -> list[Comparison]:
        """All that has a truth, beside it; `known` is the calibration that was verified."""
        if self.compare_with is not None and known is not None:
            return list(self.compare_with(truth, results, known))
        assert self.compare is not None
        return list(self.compare(truth, results))

    def found_in(self, folder: Path) -> list[Comparison]:
        """The same of a run in a folder."""
        if self.of_folder is not None:
            return list(self.of_folder(folder))
        known = verified.known_of(folder) if self.compare_with is not None else None
        return self.found(json.loads((folder / "truth.json").read_text("utf-8")), results_of(folder), known)


LONG_ON = ("warm_up=40 min",)  # so that the unit is as warm as it becomes
METHODS = {
    method.name: method
    for method in (
        Method("M4a", "tumble_static", "simulated", "quartz_flexure", ACCELEROMETERS, _tumble),
        Method("M4a clocked", "tumble_clocked", "simulated", "quartz_flexure", ACCELEROMETERS, campaign.compared,
               ("steady_within=9 µg",)),
        Method("M4b", "ramp_dynamic", "simulated", "quartz_flexure", ACCELEROMETERS, ramp.compared),
        Method("M4a verified", "verify_compensation", "simulated", "quartz_flexure", ACCELEROMETERS, None,
               compare_with=verified.compare_tumble, calibrated_by="tumble_static"),
        Method("M4b verified", "verify_on_ramp", "simulated", "quartz_flexure", ACCELEROMETERS, None,
               ("low=-20 °C", "high=50 °C"), compare_with=verified.compare_ramp, calibrated_by="ramp_dynamic"),
        Method("M4a pair", "verify_compensation", "three_units", "quartz_flexure", ("as shipped", "hysteresis"), None,
               compare_with=verified_pair.compare_tumble, calibrated_by="tumble_static", units=("a=UA", "b=UB")),
        Method("M4b pair", "verify_on_ramp", "three_units", "quartz_flexure", ("as shipped", "hysteresis"), None,
               ("low=-20 °C", "high=50 °C"), compare_with=verified_pair.compare_ramp, calibrated_by="tumble_static",
               units=("a=UA", "b=UB")),
        Method("M4b pair dynamic", "verify_on_ramp", "three_units", "quartz_flexure", ("as shipped", "hysteresis"),
               None,
               ("low=-20 °C", "high=50 °C"), compare_with=verified_pair.compare_ramp, calibrated_by="ramp_dynamic",
               units=("a=UA", "b=UB")),
        Method("M4d", "threshold_resolution", "simulated", "dead_band", ACCELEROMETERS, ladder.compared,
               on_bench="quartz_flexure"),
        Method("repeatability", "repeatability", "simulated", "quartz_flexure", ACCELEROMETERS, repeatability.compared,
               ("repetitions=6", "steady_within=9 µg", "gate=30 s"), preset=None),
        Method("M0", "channel_full", "channel", "if_channel", ACCELEROMETERS, _channel),
        Method("M0 volts", "channel_full", "channel_volts", "volts_channel", ACCELEROMETERS, None,
               of_folder=_channel_in),
        Method("M0 codes", "channel_full", "channel_telemetry", "digital_channel", ACCELEROMETERS, None,
               of_folder=_channel_in),
        Method("M0 inertial", "channel_imu", "channel_imu", "imu_channels", ACCELEROMETERS, _channel),
        Method("M1", "indexing_static", "indexing_pulses", "micro_g", ACCELEROMETERS, indexing.compared,
               ("largest=0.4°", "step=0.2°")),  # where none saturates
        Method("M1 sides", "indexing_static", "indexing_pulses", "micro_g", ACCELEROMETERS, indexing.compared,
               ("largest=0.4°", "step=0.1°", "sides=yes")),
        Method("M1 axes", "indexing_three_axes", "indexing_three_axes", "micro_g",
               ("as shipped", "negative scale", "misaligned", "nonlinear"), indexing.compared,
               ("largest=0.4°", "step=0.1°")),
        Method("M2", "imu_24_position", "imu", "imu", ACCELEROMETERS, imu.compared),
        Method("M2 start-up", "imu_start_up", "imu", "imu", ACCELEROMETERS, None,
               of_folder=imu_start_up.compare_start_up, calibration=imu_start_up.CALIBRATION),
        Method("M3a", "gyro_range", "gyro", "rate_gyro", GYROS, table.compared, LONG_ON),
        Method("M3b", "gyro_response", "gyro", "rate_gyro", (*GYROS, "slow"), table.compared, LONG_ON),
        Method("M3b sweep", "gyro_sweep", "gyro", "rate_gyro", (*GYROS, "slow"), table.compared, LONG_ON),
        Method("M3c", "accel_range", "centrifuge", "response_60hz", ACCELEROMETERS, table.compared, LONG_ON),
        Method("M3d", "accel_response", "response", "response_60hz", (*ACCELEROMETERS, "slow"), table.compared,
               LONG_ON),
        Method("M3d sweep", "accel_sweep", "response", "response_60hz", (*ACCELEROMETERS, "slow"), table.compared,
               LONG_ON),
    )
}  # fmt: skip


@dataclass(frozen=True)
class Cell:
    """One combination of method, bench and unit that is run with many seeds."""

    method: str
    kind: str
    form: str = "normal"
    level: str = RECORDS

    @property
    def name(self) -> str:
        """Its name, and that of its file."""
        return ".".join((self.method, self.kind, self.form, self.level)).replace(" ", "_")

    def seeds(self, count: int, begin: int = 0) -> range:
        """So many seeds, which no other cell has; with another begin they are fresh."""
        first = 1 + begin + 10_000 * (zlib.crc32(self.name.encode()) % 100_000)
        return range(first, first + count)

    def request(self, folder: Path, seed: int) -> RunRequest:
        """A run of it, on a bench in a folder of its own."""
        method, config = METHODS[self.method], folder / self.name / "config"
        bench, stated = config / f"{method.bench}.yaml", config / "sequence.yaml"
        if not bench.exists():
            self._prepare(method, bench, stated)
        given = () if method.calibration is None else (str(method.calibration),)
        given += tuple(f"{place}={file}" for place, file in self.calibrations(folder).items())
        return RunRequest(
            str(stated) if stated.exists() else method.sequence, bench=str(bench), preset=method.preset, seed=seed,
            settings=method.settings, runs=folder / self.name / "runs", calibrations=given, units=method.units,
        )  # fmt: skip

    def calibrations(self, folder: Path) -> dict[str, Path]:
        """The calibrations that it verifies by place, of the same units on the same bench, with other errors."""
        method, config = METHODS[self.method], folder / self.name / "config"
        if not method.calibrated_by:
            return {}
        bench = config / f"{method.bench}.yaml"
        return verified.calibrate(method.calibrated_by, bench, folder / self.name, method.units)

    def _prepare(self, method: Method, bench: Path, stated: Path) -> None:
        units = bench.parent / "uut"
        full_bench(bench.parent, method.bench)
        unit = units / f"{method.on_bench or method.unit}.yaml"
        if method.on_bench:
            shutil.copy(units / f"{method.unit}.yaml", unit)
            ladder.draw_dead_band(unit)
        if method.name == "repeatability":
            repeatability.scatter(bench, unit)
        if method.name in ("M4b", "M4b verified") or method.units:
            ramp.draw_misalignments(bench.parent)
        alter_file(unit, self.kind)
        if self.kind == "negative scale":
            _state_negative(bench, stated, method.sequence)
        if (known := STATED.get((self.kind, method.name))) is not None:
            _state(stated, method.sequence, *known)


def _state_negative(bench: Path, stated: Path, sequence: str) -> None:
    """Let a bench file, and the settings of a range or a response, say that the output falls while the input rises."""
    bench.write_text(re.sub(r"\b(K1|output): (?=\d)", r"\1: -", bench.read_text("utf-8")), "utf-8")
    text, count = re.subn(
        r"(?<=scale: \[)[^]]*", lambda list_: re.sub(r"\b(?=\d+ )", "-", list_[0]),
        (ROOT / "sequences" / f"{sequence}.yaml").read_text("utf-8"),
    )  # fmt: skip
    if count:
        stated.write_text(text, "utf-8")


# What no run finds of a unit, and its user states: a setting of the sequence, and what stands in its place.
STATED = {
    ("warm", "M3a"): (r"(?m)^( *)scale: .*$", r"\g<0>\n\g<1>scale_per_degree_u: 300 ppm/°C"),
    ("warm", "repeatability"): (r"(?<=bias_per_degree_u: )10", "50"),
    ("warm", "M4a clocked"): (
        r"bias_per_degree_u: 10 µg/°C, scale_per_degree_u: 60",
        "bias_per_degree_u: 50 µg/°C, scale_per_degree_u: 120",
    ),
    ("warm", "M0"): (r"(?m)^( *)accelerometer: 65 °C.*$", r"\g<0>\n\g<1>accelerometer_drift_u: 166 ppm/°C"),
    ("warm", "M0 inertial"): (r"(?m)^( *)accelerometer: 65 °C.*$", r"\g<0>\n\g<1>accelerometer_drift_u: 166 ppm/°C"),
    ("nonlinear", "M3c"): (r"(?<=scale_u: )100 ppm", "450 ppm"),  # K2 and asymmetry, at the low rates
    ("misaligned", "M4b"): (r"(?<=misalignment_u: )1 mrad", "4 mrad"),
}


def _state(stated: Path, sequence: str, old: str, new: str) -> None:
    """Write a sequence, with those that it calls beside it, in which something else is stated."""
    text = (ROOT / "sequences" / f"{sequence}.yaml").read_text("utf-8")
    changed, count = re.subn(old, new, text)
    assert count, sequence
    for called in set(re.findall(r"(?m)^ *- call: (\w+\.yaml)", changed)):
        shutil.copy(ROOT / "sequences" / called, stated.parent)
    stated.write_text(changed, "utf-8")


@dataclass(frozen=True)
class Line:
    """Results of one seed of a cell, by quantity and point, or the reason for none."""

    seed: int
    found: tuple[Comparison, ...] = ()
    problem: str = ""

    def to_json(self) -> str:
        """As it stands in the file of the cell."""
        rows = [[e.quantity, e.dwell, e.value, e.truth, e.u, e.k, *e.interval] for e in self.found]
        return json.dumps({"seed": self.seed, "problem": self.problem, "found": rows})

    @classmethod
    def of_json(cls, text: str) -> Line:
        """A line of the file."""
        raw = json.loads(text)
        found = tuple(
            Comparison(raw["seed"], point, quantity, value, truth, u, (low, high), k)
            for quantity, point, value, truth, u, k, low, high in raw["found"]
        )
        return cls(raw["seed"], found, raw["problem"])


def kept() -> Path:
    """Folder of results, separate for each state of the program, so that a rerun mixes no two of them."""
    digest = hashlib.sha256()
    for part in ("bench", "drivers", "simulators", "config", "sequences", "campaigns/truth"):
        for path in sorted(path for path in (ROOT / part).rglob("*") if path.suffix in (".py", ".yaml", ".dbc")):
            digest.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return ROOT / "build" / "truth" / digest.hexdigest()[:12]


def known(cell: Cell, records: Path) -> list[Line]:
    """Earlier results of a cell; an incomplete last line of an interrupted campaign is ignored."""
    path = records / f"{cell.name}.jsonl"
    if not path.exists():
        return []
    complete = path.read_text("utf-8").rpartition("\n")[0]
    lines = (Line.of_json(each) for each in complete.splitlines() if each.endswith("}"))
    return list({line.seed: line for line in lines}.values())


def run(cell: Cell, seeds: Sequence[int], folder: Path, records: Path, processes: int = 1) -> list[Line]:
    """The lines of a cell for these seeds; those that are not known yet are run and appended to its file."""
    before = known(cell, records)
    missing = sorted(set(seeds) - {line.seed for line in before})
    if missing:
        records.mkdir(parents=True, exist_ok=True)
        path = records / f"{cell.name}.jsonl"
        path.write_text("".join(line.to_json() + "\n" for line in before), "utf-8")
        with path.open("a", encoding="utf-8") as file:
            for line in lines_of(cell, missing, folder, processes):
                file.write(line.to_json() + "\n")
                file.flush()
    return [line for line in known(cell, records) if line.seed in set(seeds)]


def lines_of(cell: Cell, seeds: Sequence[int], folder: Path, processes: int = 1) -> Iterator[Line]:
    """Run a cell with these seeds, each to a line."""
    work: Callable[[int], Line] = partial(_line, partial(_through_wires, cell, folder))
    if cell.level == RECORDS:
        try:
            template = _template(replace(cell, form="normal"), folder)
        except Exception as problem:  # noqa: BLE001 - that a unit comes to no result is what the campaign has to tell
            yield from (Line(seed, problem=_told(problem)) for seed in seeds)
            return
        cell.request(folder, 0)  # its files are there before several processes ask for them
        work = partial(_line, partial(_of_records, cell, folder, template))
    if processes == 1:
        yield from map(work, seeds)
        return
    with Pool(processes, maxtasksperchild=20) as pool:
        yield from pool.imap(work, seeds)


@lru_cache(maxsize=1)  # cells that differ in the form of the errors follow each other
def _template(cell: Cell, folder: Path) -> Template:
    return template_of(cell.request(folder, 0))


def _line(found: Callable[[int], Iterable[Comparison]], seed: int) -> Line:
    try:
        return Line(seed, tuple(found(seed)))
    except Exception as problem:  # noqa: BLE001 - that a unit comes to no result is what the campaign has to tell
        return Line(seed, problem=_told(problem))


def _of_records(cell: Cell, folder: Path, template: Template, seed: int) -> list[Comparison]:
    bench = load_bench(Path(str(cell.request(folder, seed).bench))).bench
    run = replayed(template, bench, seed, form=cell.form)
    method = METHODS[cell.method]
    files = cell.calibrations(folder)
    known = {place: json.loads(file.read_text("utf-8")) for place, file in files.items()}
    return method.found(run.truth, run.results, known)


def _through_wires(cell: Cell, folder: Path, seed: int) -> list[Comparison]:
    with bench_errors(cell.form):
        path = run_one(cell.request(folder, seed))
    return METHODS[cell.method].found_in(path)


def _told(problem: Exception) -> str:
    """Exception and line of our code."""
    last = next((e for e in reversed(traceback.extract_tb(problem.__traceback__)) if str(ROOT) in e.filename), None)
    where = f" ({Path(last.filename).name}:{last.lineno})" if last else ""
    return f"{type(problem).__name__}: {problem}{where}"[:500]
