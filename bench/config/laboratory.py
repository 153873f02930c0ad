"""What a certificate states about a laboratory and an order: `lab.yaml`, and the fields of one certificate.

The list follows ISO/IEC 17025:2017, 7.8.2 and 7.8.4. Conformity to it is not claimed.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints

from bench.config.devices import Text
from bench.config.load import load_file
from bench.errors import InputError
from drivers.schema.bounded import UnfitFileError, read_bounded
from drivers.schema.fields import StrictModel

MARK_BYTES = 2**18
PNG = b"\x89PNG\r\n\x1a\n"


class Accreditation(StrictModel):
    """Accreditation of a laboratory."""

    body: Text = Field(description="accreditation body")
    number: Text = Field(description="number of the accreditation")
    mark: str = Field("", description="file of the mark of the body, PNG, relative to this file")


class LaboratoryFile(StrictModel):
    """File `lab.yaml`: the laboratory that issues certificates."""

    schema_: Literal["itb-laboratory/1"] = Field(alias="schema", description="version of the file format")
    name: Text = Field(description="name of the laboratory")
    address: Text = Field(description="address of the laboratory")
    country: str = Field("", pattern=r"^([A-Z]{2})?$", description="its code by ISO 3166-1, such as CN, for a DCC")
    email: Text | None = Field(None, description="for a DCC")
    accreditation: Accreditation | None = Field(None, description="without it, none is stated")
    place: Text = Field("", description="where calibrations are made, if not at the address")
    environment: Text = Field("", description="environment, for benches that record no ambient conditions")
    traceability: Text = Field(description="statement of metrological traceability")


def load_laboratory(path: Path) -> LaboratoryFile:
    """Load `lab.yaml`, with the absolute path of its mark. Raises InputError."""
    found = load_file(path, LaboratoryFile)
    if found.accreditation is None or not found.accreditation.mark:
        return found
    mark = str((path.parent / found.accreditation.mark).absolute())
    found = found.model_copy(update={"accreditation": found.accreditation.model_copy(update={"mark": mark})})
    mark_of(found)
    return found


def mark_of(laboratory: LaboratoryFile) -> str:
    """Return the mark of the accreditation body as a data URL, or "". Raises InputError."""
    if laboratory.accreditation is None or not (name := laboratory.accreditation.mark):
        return ""
    try:
        content = read_bounded(Path(name), MARK_BYTES)
    except UnfitFileError as problem:
        raise InputError(f"accreditation.mark: {name}: {problem}") from None
    if not content.startswith(PNG):
        raise InputError(f"accreditation.mark: {name}: is no PNG image")
    return f"data:image/png;base64,{b64encode(content).decode()}"


def _printable(text: str) -> str:
    if not all(letter.isprintable() or letter == "\n" for letter in text):
        raise ValueError("contains unprintable characters")
    return text


Entry = Annotated[str, StringConstraints(max_length=500, strip_whitespace=True), AfterValidator(_printable)]


class CertificateFields(BaseModel):
    """Fields of one certificate that no file of a run has."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    customer: Entry = Field("", description="name of the customer")
    customer_address: Entry = Field("", description="address of the customer")
    model: Entry = Field("", description="maker and model of the units")
    condition: Entry = Field("", description="condition of the units")
    received: date | None = Field(None, description="date of receipt of the units")
    place: Entry = Field("", description="place of the calibration, if not that of the laboratory")
    environment: Entry = Field("", description="environment, if the bench records no ambient conditions")
    remarks: Entry = Field("", description="further statements")


_NEEDED = {
    "customer": "the customer",
    "customer_address": "the address of the customer",
    "model": "maker and model of the units",
    "condition": "the condition of the units",
    "received": "the date of receipt",
}


def missing_fields(laboratory: LaboratoryFile | None, fields: CertificateFields, run: Mapping[str, str]) -> list[str]:
    """Return what a certificate lacks, in words; `run` has the order and the ambient conditions of the run."""
    lacking = [] if laboratory is not None else ["the laboratory: its name, address and traceability (lab.yaml)"]
    lacking += [words for name, words in _NEEDED.items() if not getattr(fields, name)]
    lacking += [] if run.get("order") else ["the order (given when the run was submitted)"]
    stated = fields.environment or (laboratory is not None and laboratory.environment)
    lacking += [] if stated or run.get("ambient") else ["the environment"]
    return lacking
