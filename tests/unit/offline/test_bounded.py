"""Files that are too large, endless or no files are refused before they are read, wherever a name of one is given."""

import os
import resource
from pathlib import Path

import pytest

from bench.app.tracing import read_trace_file
from bench.config.bench import load_bench
from bench.config.document import SIZE_LIMIT_BYTES, read_document
from bench.errors import InputError, StoreError
from bench.offline.calibration_file import read_calibration
from bench.offline.case import reduce_case
from bench.offline.csv_record import SIZE_LIMIT_BYTES as TABLE_LIMIT_BYTES
from bench.offline.csv_record import read_table
from bench.store.decoder import Decoder
from bench.store.kept_json import TEXT, read_kept
from drivers.can.options import DBC_LIMIT_BYTES
from drivers.errors import CannotConnect
from drivers.transport.can import LOG_LIMIT_BYTES, read_log
from tests.support.runs import copy_bench
from tests.support.sequences import BENCH


def decoder_by(dbc: Path) -> Decoder:
    """Of the counter, as a run keeps its DBC."""
    entry = BENCH.devices["counter"]
    return Decoder(entry.model_copy(update={"options": entry.options.model_copy(update={"dbc": dbc})}))


READERS = {
    "sequence or bench file": (read_document, SIZE_LIMIT_BYTES),
    "case": (reduce_case, 2**20),
    "calibration": (read_calibration, 2**24),
    "record of a case": (lambda path: read_table(path, ["t_s"]), TABLE_LIMIT_BYTES),
    "trace": (read_trace_file, 2**30),
    "DBC of a run": (decoder_by, DBC_LIMIT_BYTES),
    "JSON of a run": (lambda path: read_kept(path, TEXT), 2**26),
    "log of a bus": (lambda path: read_log("counter", path), LOG_LIMIT_BYTES),
}
REFUSED = (InputError, StoreError, CannotConnect)


@pytest.fixture(autouse=True)
def little_memory():
    """Whatever reads all of a large file before it looks at its size does not get the memory for it."""
    before = resource.getrlimit(resource.RLIMIT_DATA)
    used = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_DATA, (used + 2**28, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_DATA, before)


@pytest.mark.parametrize("what", READERS)
def test_what_is_no_file_is_refused_at_once(tmp_path, what):
    read, _ = READERS[what]
    os.mkfifo(tmp_path / "pipe.asc")
    for path in (tmp_path / "pipe.asc", Path("/dev/zero"), tmp_path):
        with pytest.raises(REFUSED, match=r"is not a regular file|is a folder"):
            read(path)
    with pytest.raises(REFUSED, match="there is no such file"):
        read(tmp_path / "none")


@pytest.mark.parametrize("what", READERS)
def test_what_is_too_large_is_refused_before_it_is_read(tmp_path, what):
    read, limit_bytes = READERS[what]
    with (tmp_path / "large.asc").open("wb") as file:
        file.truncate(limit_bytes + 1)
    with pytest.raises(REFUSED, match=r"are read; is it the right file|larger than"):
        read(tmp_path / "large.asc")


def test_a_dbc_that_is_too_large_is_refused_with_its_place_in_the_bench_file(tmp_path):
    bench = copy_bench(tmp_path)
    with (tmp_path / "if_counter.dbc").open("ab") as file:
        file.truncate(122 * 10**6)
    with pytest.raises(
        InputError, match=r"simulated\.yaml:\d+:\d+: dbc: 'if_counter\.dbc' has 122000000 bytes, at most 1048576"
    ):
        load_bench(bench)
