"""Addresses of brokers: where the password may be, and what is refused."""

import pytest

from bench.errors import InputError
from bench.overview.broker import BrokerFiles, address_of

NONE = BrokerFiles()


@pytest.fixture
def password(tmp_path):
    path = tmp_path / "broker.password"
    path.write_text("secret\n")
    path.chmod(0o600)
    return path


def test_the_address_of_a_broker():
    plain, secure = address_of("mqtt://127.0.0.1", NONE), address_of("mqtts://broker.example.org", NONE)
    assert (plain.url, plain.settings.port_used, plain.settings.tls) == ("mqtt://127.0.0.1:1883", 1883, None)
    assert (secure.url, secure.settings.port_used) == ("mqtts://broker.example.org:8883", 8883)
    assert secure.settings.tls is not None
    assert address_of("mqtt://[::1]:1884", NONE).settings.port_used == 1884


def test_the_password_is_in_a_file_or_in_the_environment(password):
    of_file = address_of("mqtts://anna%40lab@broker", BrokerFiles(password))
    assert (of_file.settings.user, of_file.settings.password_file) == ("anna@lab", str(password))
    of_environment = address_of("mqtt://anna@localhost", NONE, "secret")
    assert (of_environment.password, of_environment.settings.password_file) == ("secret", "")
    assert "secret" not in of_environment.url + of_file.url


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("mqtt://anna:secret@localhost", "a password in a command line is seen by all users"),
        ("broker.example.org", "give mqtt://HOST"),
        ("http://broker", "give mqtt://HOST"),
        ("mqtt://broker/bench", "give mqtt://HOST"),
        ("mqtt://broker:99999", "out of range"),
        ("mqtt://", "give mqtt://HOST"),
    ],
)
def test_other_addresses_are_refused(url, why):
    with pytest.raises(InputError, match=why) as refused:
        address_of(url, NONE)
    assert "secret" not in str(refused.value)


def test_a_password_is_for_a_user_and_not_sent_in_the_clear_through_a_network(password):
    with pytest.raises(InputError, match="a password belongs to a user"):
        address_of("mqtts://broker", BrokerFiles(password))
    for files, of_environment in ((BrokerFiles(password), ""), (NONE, "secret")):
        with pytest.raises(InputError, match="the password could be read in the network"):
            address_of("mqtt://anna@broker.example.org", files, of_environment)


def test_files_that_others_can_read_or_that_are_missing_are_refused(password, tmp_path):
    with pytest.raises(InputError, match="certificates are for mqtts"):
        address_of("mqtt://localhost", BrokerFiles(ca=password))
    with pytest.raises(InputError, match="nowhere"):
        address_of("mqtts://localhost", BrokerFiles(ca=tmp_path / "nowhere.pem"))
    with pytest.raises(InputError, match="certificate and key belong together"):
        address_of("mqtts://localhost", BrokerFiles(certificate=password))
    password.chmod(0o644)
    with pytest.raises(InputError, match="can be read by others"):
        address_of("mqtts://anna@localhost", BrokerFiles(password))
