"""What other programs read of a run, held against its CSV files."""

import csv
import itertools
import json
import re
import sys

import h5py
import numpy as np
import pyarrow.parquet
import pytest
from scipy.io import loadmat

from bench.errors import InputError
from bench.reduce.stored_run import open_run
from bench.report.export.export import FORMATS

COUNTERS = ("sequence", "tick", "positive", "negative")


@pytest.fixture(scope="module")
def run(shared_runs):
    """Three dwells in two rounds of temperature; several acquisitions by three channels."""
    return shared_runs.tumble()


@pytest.fixture(scope="module")
def tables(run, tmp_path_factory):
    """The rows of the CSV files, as text."""
    found = {}
    for path in exported(run, "csv", tmp_path_factory.mktemp("csv")):
        with path.open(encoding="utf-8", newline="") as file:
            found[path.stem] = list(csv.DictReader(file))
    assert all(found.values())
    units = {(row["table"], row["column"]): row["unit"] for row in found.pop("columns")}
    assert {name: units["acquisitions", name] for name in found["acquisitions"][0]} == {
        **dict.fromkeys(("step", "channel", "sequence"), ""), **dict.fromkeys(("positive", "negative"), "pulse"),
        "tick": "tick", "tick_period_s": "s",
    }  # fmt: skip
    assert {float(row["tick_period_s"]) for row in found["acquisitions"]} == {1e-6}
    return found


def exported(run, form, folder):
    with open_run(run.path) as stored:
        return FORMATS[form](stored, folder)


def as_csv(name, value):
    """A value as the CSV file writes it."""
    return f"{value:.6f}" if name == "t_s" else repr(value) if isinstance(value, float) else str(value)


def parts_of(rows, *names):
    """Consecutive rows that have these columns in common."""
    return [list(part) for _, part in itertools.groupby(rows, key=lambda row: [row[name] for name in names])]


@pytest.mark.lengthy
def test_parquet_holds_the_same_and_its_counters_as_differences(run, tables, tmp_path):
    paths = exported(run, "parquet", tmp_path)
    assert [path.name for path in paths] == ["readings.parquet", "acquisitions.parquet", "journal.parquet"]
    for path in paths:
        table = pyarrow.parquet.read_table(path)
        rows = [{name: as_csv(name, value) for name, value in row.items()} for row in table.to_pylist()]
        assert rows == tables[path.stem]
    metadata = pyarrow.parquet.read_metadata(paths[1])
    columns = {
        column.path_in_schema: column.encodings
        for column in map(metadata.row_group(0).column, range(metadata.num_columns))
    }
    assert all("DELTA_BINARY_PACKED" in columns[name] for name in COUNTERS)
    assert all("RLE_DICTIONARY" in columns[name] for name in ("step", "channel"))
    schema = pyarrow.parquet.read_schema(paths[1])
    assert schema.field("positive").metadata[b"unit"] == b"pulse"


def test_parquet_is_written_a_group_of_rows_at_a_time(run, tables, tmp_path, monkeypatch):
    monkeypatch.setattr("bench.report.export.parquet.ROWS_OF_GROUP", 1000)
    for path in exported(run, "parquet", tmp_path):
        metadata = pyarrow.parquet.read_metadata(path)
        groups = [metadata.row_group(index).num_rows for index in range(metadata.num_row_groups)]
        assert sum(groups) == len(tables[path.stem])
        assert max(groups) <= 1000


