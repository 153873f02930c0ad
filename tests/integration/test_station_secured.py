"""A station behind TLS, and where its secrets are: in its own files and on the terminal of its start alone."""

from __future__ import annotations

import socket
import ssl
import subprocess
from contextlib import ExitStack, suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from bench.store.user_state import state_folder
from tests.support.station import serving
from tests.support.web_load import Client, Run

pytestmark = [pytest.mark.integration, pytest.mark.slow]
with_openssl = pytest.mark.peer("openssl")


def certificate(folder: Path) -> tuple[Path, Path]:
    """Return a new certificate for 127.0.0.1, and its key."""
    made, key = folder / "certificate.pem", folder / "key.pem"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2",
         "-subj", "/CN=bench", "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", str(key), "-out", str(made)],
        check=True, capture_output=True,
    )  # fmt: skip
    key.chmod(0o600)
    return made, key


@with_openssl
def test_a_station_behind_tls(tmp_path):
    made, key = certificate(tmp_path)
    trusted = ssl.create_default_context(cafile=made)
    run = Run(tmp_path / "runs")
    options = ("--certificate", str(made), "--key", str(key))
    with run.under_way(), serving(tmp_path, *options, verify=trusted) as station, ExitStack() as stack:
        assert station.url.startswith("https://127.0.0.1:")
        address = ("127.0.0.1", urlsplit(station.url).port)
        answer = station.client.get("/health")
        assert answer.headers["strict-transport-security"] == "max-age=31536000"
        own = {"authorization": "", "origin": station.url.rstrip("/")}
        login = station.client.post("/api/v1/login/code", json={"code": station.code}, headers=own)
        assert login.headers["set-cookie"].startswith("__Host-bench_session=")
        assert "Secure" in login.headers["set-cookie"]
        assert station.client.get("/api/v1/me", headers={"authorization": ""}).status_code == 401, "two ways at once"
        with Client(address, b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n") as plain:
            plain.settimeout(10.0)
            with suppress(OSError):
                assert not plain.recv(4096).startswith(b"HTTP")
        old = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        old.load_verify_locations(made)
        old.set_ciphers("ALL:@SECLEVEL=0")
        with pytest.warns(DeprecationWarning, match="TLSv1_1"):
            old.maximum_version = ssl.TLSVersion.TLSv1_1
        with socket.create_connection(address) as plain, pytest.raises((ssl.SSLError, OSError)):
            old.wrap_socket(plain, server_hostname="127.0.0.1")
        for number in range(300):  # handshakes that are not gone on with give way
            stack.enter_context(Client(address, b"\x16\x03\x01" if number % 2 else b""))
        assert station.post(f"runs/{run.name}/abort")["answer"] == "aborted"
    assert len(run.heard) == 1


def test_secrets_are_in_no_record_log_or_list_of_processes(tmp_path):
    with serving(tmp_path) as station:
        token, code = station.client.headers["authorization"].removeprefix("Bearer "), station.code
        assert ((tmp_path / "station/token").stat().st_mode & 0o777) == 0o600
        item = station.submit(speed="20")
        station.until(lambda: station.get(f"queue/{item['id']}")["run"])
        commands = [_content(path) for path in Path("/proc").glob("[0-9]*/cmdline")]
        assert any(item["id"].encode() in each for each in commands), "the process of the run is among them"
        run = station.get(f"queue/{item['id']}")["run"]
        station.post(f"runs/{run}/abort")
        station.ended(item)
        environments = [_content(path) for path in Path("/proc").glob("[0-9]*/environ")]
    files = [path for folder in (tmp_path, state_folder()) for path in folder.rglob("*") if path.is_file()]
    seen = {str(path): path.read_bytes() for path in files if path.name != "token"}
    assert any(path.endswith("station.db") for path in seen)
    rest = station.process.stdout.read() if not station.process.stdout.closed else ""
    for secret in (token, code, code.replace("-", "")):
        assert len(secret) >= 8
        assert not [each for each in (*commands, *environments) if secret.encode() in each]
        assert not [path for path, content in seen.items() if secret.encode() in content]
        assert secret not in rest


def _content(path: Path) -> bytes:
    with suppress(OSError):
        return path.read_bytes()
    return b""


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--host", "127.0.0.2"), "needs users"),
        (("--host", "127.0.0.2"), "and a certificate"),
        (("--certificate", "certificate.pem", "--key", "key.pem"), "chmod 600"),
    ],
)
@with_openssl
def test_what_is_not_safe_is_not_served(tmp_path, bench_command, options, message):
    certificate(tmp_path)[1].chmod(0o644)
    done = bench_command("serve", *options, "--port", "0", "--folder", "station", cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr


def test_a_station_that_is_insecure_on_purpose_says_so_for_ever(tmp_path):
    with serving(tmp_path, "--host", "127.0.0.2", "--insecure") as station:
        banner = station.get("station")["banner"]
        assert banner == "Anybody in this network can read along and change what is sent. This station has no users."
        assert station.code == ""
