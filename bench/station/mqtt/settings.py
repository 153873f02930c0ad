"""Settings of the connection to an MQTT broker: key `mqtt` of `station.yaml`."""

from __future__ import annotations

from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, StringConstraints, model_validator

from bench.files import expect_private
from drivers.schema.fields import NOT_EMPTY, Flag, InUnit, Name, StrictModel
from drivers.schema.wording import telling

UserName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.-]{1,32}$")]
PORT, TLS_PORT = 1883, 8883


class Tls(StrictModel):
    """TLS, version 1.2 or newer; the certificate of the broker is always verified. Files are relative to this file."""

    ca: str = Field("", description="file of the certificates that sign that of the broker; without it the system's")
    certificate: str = Field("", description="file of the certificate of this client")
    key: str = Field("", description="file of its private key, of mode 0600")

    @model_validator(mode="after")
    def _in_pairs(self) -> Self:
        if bool(self.certificate) != bool(self.key):
            raise telling("certificate and key belong together")
        return self


class Commands(StrictModel):
    """Commands by MQTT: pause, stop and abort. Each user has a topic, to which the broker admits that user only."""

    enabled: Flag = Field(False, description="subscribe to the topics of the users")
    users: Annotated[tuple[UserName, ...], NOT_EMPTY] = Field(
        description="users of the broker; 1 to 32 letters, digits, `_`, `.` and `-`"
    )


class MqttSettings(StrictModel):
    """Broker to which the station publishes."""

    host: Annotated[str, StringConstraints(min_length=1, max_length=253)] = Field(
        description="host name or address of the broker; with `tls`, as in its certificate"
    )
    port: int = Field(0, ge=0, le=65535, description="port; 0 for 8883 with `tls` and 1883 without")
    station: Name = Field(description="level of all topics below `bench`, different for each station of a broker")
    user: str = Field("", description="user name at the broker")
    password_file: str = Field("", description="file of the password, of mode 0600, relative to this file")
    tls: Tls | None = Field(None, description="encrypt; `{}` with the certificates of the system")
    readings_every: Annotated[float, InUnit("s", at_least=0.1)] = Field(
        1.0, description="least time between two readings of a channel"
    )
    home_assistant: Flag = Field(False, description="announce the benches to Home Assistant")
    commands: Commands | None = Field(None, description="without it the station only publishes")

    @model_validator(mode="after")
    def _password_is_safe(self) -> Self:
        if self.password_file and self.tls is None and not _is_loopback(self.host):
            raise telling(f"the password could be read in the network on the way to {self.host}; add tls")
        return self

    @property
    def port_used(self) -> int:
        """Port of the broker."""
        return self.port or (PORT if self.tls is None else TLS_PORT)

    @property
    def command_users(self) -> tuple[str, ...]:
        """Users who may send commands."""
        return self.commands.users if self.commands is not None and self.commands.enabled else ()


def with_files(settings: MqttSettings, beside: Path) -> MqttSettings:
    """Return settings with absolute paths. Raises InputError if a file is missing or can be read by others."""
    changed: dict[str, object] = {}
    if settings.password_file:
        changed["password_file"] = str(_file(beside / settings.password_file, "password_file", is_secret=True))
    if settings.tls is not None:
        files = {name: getattr(settings.tls, name) for name in ("ca", "certificate", "key")}
        found = {
            name: str(_file(beside / file, f"tls.{name}", is_secret=name == "key"))
            for name, file in files.items()
            if file
        }
        changed["tls"] = settings.tls.model_copy(update=found)
    return settings.model_copy(update=changed)


def _file(path: Path, key: str, *, is_secret: bool) -> Path:
    expect_private(path, f"mqtt.{key}", 0o077 if is_secret else 0)
    return path.absolute()


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False
