"""Instruments of a run in a certificate, with their own certificates."""

from __future__ import annotations

from bench.certificates.markup import Element
from bench.figures.languages import tr
from bench.reduce.stored_run import StoredRun
from bench.report.dcc.elements import add, identify, say
from bench.report.page import Instrument
from bench.report.page import instruments as of_bench
from bench.store.seal import file_hash


def instruments(parent: Element, run: StoredRun) -> None:
    """Add the instruments of a bench, and the readings with certificates of their own."""
    made = add(parent, "dcc:measuringEquipments")
    for each in of_bench(run):
        _instrument(made, run, each)


def _instrument(parent: Element, run: StoredRun, found: Instrument) -> None:
    made = add(parent, "dcc:measuringEquipment")
    say(made, "dcc:name", f"{found.role}: {found.name or found.driver}")
    say(made, "dcc:description", lambda: _calibrated(found))
    if found.calibration is not None and found.calibration.dcc is not None:
        certificate = add(made, "dcc:certificate")
        say(certificate, "dcc:referral", lambda: tr("Digital Calibration Certificate"))
        add(certificate, "dcc:referralID", found.calibration.certificate)
        add(certificate, "dcc:procedure", "SHA-256")
        name = found.calibration.dcc.name
        add(certificate, "dcc:value", file_hash(run.folder / name).removeprefix("sha256:"))
    entries = [("manufacturer", found.serial, lambda: tr("Serial number"))]
    if found.calibration is not None:
        number = found.calibration.certificate
        entries.append(("calibrationLaboratory", number, lambda: tr("Number of the calibration certificate")))
    identify(made, entries)


def _calibrated(found: Instrument) -> str:
    """Certificate of an instrument in words."""
    if found.calibration is None:
        return tr("no certificate")
    known = found.calibration
    text = tr(
        "certificate {number} of {laboratory}, calibrated {date}, due {due}",
        number=known.certificate, laboratory=tr(known.laboratory), date=known.date, due=known.due,
    )  # fmt: skip
    if known.dcc is not None and known.dcc.signature:
        text += tr("; ") + tr("signed by {subject}", subject=known.dcc.signature)
    return text + (tr("; ") + tr("past due") if found.is_past_due else "")
