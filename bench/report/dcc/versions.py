"""Versions of the schema that a certificate is written in, and all that differs between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Literal, NamedTuple

Name = Literal["3.1.2", "3.2.1", "3.3.0"]
DEFAULT: Name = "3.1.2"
_NAMESPACE = "https://ptb.de/dcc"


class Uncertainties(NamedTuple):
    """Elements of D-SI for uncertainties: those around both forms, and in them those of a number."""

    around: str
    expanded: str
    expanded_value: str
    interval: str
    standard_value: str


class Version(NamedTuple):
    """Version of the schema.

    `is_extended` is true from 3.2 on: signatures, the date of issue and the replaced certificate have elements of their
    own, and an e-mail address that is not stated is left out.
    """

    name: Name
    uncertainties: Uncertainties
    is_extended: bool

    @property
    def location(self) -> str:
        """Namespace and address of the schema, for `xsi:schemaLocation`."""
        return " ".join((_NAMESPACE, f"{_NAMESPACE}/v{self.name}/dcc.xsd"))


_D_SI_2_1 = Uncertainties("", "si:expandedUnc", "si:uncertainty", "si:coverageInterval", "si:standardUnc")
_D_SI_2_2 = Uncertainties(
    "si:measurementUncertaintyUnivariate",
    "si:expandedMU",
    "si:valueExpandedMU",
    "si:coverageIntervalMU",
    "si:valueStandardMU",
)
_KNOWN = (Version("3.1.2", _D_SI_2_1, False), Version("3.2.1", _D_SI_2_1, True), Version("3.3.0", _D_SI_2_2, True))
VERSIONS: Mapping[str, Version] = {each.name: each for each in _KNOWN}
_current: ContextVar[Version] = ContextVar("version", default=VERSIONS[DEFAULT])


@contextmanager
def written_in(name: str) -> Iterator[Version]:
    """Write the elements of a certificate in a version, one of `VERSIONS`, within the context."""
    before = _current.set(VERSIONS[name])
    try:
        yield VERSIONS[name]
    finally:
        _current.reset(before)


def current() -> Version:
    """Version that elements are written in."""
    return _current.get()
