"""The bundle for a computer without a network: made here, installed and run where there is only a loopback."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

from tests.support.runs import ROOT
from tests.support.unpacked import unpack

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.timeout(900)]
WITHOUT_NETWORK = ["unshare", "--net", "sh", "-c", 'ip link set lo up && exec "$@"', "sh"]
can_unshare = shutil.which("unshare") is not None and shutil.which("ip") is not None and os.geteuid() == 0


def run(*words, cwd, env=None, network=False):
    command = [*([] if network else WITHOUT_NETWORK), *map(str, words)]
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """The folder of a bundle, unpacked."""
    if os.environ.get("BENCH_BUNDLE") != "1":
        pytest.skip("takes minutes and downloads about 90 MB; BENCH_BUNDLE=1 runs it")
    if not can_unshare:
        pytest.skip("a network namespace needs root, unshare and ip")
    folder = tmp_path_factory.mktemp("bundle")
    made = run(ROOT / "packaging/bundle", sys.executable, folder, cwd=ROOT, network=True)
    if made.returncode and "No matching distribution" in made.stderr:
        pytest.skip(f"the wheels cannot be downloaded: {made.stderr[-300:]}")
    assert made.returncode == 0, made.stderr
    (archive,) = folder.glob("inertial-test-bench-*.tar")
    unpack(archive, folder)
    archive.unlink()
    (unpacked,) = folder.iterdir()
    return unpacked


@pytest.fixture(scope="module")
def installed(unpacked, tmp_path_factory):
    """The link to the installed version."""
    place = tmp_path_factory.mktemp("opt") / "itb"
    env = {"PATH": os.environ["PATH"], "PYTHON": sys.executable, "HOME": str(place.parent)}
    done = run(unpacked / "install.sh", place, cwd="/", env=env)
    assert done.returncode == 0, done.stderr
    assert place.is_symlink()
    again = run(unpacked / "install.sh", place, cwd="/", env=env)
    assert (again.returncode, "is there already" in again.stderr) == (1, True)
    return place


def test_there_is_no_network(tmp_path):
    if not can_unshare:
        pytest.skip("a network namespace needs root, unshare and ip")
    shown = run("ip", "-oneline", "link", cwd=tmp_path)
    assert [line.split(":")[1].strip() for line in shown.stdout.splitlines()] == ["lo"]


def test_it_runs_and_serves_where_there_is_no_network(installed, tmp_path):
    env = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    done = run(installed / "bin/bench", "run", "smoke", "--speed", "max", cwd=tmp_path, env=env)
    assert done.returncode == 0, done.stderr
    assert "Verdict: PASS" in done.stdout
    shown = run(installed / "bin/bench", "install-service", "--root", tmp_path / "root", cwd=tmp_path, env=env)
    assert shown.returncode == 0, shown.stderr
    unit = (tmp_path / "root/etc/systemd/system/bench-station.service").read_text()
    assert f"\nExecStart={installed}/bin/bench serve " in unit
    script = f"""
{installed}/bin/bench serve --folder station --port 0 > said &
until grep -q http said; do sleep 0.2; kill -0 $!; done
{installed}/bin/python -c '
import json, sys, urllib.request
url = json.load(open("station/station.json"))["url"]
request = urllib.request.Request(url + "api/v1/queue", headers={{
    "authorization": "Bearer " + open("station/token").read(), "content-type": "application/json"}},
    data=json.dumps({{"sequence": "smoke", "bench": "demo", "speed": "max"}}).encode())
print(json.load(urllib.request.urlopen(request))["state"])'
kill $!
wait
"""
    served = run("sh", "-euc", script, cwd=tmp_path, env=env)
    assert served.returncode == 0, served.stderr
    assert served.stdout.strip() == "queued"


def test_a_pdf_is_written_from_the_bundle(installed, tmp_path):
    env = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    done = run(installed / "bin/bench", "run", "smoke", "--speed", "max", cwd=tmp_path, env=env)
    assert done.returncode == 0, done.stderr
    done = run(installed / "bin/bench", "report", "last", "--format", "pdf", cwd=tmp_path, env=env)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("harm", ["a wheel has changed", "another Python"])
def test_a_bundle_that_does_not_fit_installs_nothing(unpacked, tmp_path, harm):
    copy = shutil.copytree(unpacked, tmp_path / "copy")
    if harm == "a wheel has changed":
        wheel = next((copy / "wheels").glob("click-*.whl"))
        wheel.write_bytes(wheel.read_bytes()[:-1] + b"x")
    else:
        (copy / "made_for").write_text("3.9 riscv64\n")
        sums = subprocess.run(
            "sha256sum install.sh made_for wheels/*", shell=True, cwd=copy, capture_output=True, check=True
        )
        (copy / "SHA256SUMS").write_bytes(sums.stdout)
    done = run(
        copy / "install.sh", tmp_path / "itb", cwd="/", env={"PATH": os.environ["PATH"], "PYTHON": sys.executable}
    )
    assert done.returncode == 1
    assert ("damaged" if harm == "a wheel has changed" else "is for Python 3.9 riscv64") in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["copy"]
