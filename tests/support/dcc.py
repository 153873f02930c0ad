"""Certificates read from the schema alone, with nothing of this project; the schemas of the PTB, where they are.

The units are those of the SI brochure, 9th edition, as powers of the base units with a factor.
"""

from __future__ import annotations

import base64
import os
import re
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"
DS, QUDT = "http://www.w3.org/2000/09/xmldsig#", "http://qudt.org/vocab/"
KINDS = f"""<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="{QUDT}">
  <xs:simpleType name="quantitykind"><xs:restriction base="xs:string"/></xs:simpleType>
</xs:schema>"""
ROOT = Path(__file__).parents[2]
PLACES = [Path(os.environ.get("DCC_SCHEMAS", "nowhere")), ROOT.parent / "shared/dcc", ROOT.parents[1] / "shared/dcc"]

# Factor, and powers of second, metre, kilogram, ampere, kelvin, radian.
PI = 3.141592653589793
BROCHURE = {
    "second": (1, (1, 0, 0, 0, 0, 0)), "metre": (1, (0, 1, 0, 0, 0, 0)), "kilogram": (1, (0, 0, 1, 0, 0, 0)),
    "ampere": (1, (0, 0, 0, 1, 0, 0)), "kelvin": (1, (0, 0, 0, 0, 1, 0)), "degreecelsius": (1, (0, 0, 0, 0, 1, 0)),
    "volt": (1, (-3, 2, 1, -1, 0, 0)), "ohm": (1, (-3, 2, 1, -2, 0, 0)), "watt": (1, (-3, 2, 1, 0, 0, 0)),
    "hertz": (1, (-1, 0, 0, 0, 0, 0)), "newton": (1, (-2, 1, 1, 0, 0, 0)), "pascal": (1, (-2, -1, 1, 0, 0, 0)),
    "radian": (1, (0, 0, 0, 0, 0, 1)), "degree": (PI / 180, (0, 0, 0, 0, 0, 1)),
    "arcminute": (PI / 10800, (0, 0, 0, 0, 0, 1)), "arcsecond": (PI / 648000, (0, 0, 0, 0, 0, 1)),
    "minute": (60, (1, 0, 0, 0, 0, 0)), "hour": (3600, (1, 0, 0, 0, 0, 0)), "day": (86400, (1, 0, 0, 0, 0, 0)),
    "one": (1, (0, 0, 0, 0, 0, 0)), "percent": (1e-2, (0, 0, 0, 0, 0, 0)), "ppm": (1e-6, (0, 0, 0, 0, 0, 0)),
}  # fmt: skip
PREFIXES = {"nano": 1e-9, "micro": 1e-6, "milli": 1e-3, "hecto": 1e2, "kilo": 1e3, "mega": 1e6}


def in_si(unit: str) -> tuple[float, tuple[float, ...]]:
    """Factor of a unit of D-SI to base units, and its powers of them; KeyError for none."""
    factor, powers, prefix = 1.0, [0.0] * 6, 1.0
    parts = re.findall(r"\\([a-z]+)(?:\{([^}]*)\})?", unit)
    assert "".join(f"\\{name}" + (f"{{{power}}}" if power else "") for name, power in parts) == unit
    names = [name for name, _ in parts]
    for index, (name, _) in enumerate(parts):
        if name in PREFIXES:
            prefix = PREFIXES[name]
        elif name != "tothe":
            power = float(parts[index + 1][1]) if names[index + 1 : index + 2] == ["tothe"] else 1.0
            scale, base = BROCHURE[name]
            factor *= (prefix * scale) ** power
            powers = [each + power * more for each, more in zip(powers, base, strict=True)]
            prefix = 1.0
    return factor, tuple(powers)


@dataclass
class Real:
    """A value of D-SI: the texts of its numbers as floats."""

    label: str
    value: float
    unit: str
    uncertainty: float | None = None
    k: float | None = None
    probability: float | None = None
    interval: tuple[float, float] | None = None


@dataclass
class Quantity:
    """A quantity of a result."""

    names: dict[str, str]
    real: Real | None
    instead: str
    conformity: str | None
    declaration: str
    limits: list[float]
    reported: Real | None
    conditions: dict[str, Real] = field(default_factory=dict)


def parsed(content: bytes) -> Any:
    return etree.fromstring(content)


