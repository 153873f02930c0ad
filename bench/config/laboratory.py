"""What a certificate states about a laboratory and an order: `lab.yaml`, and the fields of one certificate.

The list follows ISO/IEC 17025:2017, 7.8.2 and 7.8.4. Conformity to it is not claimed.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints

from bench.config.devices import Text
from drivers.schema.fields import StrictModel


class Accreditation(StrictModel):
    """Accreditation of a laboratory."""

    body: Text = Field(description="accreditation body")
    number: Text = Field(description="number of the accreditation")


class LaboratoryFile(StrictModel):
    """File `lab.yaml`: the laboratory that issues certificates."""

    schema_: Literal["itb-laboratory/1"] = Field(alias="schema", description="version of the file format")
    name: Text = Field(description="name of the laboratory")
    address: Text = Field(description="address of the laboratory")
    accreditation: Accreditation | None = Field(None, description="without it, none is stated")
    place: Text = Field("", description="where calibrations are made, if not at the address")
    traceability: Text = Field(description="statement of metrological traceability")


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
    lacking += [] if fields.environment or run.get("ambient") else ["the environment"]
    return lacking
