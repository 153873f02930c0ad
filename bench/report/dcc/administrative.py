"""Administrative data of a certificate: laboratory, customer, units, persons, statements (ISO/IEC 17025:2017, 7.8)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, date, datetime
from functools import partial
from importlib.metadata import version
from typing import Any
from zoneinfo import ZoneInfo

from bench.certificates.markup import Element
from bench.figures.languages import tr
from bench.reduce.evaluate import Results
from bench.reduce.stored_run import StoredRun
from bench.report import page
from bench.report.dcc import versions
from bench.report.dcc.elements import Words, add, contact, identify, languages, say
from bench.report.revision import issued_name
from bench.store.seal import file_hash

UNKNOWN_COUNTRY = "ZZ"  # of ISO 3166-1, for users' own use
SIMULATED = "SIMULATED-"  # before the number of a certificate that is none


def administrative(
    parent: Element, run: StoredRun, results: Results, approval: Mapping[str, Any], *, is_signed: bool
) -> None:
    """Add the administrative data of an approved run."""
    made = add(parent, "dcc:administrativeData")
    software = add(add(made, "dcc:dccSoftware"), "dcc:software")
    say(software, "dcc:name", "inertial-test-bench")
    add(software, "dcc:release", version("inertial-test-bench"))
    _core(made, run, approval)
    _items(made, run, approval)
    laboratory, fields = approval["laboratory"], approval["fields"]
    issuer = add(made, "dcc:calibrationLaboratory")
    if accreditation := laboratory.get("accreditation", ""):
        add(issuer, "dcc:calibrationLaboratoryCode", accreditation)
    contact(issuer, "dcc:contact", laboratory["name"], laboratory.get("address", ""), laboratory.get("email", ""))
    _persons(made, run, approval, is_signed=is_signed)
    contact(made, "dcc:customer", fields.get("customer") or _not_stated, fields.get("customer_address", ""))
    _statements(made, run, results, approval)


def _not_stated() -> str:
    return tr("not stated")


def number_of(run: StoredRun, approval: Mapping[str, Any]) -> str:
    """Return the number of a certificate; of a simulated run one that shows that it is none."""
    return f"{_mark(run)}{approval['report']}"


def _mark(run: StoredRun) -> str:
    return SIMULATED if run.manifest["simulated"] else ""


def _core(parent: Element, run: StoredRun, approval: Mapping[str, Any]) -> None:
    made, fields, zone = add(parent, "dcc:coreData"), approval["fields"], ZoneInfo(run.bench.site.time_zone)
    add(made, "dcc:countryCodeISO3166_1", approval["laboratory"].get("country") or UNKNOWN_COUNTRY)
    for kind in ("used", "mandatory"):
        for lang in languages():
            add(made, f"dcc:{kind}LangCodeISO639_1", lang)
    add(made, "dcc:uniqueIdentifier", number_of(run, approval))
    identify(made, (
        ("calibrationLaboratory", run.manifest["run"], lambda: tr("Run")),
        ("customer", run.manifest.get("order") or "", lambda: tr("Order")),
    ))  # fmt: skip
    if received := fields.get("received", ""):
        add(made, "dcc:receiptDate", received)
    for name, instant in (("begin", run.manifest["started"]), ("end", run.manifest["ended"])):
        add(made, f"dcc:{name}PerformanceDate", str(_day(instant, zone)))
    is_elsewhere = fields.get("place") or approval["laboratory"].get("place")
    add(made, "dcc:performanceLocation", "other" if is_elsewhere else "laboratory")
    replaced = approval.get("replaces", "")
    if versions.current().is_extended:
        add(made, "dcc:issueDate", str(_day(approval["at"], ZoneInfo("UTC"))))
        if replaced:
            change = add(made, "dcc:reportAmendedSubstituted")
            add(change, "dcc:typeOfChange", "substituted")
            add(change, "dcc:replacedUniqueIdentifier", f"{_mark(run)}{replaced}")
    _previous(made, run, replaced)


def _day(instant: str, zone: ZoneInfo) -> date:
    return datetime.fromisoformat(instant).astimezone(zone).date()


def _previous(parent: Element, run: StoredRun, number: str) -> None:
    """Add the report that this one replaces, if its file is still there."""
    paths = [path for form in ("pdf", "html") if (path := run.folder / issued_name(number, form)).is_file()]
    if not number or not paths:
        return
    made = add(parent, "dcc:previousReport")
    say(made, "dcc:referral", lambda: tr("Replaces"))
    add(made, "dcc:referralID", number)
    add(made, "dcc:procedure", "SHA-256")
    add(made, "dcc:value", file_hash(paths[0]).removeprefix("sha256:"))


def _items(parent: Element, run: StoredRun, approval: Mapping[str, Any]) -> None:
    made, fields = add(parent, "dcc:items"), approval["fields"]
    for unit in run.manifest["units"]:
        item = add(made, "dcc:item")
        say(item, "dcc:name", partial(tr, unit["type"]))
        if condition := fields.get("condition", ""):
            say(item, "dcc:description", condition)
        contact(item, "dcc:manufacturer", fields.get("model") or _not_stated, is_strict=False)
        identify(item, [("manufacturer", unit["uut"], lambda: tr("Serial number"))], "basic_serialNumber")


def _persons(parent: Element, run: StoredRun, approval: Mapping[str, Any], *, is_signed: bool) -> None:
    made = add(parent, "dcc:respPersons")
    persons = [(approval["by"], "approved", True), (run.manifest["operator"] or "", "measured", False)]
    for name, role, is_main in persons:
        if name:
            person = add(made, "dcc:respPerson")
            contact(person, "dcc:person", name, is_strict=False)
            add(person, "dcc:role", role)
            add(person, "dcc:mainSigner", "true" if is_main else "false")
            if is_main:
                add(person, "dcc:cryptElectronicSignature", "true" if is_signed else "false")


def _statements(parent: Element, run: StoredRun, results: Results, approval: Mapping[str, Any]) -> None:
    made = add(parent, "dcc:statements")
    if run.manifest["simulated"]:
        stated = add(made, "dcc:statement", refType="itb_simulated")
        add(stated, "dcc:traceable", "false")
        words = "This is no calibration certificate: instruments were simulated, and the values are not measured."
        say(stated, "dcc:declaration", lambda: tr(words))
        add(stated, "dcc:valid", "false")
    issued = add(made, "dcc:statement", refType="itb_issued")
    say(issued, "dcc:declaration", lambda: tr("Issued"))
    add(issued, "dcc:date", str(_day(approval["at"], ZoneInfo("UTC"))))
    if (traceability := approval["laboratory"].get("traceability", "")) and not run.manifest["simulated"]:
        stated = add(made, "dcc:statement", refType="itb_traceability")
        add(stated, "dcc:traceable", "true")
        say(stated, "dcc:declaration", traceability)
    for kind, text in _texts(run, results, approval):
        say(add(made, "dcc:statement", refType=kind), "dcc:declaration", text)


def _texts(run: StoredRun, results: Results, approval: Mapping[str, Any]) -> Iterator[tuple[str, Words | str]]:
    laboratory, fields = approval["laboratory"], approval["fields"]
    yield "itb_time", "/".join(_utc(run.manifest[each]) for each in ("started", "ended"))
    yield "itb_scope", lambda: tr("This report relates only to the items calibrated.")
    for kind, text in (
        ("itb_place", fields.get("place") or laboratory.get("place", "")),
        ("itb_environment", fields.get("environment") or laboratory.get("environment", "")),
        ("itb_remarks", fields.get("remarks", "")),
    ):
        if text:
            yield kind, text
    if results.verdict == "INCOMPLETE":
        yield "itb_incomplete", lambda: tr("Some results could not be determined; the report states which, and why.")
    yield from (("itb_deviation", words) for words in _deviations(run, results))


def _utc(instant: str) -> str:
    return datetime.fromisoformat(instant).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _deviations(run: StoredRun, results: Results) -> Sequence[Words]:
    """Problems of the run, and expired certificates, as the report lists them; computed again for each language."""

    def problems() -> list[str]:
        return [*page.problems(run, "", results.verdict), *page.past_due(page.instruments(run))]

    return [partial(lambda index: problems()[index], index) for index in range(len(problems()))]
