"""Calibration of an instrument by its Digital Calibration Certificate: `calibration: {dcc: FILE.xml}`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from pydantic import BaseModel, PlainSerializer, PlainValidator, ValidationError, ValidationInfo, WithJsonSchema
from pydantic_core import InitErrorDetails, PydanticCustomError

from bench.errors import InputError
from drivers.quantity.quantities import Quantity
from drivers.schema.fields import FileBeside
from drivers.schema.wording import expected, problem_at

if TYPE_CHECKING:  # certificates need libraries that most benches do not
    from bench.certificates.certificate import Certificate

DCC = "dcc"
FROM_IT = ("certificate", "laboratory", "date", "k")
BESIDE = ("signed_by", "quantities", "serial")
_FILE = FileBeside()


class CertificateFile(NamedTuple):
    """Certificate of an instrument: its file and that of its signers, as named in the bench file and as read.

    `signature` states in words who signed it, "" for nobody. `covers` are the least and greatest reading in it.
    """

    files: Mapping[str, Path]
    signature: str
    covers: tuple[Quantity, Quantity] | None

    @property
    def name(self) -> str:
        """Name of the certificate in the bench file."""
        return next(iter(self.files))


def _as_read(value: object) -> CertificateFile | None:
    if value is None or isinstance(value, CertificateFile):
        return value
    raise expected("the name of a file beside this one", value)


ReadCertificate = Annotated[
    CertificateFile | None,
    PlainValidator(_as_read),
    PlainSerializer(lambda found: None if found is None else {"file": found.name, "signature": found.signature}),
    WithJsonSchema({"type": "string", "minLength": 1}),
]


def with_certificate(
    data: Any, uncertainty: type[BaseModel], corrections: type[BaseModel], serial: str | None, info: ValidationInfo
) -> Any:
    """Return a block `calibration` with the values of the certificate that it names; without one as it is.

    `serial` is that of the bench file, which one in the block replaces. Raises ValidationError.
    """
    if not isinstance(data, Mapping) or isinstance(data.get(DCC), CertificateFile):
        return data
    if DCC not in data:
        problems = [
            problem_at((name,), "is for a calibration by a certificate file, dcc") for name in BESIDE if name in data
        ]
    else:
        problems = [problem_at((name,), "is in the certificate; remove it here") for name in FROM_IT if name in data]
        problems += [
            problem_at((name,), f"is {data[name]!r}, expected keys and their values")
            for name in ("U", "corrections", "quantities")
            if not isinstance(data.get(name, {}), Mapping)
        ]
        if not (serial := str(data.get("serial") or serial or "")):
            needed = "needs the serial number of the instrument: under identity, or as serial here"
            problems.append(problem_at((DCC,), needed))
    if problems:
        raise ValidationError.from_exception_data("Calibration", problems)
    return _read(data, uncertainty, corrections, str(serial), info) if DCC in data else data


def _read(
    data: Mapping[str, Any],
    uncertainty: type[BaseModel],
    corrections: type[BaseModel],
    serial: str,
    info: ValidationInfo,
) -> dict[str, Any]:
    files, problems = dict[str, Path](), list[InitErrorDetails]()
    for key in (DCC, "signed_by"):
        try:
            if data.get(key) is not None:
                files[data[key]] = _FILE.path(data[key], info)
        except PydanticCustomError as problem:
            problems.append(problem_at((key,), problem.message()))
    if not problems:
        try:
            return {**data, **_content(data, files, uncertainty, corrections, serial)}
        except InputError as error:
            problems = [problem_at((DCC,), each) for each in error.problems]
    raise ValidationError.from_exception_data("Calibration", problems)


def _content(
    data: Mapping[str, Any], files: Mapping[str, Path], uncertainty: type[BaseModel], corrections: type[BaseModel],
    serial: str,
) -> dict[str, Any]:  # fmt: skip
    """Values of a certificate for the block, with those that the bench file adds. Raises InputError."""
    path, *signers = files.values()
    from bench.certificates.certificate import read_certificate
    from bench.certificates.into_bench import block_of, wanted

    found = read_certificate(path)
    signature = _signature(found, signers)
    own, added = dict(data.get("U", {})), dict(data.get("corrections", {}))
    block = block_of(
        found,
        wanted(
            uncertainty,
            corrections,
            {name: str(each) for name, each in data.get("quantities", {}).items()},
            frozenset(own),
        ),
        serial,
    )
    if twice := sorted({*added} & {*block.corrections}):
        raise InputError(f"{path}: states {twice[0]}, and so do the corrections of the bench file; remove it there")
    return {
        "certificate": found.number, "laboratory": found.laboratory, "date": str(found.date), "due": _due(data, found),
        "k": block.k, "U": {**own, **block.uncertainties}, "corrections": {**added, **block.corrections},
        DCC: CertificateFile(dict(files), signature, block.covers),
    }  # fmt: skip


def _due(data: Mapping[str, Any], found: Certificate) -> Any:
    """Date of the next calibration: that of the bench file must not be after that of the certificate."""
    if found.due is None:
        if "due" not in data:
            raise found.markup.problem(
                "does not state when the next calibration is due; state it in the bench file: due"
            )
        return data["due"]
    if isinstance(stated := data.get("due"), str) and stated > str(found.due):
        raise found.markup.problem(f"is due on {found.due}, and the bench file says {stated}")
    return data.get("due", str(found.due))


def _signature(found: Certificate, signers: list[Path]) -> str:
    """Who signed a certificate, in words. Raises InputError for an invalid signature, and without an expected one."""
    if not signers and not found.markup.all("//ds:Signature"):
        return ""
    from bench.certificates.signature import verified

    signature = verified(found.markup, signers[0] if signers else None)
    return "" if signature is None else f"{signature.subject} (SHA-256 {signature.fingerprint})"
