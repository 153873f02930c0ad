"""A whole run whose instruments have Digital Calibration Certificates: they are in its record, budgets and report."""

import pytest

from bench.reduce.stored_run import open_run
from campaigns.truth.campaign import compare
from tests.support.runs import ROOT, SHORT, read_json, run_short

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def tumble(tmp_path_factory):
    bench = ROOT / "config/certificates.yaml"
    return run_short(tmp_path_factory.mktemp("certified"), bench=bench, settings=SHORT, no_report=False)


def test_it_finds_the_truth_with_the_corrections_of_the_certificates(tumble):
    assert tumble.problems == []
    comparisons = compare([tumble.path])
    assert len(comparisons) == 15
    assert max(abs(comparison.ratio) for comparison in comparisons) < 3.5


def test_the_report_names_number_file_and_due_date(tumble):
    page = (tumble.path / "report.html").read_text("utf-8")
    for number, name in ((201, "head"), (203, "thermometer"), (204, "source"), (205, "meter")):
        assert f"SIM-2026-0{number}" in page
        assert f"from certificates/{name}.xml, not signed" in page
    assert page.count("due 2030-12-31") == 5
    assert "unit_temperature: corrected by +0.12 °C at -55 °C" in page


def test_uncertainties_of_the_certificates_are_in_the_budgets(tumble):
    found = {finding["quantity"]: finding for finding in read_json(tumble, "results.json")["findings"]}
    assert found["K0"]["at"]["temperature_u_c"] == pytest.approx(0.3, rel=0.02)  # 0.6 °C, k = 2, and 0.2 % of it
    budget = {line["source"]: line["u"] for line in found["misalignment"]["budget"]}
    assert max(budget.values()) == pytest.approx(10 / 2 / 3600 * 3.14159 / 180, rel=0.1)  # zero of the head


def test_the_record_has_the_certificates_under_its_seal_and_is_reduced_by_them_again(tumble):
    hashes = read_json(tumble, "manifest.json")["hashes"]
    names = [f"certificates/{name}.xml" for name in ("head", "thermometer", "source", "meter")]
    assert set(names) <= set(hashes)
    kept, given = ([(folder / name).read_bytes() for name in names] for folder in (tumble.path, ROOT / "config"))
    assert kept == given
    with open_run(tumble.path) as stored:
        assert stored.bench.devices["dvm"].calibration.U.gain == 8e-6
        again = stored.evaluate()
    assert [unit.findings for unit in again.units] == [unit.findings for unit in tumble.results.units]
