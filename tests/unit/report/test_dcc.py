"""Certificate of an approved run: every number by a reader that knows the schema alone, its words, its refusals."""

import hashlib
import json
import math
from dataclasses import replace

import pytest

from bench.errors import InputError
from bench.metrology.results.coverage import coverage_factor, effective_dof
from bench.report.revision import issued_name
from bench.report.revision import verify as verified
from tests.support.certified import NUMBER, PDF, approve, approved_copy, certificate
from tests.support.dcc import document, errors, in_si, parsed, quantities, statements, text_of

G, U_G, K_G = 9.79541, 0.0004, 2  # of the simulated bench


@pytest.fixture(scope="module")
def tumbled(shared_runs, tmp_path_factory):
    """Directory of an approved tumble, and its certificate in two languages."""
    run = approved_copy(shared_runs.tumble().path, tmp_path_factory.mktemp("tumbled"))
    return run, certificate(run, lang="zh")


@pytest.fixture(scope="module")
def found(tumbled):
    return quantities(parsed(tumbled[1]))


def results(run):
    return json.loads((run / "results.json").read_text("utf-8"))["findings"]


def pairs(tumbled, found):
    """Findings by the record of the run, with their quantities in the certificate."""
    findings = results(tumbled[0])
    by_id = {each.real.label: each for each in found}
    assert len(by_id) == len(found) == len(findings) > 20
    return [(finding, by_id[finding["id"]]) for finding in findings]


def in_g(unit):
    """Power of local gravity in a unit of a report."""
    return {"g": 1, "g/g²": -1, "g/g³": -2, "g/°C": 1, "pulse/s/g": -1, "g/g": 0}.get(unit, 0)


def test_it_is_valid_by_the_schemas(tumbled, tmp_path):
    (tmp_path / "made.xml").write_bytes(tumbled[1])
    assert errors(tmp_path / "made.xml") == []


def test_every_result_has_its_number_in_the_si(tumbled, found):
    powers = set()
    for finding, stated in pairs(tumbled, found):
        power = in_g(finding["unit"])
        powers.add(power)
        assert stated.real.value == pytest.approx(finding["value"] * G**power, rel=1e-14)
    assert powers == {1, 0, -1}


def test_every_uncertainty_contains_that_of_gravity_where_it_is_converted(tumbled, found):
    for finding, stated in pairs(tumbled, found):
        power, real = in_g(finding["unit"]), stated.real
        u = finding["u"] * G**power
        of_g = abs(power * real.value) * U_G / K_G / G
        total = math.hypot(u, of_g)
        if finding["interval"] is not None:
            assert real.uncertainty == pytest.approx(total, rel=1e-12)
            assert (real.probability, real.k) == (0.95, None)
            low, high = real.interval
            assert low <= finding["interval"]["low"] * G**power * (1 + 1e-12)
            assert high >= finding["interval"]["high"] * G**power * (1 - 1e-12)
            continue
        dof = effective_dof([(u, finding["dof"]), (of_g, None)]) if power else finding["dof"]
        assert real.k == pytest.approx(coverage_factor(dof), rel=1e-14)
        assert real.probability == 0.9545
        assert real.uncertainty == pytest.approx(real.k * total, rel=1e-12)


def test_the_scale_factor_per_local_g_is_the_one_per_metre_per_second_squared(tumbled, found):
    by_id = {each.real.label: each.real for each in found}
    several = [name for name in by_id if "/K1@" in name]
    assert len(several) >= 3
    for name in several:
        one, other = by_id[name], by_id[name.replace("/K1@", "/K1_si@")]
        assert (one.unit, one.value, one.uncertainty) == (
            other.unit, pytest.approx(other.value, rel=1e-12), pytest.approx(other.uncertainty, rel=1e-9)
        )  # fmt: skip


def test_the_values_in_local_gravity_are_there_as_reported(tumbled, found):
    several = 0
    for finding, stated in pairs(tumbled, found):
        if not in_g(finding["unit"]):
            assert stated.reported is None
            continue
        several += 1
        assert stated.reported.value == finding["value"]
        if finding["interval"] is None:
            assert (stated.reported.uncertainty, stated.reported.k) == (finding["expanded"], finding["k"])
    assert several > 10


