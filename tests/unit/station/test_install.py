"""Files of the service: written once, compared later, and fit for the program and settings that are named."""

import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from bench.cli.main import main
from bench.config.load import load_file
from bench.errors import InputError
from bench.station.install import PLACES, SETTINGS, STARTER, by_hand, own_program, service_files
from bench.station.settings import StationFile, read_station

WORDS = ["install-service", "--program", "/opt/x/bin/bench", "--root"]


def installed(root, *options, capsys):
    assert main([*WORDS, str(root), *options]) == 0
    return capsys.readouterr().out


def contents(root):
    return {path: path.read_text() for path in root.rglob("*") if path.is_file()}


def test_a_dry_run_writes_nothing_and_a_second_run_changes_nothing(tmp_path, capsys):
    assert installed(tmp_path, "--dry-run", capsys=capsys).count("would be written") == len(PLACES) + 1
    assert contents(tmp_path) == {}
    assert installed(tmp_path, capsys=capsys).count(": written") == len(PLACES) + 1
    first = contents(tmp_path)
    assert {f"/{path.relative_to(tmp_path)}" for path in first} == {*PLACES.values(), str(SETTINGS)}
    assert installed(tmp_path, capsys=capsys).count(": unchanged") == len(PLACES)
    assert contents(tmp_path) == first


def test_a_file_that_differs_is_kept_and_shown_until_it_is_to_be_replaced(tmp_path, capsys):
    installed(tmp_path, capsys=capsys)
    unit = tmp_path / "etc/systemd/system/bench-station.service"
    ours = unit.read_text()
    unit.write_text(theirs := ours.replace("WatchdogSec=60", "WatchdogSec=5"))
    said = installed(tmp_path, capsys=capsys)
    assert f"{unit}: kept, though it differs" in said
    assert "    -WatchdogSec=5\n    +WatchdogSec=60\n" in said
    assert unit.read_text() == theirs
    assert f"{unit}: replaced" in installed(tmp_path, "--replace", capsys=capsys)
    assert unit.read_text() == ours


def test_settings_of_the_laboratory_are_never_replaced(tmp_path, capsys):
    settings = tmp_path / str(SETTINGS)[1:]
    settings.parent.mkdir(parents=True)
    settings.write_text("mine\n")
    assert f"{settings}: kept" in installed(tmp_path, "--replace", capsys=capsys)
    assert settings.read_text() == "mine\n"


def test_the_units_name_the_program_and_the_settings_that_were_given(tmp_path, capsys):
    installed(tmp_path, "--settings", "/srv/lab/station.yaml", capsys=capsys)
    text = (tmp_path / "etc/systemd/system/bench-station.service").read_text()
    assert "\nExecStart=/opt/x/bin/bench serve /srv/lab/station.yaml --folder " in text
    item = (tmp_path / "etc/systemd/system/bench-item@.service").read_text()
    assert "\nExecStopPost=/opt/x/bin/bench make-safe --if-left-on\n" in item
    assert "/opt/inertial-test-bench" not in text + item


def test_the_starter_can_be_served_and_its_runs_are_where_a_service_may_write(tmp_path):
    (tmp_path / "station.yaml").write_text(STARTER)
    assert load_file(tmp_path / "station.yaml", StationFile).launch == "process"
    assert read_station(tmp_path / "station.yaml", tmp_path).runs == Path("/var/lib/inertial-test-bench/runs")


@pytest.mark.parametrize("path", ["bin/bench", "/opt/a b/bench", "/opt/%h/bench", "/opt/x\nUser=root"])
def test_a_path_that_systemd_would_read_differently_is_refused(tmp_path, path):
    with pytest.raises(InputError, match="absolute path"):
        service_files(tmp_path, Path(path), SETTINGS)


def test_a_unit_names_the_link_so_that_it_starts_the_newest_version(tmp_path, monkeypatch):
    folder = tmp_path / f"itb-{version('inertial-test-bench')}"
    (folder / "bin").mkdir(parents=True)
    monkeypatch.setattr(sys, "executable", str(folder / "bin/python"))
    assert own_program() == folder / "bin/bench"
    (tmp_path / "itb").symlink_to(folder)
    assert own_program() == tmp_path / "itb/bin/bench"
    (tmp_path / "itb").unlink()
    (tmp_path / "itb").symlink_to(tmp_path)
    assert own_program() == folder / "bin/bench"


def test_a_program_in_a_home_is_pointed_out():
    assert "services cannot see this folder" in by_hand(Path("/home/anna/.local/bin/bench"))[0]
    assert "services cannot see" not in "".join(by_hand(Path("/opt/x/bin/bench")))


@pytest.mark.integration
@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="systemd-sysusers is not installed")
def test_the_user_of_the_station_may_open_serial_ports(tmp_path, capsys):
    installed(tmp_path, capsys=capsys)
    done = subprocess.run(["systemd-sysusers", f"--root={tmp_path}"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    groups = dict(line.split(":", 1) for line in (tmp_path / "etc/group").read_text().splitlines())
    assert groups["dialout"].endswith(":bench")