def _real(element: Any) -> Real:
    def number(path: str) -> float | None:
        found = element.find(path.replace("si:", SI))
        return None if found is None else float(found.text)

    around = "si:measurementUncertaintyUnivariate/"
    if element.find(around.replace("si:", SI).rstrip("/")) is not None:  # D-SI 2.2
        expanded, interval, u = f"{around}si:expandedMU", f"{around}si:coverageIntervalMU", "si:valueStandardMU"
        value = "si:valueExpandedMU"
    else:
        expanded, interval, u, value = "si:expandedUnc", "si:coverageInterval", "si:standardUnc", "si:uncertainty"
    sides = number(f"{interval}/si:intervalMin"), number(f"{interval}/si:intervalMax")
    return Real(
        element.findtext(f"{SI}label") or "",
        float(element.findtext(f"{SI}value")),
        element.findtext(f"{SI}unit"),
        number(f"{expanded}/{value}") or number(f"{interval}/{u}"),
        number(f"{expanded}/si:coverageFactor"),
        number(f"{expanded}/si:coverageProbability") or number(f"{interval}/si:coverageProbability"),
        None if sides[0] is None else sides,
    )


def _names(element: Any) -> dict[str, str]:
    return {each.get("lang", ""): each.text or "" for each in element.iterfind(f"{DCC}content")}


def quantities(root: Any) -> list[Quantity]:
    """All quantities of results, with what belongs to them."""
    found = []
    for each in root.iterfind(f".//{DCC}results/{DCC}result/{DCC}data/{DCC}quantity"):
        real, text = each.find(f"{SI}real"), each.find(f"{DCC}noQuantity")
        made = Quantity(
            _names(each.find(f"{DCC}name")), None if real is None else _real(real),
            "" if text is None else "".join(text.itertext()).strip(), None, "", [], None,
        )  # fmt: skip
        for meta in each.iterfind(f"{DCC}measurementMetaData/{DCC}metaData"):
            values = [_real(item) for item in meta.iterfind(f".//{SI}real")]
            if meta.find(f"{DCC}nonSIUnit") is not None:
                (made.reported,) = values
            else:
                made.conformity = meta.findtext(f"{DCC}conformity")
                made.declaration = "".join(meta.find(f"{DCC}declaration").itertext())
                made.limits = [value.value for value in values]
        for condition in each.iterfind(f"{DCC}influenceConditions/{DCC}influenceCondition"):
            name = "".join(condition.find(f"{DCC}name").itertext()).strip()
            made.conditions[name] = _real(condition.find(f".//{SI}real"))
        found.append(made)
    return found


def text_of(root: Any, path: str) -> str:
    """Text of the element at a path of dcc names; "" if there is none."""
    found = root.find("/".join(f"{DCC}{name}" for name in path.split("/")))
    return "" if found is None else "".join(found.itertext()).strip()


def document(root: Any) -> tuple[str, str, bytes]:
    """Name, type and content of the file inside."""
    inside = root.find(f"{DCC}document")
    name, kind, data = (inside.findtext(f"{DCC}{tag}") for tag in ("fileName", "mimeType", "dataBase64"))
    return name, kind, base64.b64decode(data, validate=True)


def statements(root: Any) -> dict[str, Any]:
    """Statements by their refType."""
    found = root.iterfind(f"{DCC}administrativeData/{DCC}statements/{DCC}statement")
    return {each.get("refType"): each for each in found}


def errors(*files: Path) -> list[str]:
    """Errors of certificates of one version by its schemas; skips without them.

    Those of 3.1.2 are in a folder itself, where they fail if they are stated to be and are not; those of later versions
    are in a folder of it with the name of the version.
    """
    import xmlschema

    (version,) = {parsed(file.read_bytes()).get("schemaVersion") for file in files}
    name = "" if version == "3.1.2" else version
    folder = next((place / name for place in PLACES if (place / name / "dcc.xsd").is_file()), None)
    if folder is None:
        assert name or "DCC_SCHEMAS" not in os.environ, f"there is no dcc.xsd in {PLACES[0]}"
        pytest.skip(f"the schemas of DCC {version} are not here: {Path('DCC_SCHEMAS', name)}, or ../shared/dcc/{name}")
    schema = xmlschema.XMLSchema(str(folder / "dcc.xsd"), locations=_imports(folder), allow="local")
    return [f"{file.name}: {each.path}: {each.reason}" for file in files for each in schema.iter_errors(str(file))]


def _imports(folder: Path) -> dict[str, str]:
    """Files of the namespaces that the schema of certificates imports."""
    import signxml

    signature = Path(signxml.__file__).parent / "schemas/xmldsig-core-schema.xsd"
    kinds = folder / "qudt/quantitykind.xsd"
    if not kinds.is_file():  # no certificate here names a kind of quantity by QUDT, whose list is long
        kinds = Path(tempfile.gettempdir()) / "quantitykind_as_text.xsd"
        kinds.write_text(KINDS)
    return {SI[1:-1]: str(folder / "SI_Format.xsd"), DS: str(signature), QUDT: str(kinds)}