def test_statements_of_conformity_have_limits_and_the_decision_rule(tumbled, found):
    several = 0
    for finding, stated in pairs(tumbled, found):
        if finding["limits"] is None:
            assert stated.conformity is None
            continue
        several += 1
        sides = [finding["limits"][side] for side in ("min", "max") if side in finding["limits"]]
        assert stated.limits == pytest.approx([side * G ** in_g(finding["unit"]) for side in sides], rel=1e-12)
        assert stated.conformity == {"PASS": "pass", "FAIL": "fail"}[finding["verdict"]]
        assert "simple acceptance" in stated.declaration
    assert several > 5


def test_conditions_and_units_are_of_the_si(tumbled, found):
    for finding, stated in pairs(tumbled, found):
        in_si(stated.real.unit)
        if "temperature_c" in finding["at"]:
            condition = stated.conditions["temperature_c"]
            assert (condition.value, condition.unit) == (finding["at"]["temperature_c"], r"\degreecelsius")
            if "temperature_u_c" in finding["at"]:
                assert condition.uncertainty == pytest.approx(2 * finding["at"]["temperature_u_c"])


def test_characters_that_xml_cannot_have_do_not_break_it(smoke_copy):
    content = certificate(approve(smoke_copy, by="boris\x0b\x00"))
    assert text_of(parsed(content), "administrativeData/respPersons/respPerson/person") == "boris\ufffd\ufffd"


def test_a_report_that_replaces_another_names_it_with_its_hash(smoke_copy, tmp_path):
    old = "L3-2026-00001-XXXXX"
    (smoke_copy / issued_name(old, "pdf")).write_bytes(b"%PDF earlier")
    content = certificate(approve(smoke_copy, replaces=old))
    previous = parsed(content).find(".//{https://ptb.de/dcc}previousReport")
    assert text_of(previous, "referralID") == old
    assert text_of(previous, "value") == hashlib.sha256(b"%PDF earlier").hexdigest()
    (tmp_path / "made.xml").write_bytes(content)
    assert errors(tmp_path / "made.xml") == []


def test_names_are_in_both_languages(found):
    assert all(each.names.keys() == {"zh", "en"} for each in found)
    assert sum(each.names["zh"] != each.names["en"] for each in found) == len(found)


def test_who_what_when(tumbled):
    root, run = parsed(tumbled[1]), tumbled[0]
    core = "administrativeData/coreData"
    manifest = json.loads((run / "manifest.json").read_text())
    assert text_of(root, f"{core}/uniqueIdentifier") == f"SIMULATED-{NUMBER}"
    assert text_of(root, f"{core}/countryCodeISO3166_1") == "DE"
    assert text_of(root, f"{core}/receiptDate") == "2026-11-01"
    assert text_of(root, "administrativeData/items/item/identifications/identification/value") == "QF-0001"
    assert text_of(root, "administrativeData/calibrationLaboratory/contact/eMail") == "lab@example.org"
    assert text_of(root, "administrativeData/customer/name") == "Mole & Sons <b>"
    assert text_of(root, "administrativeData/respPersons/respPerson/person") == "boris"
    time = "".join(statements(root)["itb_time"].itertext()).strip()
    assert time == "/".join(manifest[each].replace("+00:00", "Z") for each in ("started", "ended"))
    methods = root.findall(".//{https://ptb.de/dcc}usedMethod/{https://ptb.de/dcc}norm")
    assert "IEEE Std 1293" in [each.text for each in methods]


def test_the_approved_report_is_inside(tumbled):
    assert document(parsed(tumbled[1])) == (issued_name(NUMBER, "pdf"), "application/pdf", PDF)


def test_a_simulated_run_says_in_the_words_of_machines_that_it_is_no_certificate(tumbled):
    stated = statements(parsed(tumbled[1]))["itb_simulated"]
    assert text_of(stated, "valid") == "false"
    assert text_of(stated, "traceable") == "false"


def test_instruments_have_their_certificates(tumbled):
    text = tumbled[1].decode()
    assert "SIM-2026-0101" in text
    assert "due 2030-12-31" in text


def test_a_calibration_file_is_in_it_as_it_is(tumbled):
    import base64

    root = parsed(tumbled[1])
    (data,) = root.findall(".//{https://ptb.de/dcc}byteData/{https://ptb.de/dcc}dataBase64")
    assert base64.b64decode(data.text) == (tumbled[0] / "calibration_a.json").read_bytes()


