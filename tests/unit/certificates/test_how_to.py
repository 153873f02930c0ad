"""The page on certificates: its commands in a folder of their own, in order, and its pieces of a bench file."""

import shutil

import pytest
import yaml

from bench.config.bench import load_bench
from bench.report.dcc.versions import DEFAULT
from bench.station.settings import StationFile
from tests.support.certified import approve
from tests.support.dcc import parsed
from tests.support.how_to import FOLDER, blocks, commands, follow
from tests.support.runs import ROOT

PAGE = FOLDER / "certificates.md"
REFUSED_FIRST = ["bench", "report", "last", "--format", "dcc"]


@pytest.mark.lengthy
@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl, which makes the key of the page")
def test_its_commands_work_in_order(tmp_path, bench_here):
    done = []
    for words in commands(PAGE):
        if words == REFUSED_FIRST:
            first = bench_here(*words[1:], cwd=tmp_path)
            assert "is not approved" in first.stderr
            (run,) = (tmp_path / "runs").glob("2*")
            approve(run)
        if "--sign" in words:
            (settings,) = (text for _, text in blocks(PAGE) if text.startswith("schema: itb-station"))
            (tmp_path / "station.yaml").write_text(settings, "utf-8")
        result = bench_here(*words[1:], cwd=tmp_path) if words[0] == "bench" else follow(words, tmp_path, tmp_path, {})
        assert result.returncode == 0, (words, result.stdout, result.stderr)
        done.append((words, result.stdout))
    assert len(done) == 9
    assert "as expected; unchanged since" in done[-2][1]
    assert parsed((tmp_path / "later.xml").read_bytes()).get("schemaVersion") == "3.3.0"
    assert "Reading minus true temperature [basic_measurementError]" in done[3][1]


def test_its_settings_of_a_station_are_valid():
    (settings,) = (text for _, text in blocks(PAGE) if text.startswith("schema: itb-station"))
    assert StationFile.model_validate(yaml.safe_load(settings)).dcc.version == DEFAULT
    (other,) = (text for _, text in blocks(PAGE) if text.startswith("dcc:"))
    stated = yaml.safe_load(settings) | yaml.safe_load(other)
    assert StationFile.model_validate(stated).dcc.version == "3.3.0"


def pieces():
    return [text for _, text in blocks(PAGE) if text.startswith(("devices:", "readings:"))]


@pytest.fixture
def folder(tmp_path):
    shutil.copytree(ROOT / "config", tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_its_reading_is_one_of_the_example(folder):
    piece = next(each for each in pieces() if each.startswith("readings:"))
    entries = yaml.safe_load(piece)["readings"]
    found = load_bench(folder / "certificates.yaml").bench.readings
    example = yaml.safe_load((folder / "certificates.yaml").read_text("utf-8"))["readings"]
    assert {name: entry["calibration"] for name, entry in entries.items()} == {
        name: example[name]["calibration"] for name in entries
    }
    assert found["unit_temperature"].calibration.dcc.name in piece


def test_its_instrument_takes_a_certificate_of_others(folder):
    """The certificate of the example with names that its laboratory has chosen; its signature is tried elsewhere."""
    (piece,) = (each for each in pieces() if each.startswith("devices:"))
    text = (folder / "certificates/meter.xml").read_text("utf-8")
    for old, new in (
        ('refType="itb_gain"', 'id="gain_10V"'), ('refType="itb_offset"', ""), ("SIM-3458A-01", "MY12345678"),
        ("Constant correction", "Offset of the range 10 V"), ("<dcc:date>2030-12-31</dcc:date>", ""),
    ):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    (folder / "certificates/dvm.xml").write_text(text, "utf-8")
    example = (folder / "certificates.yaml").read_text("utf-8")
    begin, end = example.index("  dvm:\n"), example.index("\n# Named readings")
    stated = "".join(line for line in piece.splitlines(keepends=True)[1:] if "signed_by" not in line)
    assert stated.count("\n") + 1 == piece.count("\n") - 1
    (folder / "mine.yaml").write_text(example[:begin] + stated + example[end:], "utf-8")
    found = load_bench(folder / "mine.yaml").bench.devices["dvm"].calibration
    assert (found.corrections.gain, str(found.due)) == (-3e-6, "2027-06-30")
