"""Certificate of an approved run: what it is issued for, and its file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lxml import etree

from bench.certificates.markup import XSI
from bench.errors import InputError
from bench.figures.languages import ENGLISH, language, tr
from bench.files import atomic_file, write_atomically
from bench.reduce.evaluate import Results
from bench.reduce.stored_run import StoredRun
from bench.report.approval import approval_of
from bench.report.dcc.administrative import administrative
from bench.report.dcc.elements import add, element
from bench.report.dcc.results import file, measurement_results
from bench.report.dcc.versions import DEFAULT, written_in
from bench.report.revision import changed_reports, issued_name, replacing, writing
from bench.report.write import expect_elsewhere
from bench.store.runs import json_text

if TYPE_CHECKING:
    from bench.certificates.signature import Key

FORM = "xml"
_LOCATION = f"{{{XSI}}}schemaLocation"
_KINDS = {"pdf": "application/pdf", "html": "text/html"}
_RESULTS = "results.json"


def write_certificate(
    run: StoredRun,
    lang: str = ENGLISH,
    out: Path | None = None,
    key: Key | None = None,
    version: str = DEFAULT,
) -> Path:
    """Write the certificate of an approved run to its directory, or to a file `out`; return the path.

    It has the number of the approved report in its name, and is not replaced. Raises InputError and StoreError.
    """
    if out is not None:
        expect_elsewhere(out)
    with writing(run.folder), language(lang):
        content = certificate_of(run, key, version=version)
        if out is not None:
            with atomic_file(out) as draft:
                draft.write_bytes(content)
            return out
        approval = approval_of(run.folder)
        path = run.folder / issued_name(approval["report"] if approval is not None else "", FORM)
        if path.exists():
            raise InputError(f"{path}: is issued already, and is not replaced; --out FILE writes another one elsewhere")
        with replacing(run.folder, path.name, content):
            write_atomically(path, content)
    return path


def certificate_of(
    run: StoredRun,
    key: Key | None = None,
    approval: Mapping[str, Any] | None = None,
    issued: bytes = b"",
    version: str = DEFAULT,
) -> bytes:
    """Return the certificate of an approved run in the current language, signed if there is a key.

    `approval` and the file of its report are given while they are issued; else they are those of the run. `version` is
    that of the schema. Raises InputError for a run for which no certificate is issued.
    """
    approval = approval if approval is not None else approval_of(run.folder)
    if why := why_none(run, approval):
        raise InputError(why)
    assert approval is not None  # noqa: S101  else there is none
    results = run.evaluate()
    if not issued:  # else these are the results of the report that is issued now
        _expect_as_sealed(run, results)
    name, content = _issued(run, approval, issued)
    with written_in(version) as known:
        root = element("dcc:digitalCalibrationCertificate", schemaVersion=known.name)
        root.set(_LOCATION, known.location)
        administrative(root, run, results, approval, is_signed=key is not None)
        measurement_results(root, run, results)
        place = root if known.is_extended or key is None else add(root, "dcc:comment")
        file(root, "dcc:document", name, _KINDS[name.rpartition(".")[2]], content)
    etree.indent(root)
    if key is not None:
        from bench.certificates.signature import signed

        root = signed(root, place, key)
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8")


def why_none(run: StoredRun, approval: Mapping[str, Any] | None) -> str:
    """Return why no certificate can be issued for a run, "" if one can (docs/decisions/0129)."""
    name, manifest = run.folder.name, run.manifest
    if approval is None:
        return (
            f"{name}: is not approved, and a calibration certificate is of results that a second person has approved "
            "(ISO/IEC 17025, 7.8.1.1). Approve it on the page of the run; --format json has its results"
        )
    if run.damage:
        return f"{name}: is DAMAGED, no certificate is issued for it: {run.damage[0]}"
    if manifest["state"] != "completed":
        return (
            f"{name}: did not complete ({tr(manifest['state'])}), no certificate is issued for it; --format html and "
            "json have what was measured"
        )
    if not approval["laboratory"].get("name"):
        return (
            f"{name}: was approved without a laboratory, which a certificate needs; name lab.yaml in station.yaml, and "
            "issue the report again on the page of the run"
        )
    results = run.evaluate()
    if not any(unit.findings for unit in results.units) and not results.journal_records.measurements:
        return f"{name}: has no results, no certificate is issued for it"
    return ""


def _expect_as_sealed(run: StoredRun, results: Results) -> None:
    """Raise InputError if this version of the program finds other values than those that were approved."""
    path = run.folder / _RESULTS
    try:
        sealed = json.loads(path.read_bytes())["findings"]
    except (OSError, ValueError, LookupError):
        raise InputError(f"{path}: cannot be read; restore it from a copy") from None
    if sealed != json.loads(json_text(results.to_json()))["findings"]:
        raise InputError(
            f"{run.folder.name}: re-evaluated now, its results differ from those that were approved ('bench reduce "
            f"{run.folder.name}' lists them); reject the approval, or issue the certificate with the earlier version"
        )


def _issued(run: StoredRun, approval: Mapping[str, Any], content: bytes) -> tuple[str, bytes]:
    """Return name and content of the approved report. Raises InputError if it is missing or changed."""
    names = [issued_name(approval["report"], form) for form in _KINDS]
    if content:
        return names[0 if content.startswith(b"%PDF") else 1], content
    path = next((path for name in names if (path := run.folder / name).is_file()), None)
    if path is None:
        raise InputError(f"{run.folder / names[0]}: is missing; restore it from a copy, or issue the report again")
    if damage := [each for each in changed_reports(run.folder) if each.startswith(str(path))]:
        raise InputError(damage[0])
    return path.name, path.read_bytes()