def test_matlab_gets_struct_arrays_with_the_same_values(run, tables, tmp_path):
    (path,) = exported(run, "matlab", tmp_path)
    content = loadmat(path, squeeze_me=True, chars_as_strings=True)
    parts = parts_of(tables["acquisitions"], "step", "channel")
    assert len(content["acquisitions"]) == len(parts)
    for struct, rows in zip(content["acquisitions"], parts, strict=True):
        assert (struct["step"], struct["channel"]) == (rows[0]["step"], rows[0]["channel"])
        for name in COUNTERS:
            assert struct[name].tolist() == [int(row[name]) for row in rows]
    for struct, rows in zip(content["readings"], parts_of(tables["readings"], "name"), strict=True):
        assert (struct["name"], struct["unit"]) == (rows[0]["name"], rows[0]["unit"])
        assert [f"{at_s:.6f}" for at_s in struct["t_s"]] == [row["t_s"] for row in rows]
        assert struct["value"].tolist() == [float(row["value"]) for row in rows]
    assert [str(event["kind"]) for event in content["journal"]] == [row["kind"] for row in tables["journal"]]
    assert json.loads(str(content["journal"][0]["data"])) == json.loads(tables["journal"][0]["data"])
    assert str(content["run"]["id"]) == run.path.name
    assert str(content["run"]["units"].item()["acquisitions"].item()["positive"]) == "pulse"


def test_names_in_matlab_are_names_that_matlab_has(run, tmp_path):
    (path,) = exported(run, "matlab", tmp_path)
    content = loadmat(path)
    variables = [name for name in content if not name.startswith("__")]
    assert variables == ["run", "readings", "acquisitions", "journal"]
    for name in itertools.chain(variables, *(content[variable].dtype.names for variable in variables)):
        assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", name)


def test_hdf5_holds_the_same_with_units_and_descriptions(run, tables, tmp_path):
    (path,) = exported(run, "hdf5", tmp_path)
    with h5py.File(path) as file:
        for name, keys, columns in (
            ("acquisitions", ("step", "channel"), COUNTERS),
            ("readings", ("name", "unit"), ("t_s", "value")),
        ):
            group, below = file[name], file[name]["rows"]
            parts = parts_of(tables[name], keys[0], keys[1])
            assert len(group[keys[0]]) == len(parts)
            for index, rows in enumerate(parts):
                assert [group[key].asstr()[index] for key in keys] == [rows[0][key] for key in keys]
                first, count = group["first_row"][index], group["row_count"][index]
                for column in columns:
                    values = below[column][first : first + count].tolist()
                    assert [as_csv(column, value) for value in values] == [row[column] for row in rows]
        assert file["journal"]["data"].asstr()[:].tolist() == [row["data"] for row in tables["journal"]]
        positive = file["acquisitions/rows/positive"]
        assert (positive.attrs["unit"], positive.attrs["description"][:16]) == ("pulse", "cumulative count")
        assert (positive.shuffle, positive.compression) == (True, "gzip")
        assert np.issubdtype(positive.dtype, np.integer)
        assert file.attrs["run"] == run.path.name


def test_logs_say_that_they_are_not_the_whole_bus(run, tmp_path, bench_here):
    paths = exported(run, "candump", tmp_path)
    assert [path.name for path in paths] == ["counter.log", "candump.txt"]
    assert "not the whole bus" in paths[-1].read_text("utf-8")
    assert "not the whole bus" in bench_here("export", "--help").stdout.replace("\n", " ")


def test_packed_formats_are_a_fraction_of_the_csv(run, tmp_path):
    sizes = {form: sum(path.stat().st_size for path in exported(run, form, tmp_path / form)) for form in FORMATS}
    assert sizes["parquet"] * 10 < sizes["csv"]
    assert sizes["matlab"] * 5 < sizes["csv"]
    assert sizes["hdf5"] * 5 < sizes["csv"]


@pytest.mark.parametrize(("form", "library"), [("parquet", "pyarrow"), ("hdf5", "h5py")])
def test_a_library_that_is_missing_is_named_with_what_installs_it(run, tmp_path, monkeypatch, form, library):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(InputError) as reported:
        exported(run, form, tmp_path)
    assert str(reported.value) == (
        f"--format {form}: {library} is not installed; install it with: pip install 'inertial-test-bench[{form}]'"
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("form", FORMATS)
def test_a_place_that_cannot_be_written_is_named(run, tmp_path, form):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        exported(run, form, tmp_path / "file" / "below")
