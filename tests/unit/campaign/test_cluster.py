"""Who may be connected to, and by which files."""

import pytest

from bench.campaign.cluster import LOOPBACK, SchedulerLost, TlsFiles, _closing, _security, expect_secured
from bench.campaign.program import differences, digest_of, identity
from bench.errors import InputError


@pytest.mark.parametrize("host", LOOPBACK)
def test_plain_connections_are_for_this_computer(host):
    shown = f"[{host}]" if ":" in host else host
    assert expect_secured(f"tcp://{shown}:8786") is False
    assert expect_secured(f"tls://{shown}:8786") is True


@pytest.mark.parametrize(
    "address",
    ["tcp://cluster.example:8786", "tcp://10.0.0.1:8786", "tcp://0.0.0.0:8786", "tcp://127.0.0.1.evil.example:1"],
)
def test_other_computers_need_tls(address):
    with pytest.raises(InputError, match=r"without TLS.*give tls://HOST:PORT"):
        expect_secured(address)


@pytest.mark.parametrize(
    "address",
    ["cluster:8786", "tls://cluster", "tls://:8786", "ucx://cluster:1", "inproc://x:1", "", "tls://a:port", "tls://["],
)
def test_what_is_no_address_of_a_scheduler_is_refused(address):
    with pytest.raises(InputError, match="expected tls://HOST:PORT"):
        expect_secured(address)


def test_missing_files_of_tls_are_named(tmp_path):
    with pytest.raises(InputError, match="needs --tls-ca FILE"):
        _security(TlsFiles())
    with pytest.raises(InputError, match=r"--tls-ca .*none.pem: there is no such file"):
        _security(TlsFiles(tmp_path / "none.pem"))


def test_a_private_key_must_be_private(tmp_path):
    files = [tmp_path / name for name in ("ca.pem", "cert.pem", "key.pem")]
    for file in files:
        file.touch(0o644)
    with pytest.raises(InputError, match=r"key\.pem can be read by others"):
        _security(TlsFiles(*files))
    files[2].chmod(0o600)
    assert _security(TlsFiles(*files)).tls_client_key == str(files[2])


def test_files_of_tls_may_come_from_the_configuration_of_dask(tmp_path):
    import dask

    key = tmp_path / "key.pem"
    key.touch(0o600)
    prefix = "distributed.comm.tls"
    files = {f"{prefix}.ca-file": "ca.pem", f"{prefix}.client.cert": "cert.pem", f"{prefix}.client.key": str(key)}
    with dask.config.set(files):
        assert _security(TlsFiles()).tls_ca_file == "ca.pem"


def test_programs_differ_by_each_of_their_parts():
    known = identity()
    assert {"sources", "python", "numpy", "scipy", "inertial-test-bench"} <= known.keys()
    assert differences(known, known) == []
    other = {**known, "numpy": "1.0"} | {"my-plug-in": "2.0"}
    assert differences(known, other) == ["my-plug-in 2.0 instead of none", f"numpy 1.0 instead of {known['numpy']}"]
    assert digest_of(known) != digest_of(other)


def test_a_client_that_fails_to_close_does_not_hide_why_it_is_closed():
    class Reconnecting:
        def close(self):
            raise ValueError("IOStream is not idle; cannot convert to SSL")

    with pytest.raises(SchedulerLost, match="lost"), _closing(Reconnecting()):
        raise SchedulerLost("the connection to the scheduler is lost")