def test_a_result_without_a_value_has_words_and_no_number(tumbled, tmp_path, monkeypatch):
    from bench.reduce.stored_run import open_run
    from bench.report.dcc import write

    run = tumbled[0]
    with open_run(run) as stored:
        known = stored.evaluate()
        unit = known.units[0]
        first, second, *others = unit.findings
        bad = (
            replace(first, verdict="INVALID", flags=("u_unknown",)),
            replace(second, flags=("more_than",)),
            replace(others[0], value=math.nan),
        )
        altered = replace(known, units=(replace(unit, findings=(*bad, *others[1:])),))
        monkeypatch.setattr(stored, "evaluate", lambda: altered)
        monkeypatch.setattr(write, "_expect_as_sealed", lambda *_: None)
        content = write.certificate_of(stored)
    (tmp_path / "made.xml").write_bytes(content)
    left_out = [each for each in quantities(parsed(content)) if each.real is None]
    assert len(left_out) == 3
    assert sum("its uncertainty is not known" in each.instead for each in left_out) == 1
    assert sum("more than this" in each.instead for each in left_out) == 1
    assert next(each for each in left_out if "not known" in each.instead).conformity is None
    assert errors(tmp_path / "made.xml") == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda run: (run / "approval.json").unlink(), "is not approved"),
        (lambda run: approve(run, laboratory={}), "was approved without a laboratory"),
        (lambda run: (run / issued_name(NUMBER, "pdf")).unlink(), "is missing; restore it"),
        (lambda run: (run / issued_name(NUMBER, "pdf")).write_bytes(b"%PDF 2"), "has changed since it was written"),
    ],
)
def test_what_is_no_basis_of_a_certificate_is_refused(smoke_copy, change, words):
    change(approve(smoke_copy))
    with pytest.raises(InputError, match=words):
        certificate(smoke_copy)


def test_other_results_than_those_approved_are_refused(tumbled, monkeypatch):
    from bench.reduce.stored_run import open_run
    from bench.report.dcc.write import certificate_of

    with open_run(tumbled[0]) as stored:
        known = stored.evaluate()
        unit = known.units[0]
        findings = (replace(unit.findings[0], value=1.0), *unit.findings[1:])
        altered = replace(known, units=(replace(unit, findings=findings),))
        monkeypatch.setattr(stored, "evaluate", lambda: altered)
        with pytest.raises(InputError, match="differ from those that were approved"):
            certificate_of(stored)


def test_a_run_that_did_not_complete_is_refused(smoke_copy, monkeypatch):
    from bench.reduce.stored_run import open_run
    from bench.report.dcc.write import certificate_of

    approve(smoke_copy)
    with open_run(smoke_copy) as stored:
        monkeypatch.setattr(stored, "manifest", {**stored.manifest, "state": "aborted"})
        with pytest.raises(InputError, match="did not complete"):
            certificate_of(stored)


def test_the_command_writes_it_once_under_the_number_of_the_report(smoke_copy, bench_here, tmp_path):
    approve(smoke_copy)
    told = ("report", smoke_copy.name, "--runs", str(smoke_copy.parent), "--format", "dcc")
    assert bench_here(*told).returncode == 0
    path = smoke_copy / issued_name(NUMBER, "xml")
    before = hashlib.sha256(path.read_bytes()).hexdigest()
    assert verified(smoke_copy) == []
    again = bench_here(*told)
    assert (again.returncode, "is issued already" in again.stderr) == (2, True)
    assert bench_here(*told, "--out", str(tmp_path / "copies/other.xml")).returncode == 0
    assert hashlib.sha256(path.read_bytes()).hexdigest() == before
    assert (tmp_path / "copies/other.xml").exists()
    path.write_bytes(b"<other/>")
    assert "has changed" in verified(smoke_copy)[0]


def test_the_command_refuses_a_key_for_another_form(smoke_copy, bench_here):
    done = bench_here("report", smoke_copy.name, "--runs", str(smoke_copy.parent), "--sign", "station.yaml")
    assert (done.returncode, "--sign is for --format dcc" in done.stderr) == (2, True)
