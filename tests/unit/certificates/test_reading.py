"""Certificates of instruments in a bench file: their values, and what is refused with its file and line."""

import re
import shutil
from pathlib import Path

import pytest

from bench.certificates.certificate import read_certificate
from bench.config.bench import load_bench, load_kept_bench
from bench.errors import InputError
from tests.support.dcc import errors
from tests.support.runs import ROOT

EXAMPLES = sorted((ROOT / "config/certificates").glob("*.xml"))
METER = (ROOT / "config/certificates/meter.xml").read_text("utf-8")
UNCERTAINTY = re.search("<si:expandedUnc>.*?</si:expandedUnc>", METER, re.DOTALL)[0]  # of the gain

DVM = "{dcc: certificates/meter.xml}"


@pytest.fixture
def bench_with(tmp_path):
    """Return a function that edits a certificate, the bench file, or both, and loads the bench."""
    shutil.copytree(ROOT / "config", tmp_path / "config")

    def loaded(*edits, file="meter.xml", bench=(), extra=""):
        (tmp_path / "config/certificates/c.xml").write_text(extra, "utf-8")
        for path, pairs in ((tmp_path / "config/certificates" / file, edits), (BENCH(tmp_path), bench)):
            text = path.read_text("utf-8")
            for old, new in pairs:
                assert old in text, old
                text = text.replace(old, new)
            path.write_text(text, "utf-8")
        return load_bench(BENCH(tmp_path)).bench

    return loaded


def BENCH(folder: Path) -> Path:  # noqa: N802
    return folder / "config/certificates.yaml"


def refused(bench_with, *edits, **options):
    with pytest.raises(InputError) as found:
        bench_with(*edits, **options)
    return str(found.value)


def test_the_examples_are_valid_by_the_schemas():
    assert len(EXAMPLES) == 4
    assert errors(*EXAMPLES) == []


def test_values_uncertainties_and_dates_are_those_of_the_certificates(bench_with):
    bench = bench_with()
    head, source, meter = (bench.devices[role].calibration for role in ("head", "source", "dvm"))
    thermometer = bench.readings["unit_temperature"].calibration
    assert (meter.U.gain, meter.U.offset) == (8e-6, 2e-6)
    assert (meter.corrections.gain, meter.corrections.offset) == (-3e-6, pytest.approx(0.4e-6, rel=1e-14))
    assert head.U.harmonics == (2, 2, 2, 2)
    assert (head.U.zero, head.U.repeatability) == (10, 0.2)
    assert [(row.at, row.add) for row in head.corrections.angle][3] == (90, -0.9)
    assert (source.U.gain, source.U.drift) == (40e-6, 2e-6)
    assert [row.add for row in source.corrections.current] == pytest.approx([3.1e-7, 1.4e-7, -2e-8, -1.7e-7, -3.5e-7])
    assert [row.at for row in source.corrections.current] == pytest.approx([-0.02, -0.01, 0, 0.01, 0.02])
    assert (thermometer.U.offset, thermometer.U.gain, thermometer.U.drift) == (0.6, 0.002, 0.12)
    assert [row.add for row in thermometer.corrections] == [0.12, 0.05, -0.01, -0.06, -0.15]
    for each, number in ((head, 1), (thermometer, 3), (source, 4), (meter, 5)):
        assert each.certificate == f"SIM-2026-020{number}"
        assert (str(each.date), str(each.due), each.k) == ("2025-12-16", "2030-12-31", 2)
        assert each.laboratory == "Example Laboratory"


def test_kelvin_are_read_as_differences_and_as_temperatures(bench_with):
    kelvin = ("-55 -20 20 60 105</si:valueXMLList>", "218.15 253.15 293.15 333.15 378.15</si:valueXMLList>")
    unit = (r"<si:unitXMLList>\degreecelsius", r"<si:unitXMLList>\kelvin")
    found = bench_with(kelvin, unit, file="thermometer.xml").readings["unit_temperature"].calibration
    assert [row.at for row in found.corrections] == pytest.approx([-55, -20, 20, 60, 105])
    assert [row.add for row in found.corrections] == [0.12, 0.05, -0.01, -0.06, -0.15]


def hybrid(values, unit, others, other_unit):
    parts = ((values, unit), (others, other_unit))
    lists = "".join(
        f"<si:realListXMLList><si:valueXMLList>{each}</si:valueXMLList><si:unitXMLList>{known}</si:unitXMLList>"
        "</si:realListXMLList>" for each, known in parts
    )  # fmt: skip
    return f"<si:hybrid>{lists}</si:hybrid>"


@pytest.mark.parametrize(
    "first",
    [("218.15 253.15 293.15 333.15 378.15", r"\kelvin"), ("-67 -4 68 140 221", r"\fahrenheit")],
)
def test_of_a_value_in_two_units_the_first_that_is_known_counts(bench_with, first):
    """As in the good practice for temperature: kelvin and °C, with the calibration points as metadata."""
    text = (ROOT / "config/certificates/thermometer.xml").read_text("utf-8")
    old = re.search(r"<si:realListXMLList>.*?</si:realListXMLList>", text, re.DOTALL)[0]
    celsius = ("-55 -20 20 60 105", r"\degreecelsius")
    meta = (
        "<dcc:measurementMetaData><dcc:metaData><dcc:data><dcc:quantity refType='basic_measuredValue'>"
        f"{hybrid('1 2', '.', '3 4', '.')}</dcc:quantity></dcc:data></dcc:metaData></dcc:measurementMetaData>"
    )
    bench = bench_with((old, hybrid(*first, *celsius) + meta), file="thermometer.xml")
    rows = bench.readings["unit_temperature"].calibration.corrections
    assert [row.at for row in rows] == pytest.approx([-55, -20, 20, 60, 105])


def test_a_table_of_corrections_has_the_other_sign(bench_with):
    names = ("basic_measurementError", "basic_measurementError_correction")
    rows = bench_with(names, file="thermometer.xml").readings["unit_temperature"].calibration.corrections
    assert [row.add for row in rows] == [-0.12, -0.05, 0.01, 0.06, 0.15]


def test_a_list_of_single_values_is_read(bench_with):
    listed = """<si:list>
                <si:realList>
                  <si:listUnit>\\arcsecond</si:listUnit>
                  <si:listUnivariateUnc>
                    <si:expandedUnc>
                      <si:uncertainty>3</si:uncertainty>
                      <si:coverageFactor>2</si:coverageFactor>
                      <si:coverageProbability>0.9545</si:coverageProbability>
                    </si:expandedUnc>
                  </si:listUnivariateUnc>
                  <si:real><si:value>0</si:value></si:real>
                  <si:real><si:value>0.0</si:value></si:real>
                </si:realList>
              </si:list>"""
    text = (ROOT / "config/certificates/head.xml").read_text("utf-8")
    begin = text.index("<si:realListXMLList>", text.index("itb_harmonics"))
    old = text[begin : text.index("</si:realListXMLList>", begin) + len("</si:realListXMLList>")]
    bench = bench_with((old, listed), file="head.xml")
    assert bench.devices["head"].calibration.U.harmonics == (3, 3)


def test_the_uncertainties_of_d_si_2_2_are_read(bench_with):
    later = """<si:measurementUncertaintyUnivariate>
                <si:expandedMU>
                  <si:valueExpandedMU>9e-6</si:valueExpandedMU>
                  <si:coverageFactor>2</si:coverageFactor>
                  <si:coverageProbability>0.95</si:coverageProbability>
                </si:expandedMU>
              </si:measurementUncertaintyUnivariate>
"""
    bench = bench_with((UNCERTAINTY, later), ('schemaVersion="3.1.2"', 'schemaVersion="3.3.0"'))
    assert bench.devices["dvm"].calibration.U.gain == 9e-6


INTERVAL = """<si:coverageIntervalMU>
                  <si:valueStandardMU>4e-6</si:valueStandardMU>
                  <si:intervalMin>-1e-5</si:intervalMin>
                  <si:intervalMax>1e-5</si:intervalMax>
                  <si:coverageProbability>0.95</si:coverageProbability>
                </si:coverageIntervalMU>"""
STANDARD = "<si:standardMU><si:valueStandardMU>4e-6</si:valueStandardMU></si:standardMU>"


@pytest.mark.parametrize("stated", [INTERVAL, STANDARD])
def test_the_standard_uncertainties_of_d_si_2_2_are_read_with_k_1(bench_with, stated, tmp_path):
    later = f"<si:measurementUncertaintyUnivariate>{stated}</si:measurementUncertaintyUnivariate>"
    bench = bench_with((UNCERTAINTY, later), ('schemaVersion="3.1.2"', 'schemaVersion="3.3.0"'))
    found = bench.devices["dvm"].calibration
    assert (found.k, found.U.gain, found.U.offset) == (2, 8e-6, 2e-6)
    assert errors(tmp_path / "config/certificates/meter.xml") == []


UNCERTAIN_LIST = re.compile("<si:expandedUncXMLList>.*?</si:expandedUncXMLList>", re.DOTALL)


@pytest.mark.parametrize(
    ("stated", "U"),
    [
        ("<si:standardMUXMLList><si:valueStandardMUXMLList>0.1 0.2 0.3 0.4 0.5</si:valueStandardMUXMLList>"
         "</si:standardMUXMLList>", 1),
        ("<si:coverageIntervalMUXMLList><si:valueStandardMUXMLList>0.4</si:valueStandardMUXMLList><si:intervalMinXMLList>"
         "-1</si:intervalMinXMLList><si:intervalMaxXMLList>1</si:intervalMaxXMLList><si:coverageProbabilityXMLList>0.95"
         "</si:coverageProbabilityXMLList></si:coverageIntervalMUXMLList>", 0.8),
        ("<si:expandedMUXMLList><si:valueExpandedMUXMLList>0.7</si:valueExpandedMUXMLList><si:coverageFactorXMLList>2"
         "</si:coverageFactorXMLList><si:coverageProbabilityXMLList>0.95</si:coverageProbabilityXMLList>"
         "</si:expandedMUXMLList>", 0.7),
    ],
)  # fmt: skip
def test_the_uncertainties_of_lists_of_d_si_2_2_are_read(bench_with, tmp_path, stated, U):  # noqa: N803
    text = (ROOT / "config/certificates/thermometer.xml").read_text("utf-8")
    singles = [(each, single_of_2_2(each)) for each in set(SINGLE.findall(text))]
    (old,) = set(UNCERTAIN_LIST.findall(text))
    later = f"<si:measurementUncertaintyUnivariateXMLList>{stated}</si:measurementUncertaintyUnivariateXMLList>"
    version = ('schemaVersion="3.1.2"', 'schemaVersion="3.3.0"')
    bench = bench_with((old, later), version, *singles, file="thermometer.xml")
    found = bench.readings["unit_temperature"].calibration
    assert (found.k, found.U.offset) == (2, pytest.approx(U, rel=1e-12))
    assert [row.add for row in found.corrections] == [0.12, 0.05, -0.01, -0.06, -0.15]
    assert errors(tmp_path / "config/certificates/thermometer.xml") == []


SINGLE = re.compile("<si:expandedUnc>.*?</si:expandedUnc>", re.DOTALL)


def single_of_2_2(text):
    names = text.replace("expandedUnc>", "expandedMU>").replace("uncertainty>", "valueExpandedMU>")
    return f"<si:measurementUncertaintyUnivariate>{names}</si:measurementUncertaintyUnivariate>"


@pytest.mark.parametrize("of_all", [True, False])
def test_the_uncertainties_in_lists_of_values_of_d_si_2_2_are_read(bench_with, tmp_path, of_all):
    """Of all values of a list, and of one: the name of the latter has another order of letters in the schema."""
    part = single_of_2_2(UNCERTAINTY)
    inner = re.sub("8e-6", "3", re.sub("</?si:measurementUncertaintyUnivariate>", "", part))
    around = "listMeasurementUncertaintyUnivariate" if of_all else "measurementUncertaintyUnivaraite"
    stated = f"<si:{around}>{inner}</si:{around}>"
    common, own = (stated, "") if of_all else ("", stated)
    real = f"<si:real><si:value>0</si:value>{own}</si:real>"
    listed = f"<si:list><si:realList><si:listUnit>\\arcsecond</si:listUnit>{common}{real * 2}</si:realList></si:list>"
    text = (ROOT / "config/certificates/head.xml").read_text("utf-8")
    begin = text.index("<si:realListXMLList>", text.index("itb_harmonics"))
    old = text[begin : text.index("</si:realListXMLList>", begin) + len("</si:realListXMLList>")]
    bench = bench_with((old, listed), ('schemaVersion="3.1.2"', 'schemaVersion="3.3.0"'), file="head.xml")
    assert bench.devices["head"].calibration.U.harmonics == (3, 3)
    assert errors(tmp_path / "config/certificates/head.xml") == []


@pytest.mark.parametrize("version", ["3.2.1", "3.3.0"])
def test_certificates_of_later_versions_are_read(bench_with, tmp_path, version):
    """The examples are certificates of these versions too, and their values the same."""
    kept = bench_with()
    found = bench_with(('schemaVersion="3.1.2"', f'schemaVersion="{version}"'))
    assert found.devices["dvm"].calibration.U == kept.devices["dvm"].calibration.U
    assert errors(tmp_path / "config/certificates/meter.xml") == []


def test_a_number_that_is_missing_is_none_of_a_quantity_that_is_not_used(bench_with):
    """D-SI 2.2 has NaN for a number."""
    quantity = METER[METER.index("<dcc:quantity") : METER.index("</dcc:quantity>") + len("</dcc:quantity>")]
    other = re.sub(r"<si:value>[^<]*<", "<si:value>NaN<", re.sub('refType="[^"]*"', 'refType="other"', quantity))
    assert bench_with((quantity, quantity + other)).devices["dvm"].calibration.U.gain == 8e-6


def test_a_part_of_an_item_is_one_of_its_items(bench_with, tmp_path):
    item = METER[METER.index("<dcc:item>") : METER.index("</dcc:item>") + len("</dcc:item>")]
    whole = item.replace("SIM-3458A-01", "SYSTEM-1").replace(
        "</dcc:item>", f"<dcc:subItems>{item}</dcc:subItems></dcc:item>"
    )
    bench_with((item, whole), ('schemaVersion="3.1.2"', 'schemaVersion="3.3.0"'))
    path = tmp_path / "config/certificates/meter.xml"
    found = read_certificate(path)
    assert found.serials == ("SYSTEM-1", "SIM-3458A-01")
    assert len(found.items) == 2
    assert errors(path) == []


def test_standard_uncertainties_are_read_with_k_1(bench_with):
    standard = """<si:coverageInterval>
                <si:standardUnc>4e-6</si:standardUnc>
                <si:intervalMin>-1e-5</si:intervalMin>
                <si:intervalMax>1e-5</si:intervalMax>
                <si:coverageProbability>0.95</si:coverageProbability>
              </si:coverageInterval>
"""
    found = bench_with((UNCERTAINTY, standard)).devices["dvm"].calibration
    assert (found.k, found.U.gain, found.U.offset) == (2, 8e-6, 2e-6)


def test_another_coverage_factor_is_kept_and_several_become_2(bench_with):
    both = ("<si:coverageFactor>2</si:coverageFactor>", "<si:coverageFactor>2.5</si:coverageFactor>")
    found = bench_with(both).devices["dvm"].calibration
    assert (found.k, found.U.gain) == (2.5, 8e-6)
    one = UNCERTAINTY.replace("Factor>2<", "Factor>2.5<")
    text = (one, one.replace("Factor>2.5<", "Factor>3<"))
    found = bench_with(text).devices["dvm"].calibration
    assert (found.k, found.U.gain, found.U.offset) == (2, pytest.approx(8e-6 * 2 / 3), pytest.approx(2e-6 * 2 / 2.5))


def test_quantities_of_others_are_chosen_by_name_and_an_error_has_the_other_sign(bench_with):
    edits = (('refType="itb_gain"', 'refType="basic_measurementError" id="gainerr"'),)
    chosen = "{dcc: certificates/meter.xml, quantities: {gain: gainerr, offset: Constant correction}}"
    bench = bench_with(*edits, bench=((DVM, chosen),))
    assert bench.devices["dvm"].calibration.corrections.gain == 3e-6


def test_what_a_certificate_lacks_is_stated_in_the_bench_file(bench_with):
    edit = ('refType="itb_drift"', 'refType="other"')
    own = "{dcc: certificates/source.xml, U: {drift: 3 ppm/h}, due: 2029-01-01}"
    found = bench_with(edit, file="source.xml", bench=(("{dcc: certificates/source.xml}", own),)).devices["source"]
    assert found.calibration.U.drift == 3e-6
    assert str(found.calibration.due) == "2029-01-01"


def test_a_period_of_validity_gives_the_due_date(bench_with):
    period = ("<dcc:date>2030-12-31</dcc:date>", "<dcc:date>2028-02-29</dcc:date><dcc:period>P1Y</dcc:period>")
    kind = (' refType="itb_due"', "")
    assert str(bench_with(period, kind).devices["dvm"].calibration.due) == "2029-02-28"


@pytest.mark.parametrize(
    ("edits", "words"),
    [
        ([('schemaVersion="3.1.2"', 'schemaVersion="2.4.0"')], "meter.xml:3: is a certificate by version 2.4.0"),
        ([("SIM-3458A-01", "SIM-3458A-02")], "meter.xml:3: is of serial number SIM-3458A-02, the bench file has"),
        ([("<dcc:date>2030-12-31</dcc:date>", "")], "state it in the bench file: due"),
        ([(r"\micro\volt</", r"\micro\ampere</")], r"is in \micro\ampere, expected a quantity in V"),
        ([(r"\micro\volt</", r"\furlong</")], r"has the unit \furlong, which this program does not know"),
        ([(UNCERTAINTY, "")], "'Correction relative to the reading' has no uncertainty"),
        ([("8e-6", "eight")], "'eight' is not a decimal number"),
        ([("8e-6", "NaN")], "'Correction relative to the reading' has no number"),
        ([("8e-6", "inf")], "'inf' is not a decimal number"),
        ([("8e-6", "-8e-6")], "uncertainty below 0"),
        ([("<si:coverageFactor>2<", "<si:coverageFactor>0<")], "coverage factor that is not above 0"),
        ([("itb_gain", "itb_gian")], "no quantity 'itb_gian'; did you mean 'itb_gain'?"),
        ([("itb_gain", "a"), ("itb_offset", "b")], "has none of the quantities itb_gain, itb_offset"),
        ([("itb_offset", "itb_gain")], "has 2 quantities 'itb_gain'"),
        ([("endPerformanceDate>2025-12-16", "endPerformanceDate>16.12.2025")], "'16.12.2025' is not a date"),
        ([("<dcc:uniqueIdentifier>SIM-2026-0205</dcc:uniqueIdentifier>", "")], "has no uniqueIdentifier"),
        ([("-10 10", "-10 0 10")], "has 3 values, 2 of one unit are needed"),
        ([(r"\volt</si:unitXMLList>", r"\ampere</si:unitXMLList>")], "range: certificate SIM-2026-0205 covers -10 A"),
        ([("-10 10", "-1 1")], "range: certificate SIM-2026-0205 covers -1 V to 1 V only"),
        ([("digitalCalibrationCertificate", "certificate")], "is no digital calibration certificate"),
        ([("</dcc:administrativeData>", "")], "is not XML"),
        ([("<dcc:declaration>", "<dcc:valid>false</dcc:valid><dcc:declaration>")], "states that it is not valid: Next"),
        ([("<dcc:declaration>", "<dcc:validXMLList>true 0</dcc:validXMLList><dcc:declaration>")], "is not valid: Next"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_with_file_and_line(bench_with, edits, words):
    text = refused(bench_with, *edits)
    assert words in text
    assert "certificates.yaml:" in text
    if "range:" not in words:
        assert "certificates/meter.xml:" in text


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (DVM, "{dcc: certificates/metre.xml}", "there is no file 'certificates/metre.xml'"),
        (DVM, "{dcc: ../../meter.xml}", "leaves the folder"),
        (DVM, "{dcc: certificates/meter.xml, k: 2}", "k: is in the certificate"),
        (DVM, "{dcc: certificates/meter.xml, U: {gain: 1 ppm}}", "and so does U"),
        (DVM, "{dcc: certificates/meter.xml, U: 3}", "expected keys and their values"),
        (DVM, "{dcc: certificates/meter.xml, due: 2031-06-01}", "is due on 2030-12-31"),
        (DVM, "{dcc: certificates/meter.xml, quantities: {gian: x}}", "no key 'gian'; did you mean 'gain'?"),
        ("thermometer.xml,", "thermometer.xml, U: {offset: 1 °C},", "states offset, and so does U"),
        (DVM, "{dcc: certificates/meter.xml, quantities: {gain: gian}}", "no quantity 'gian'"),
        (DVM, "{serial: X, U: {gain: 1 ppm}}", "is for a calibration by a certificate file"),
        (DVM, "{dcc: 3}", "dcc: is 3, expected the name of a file"),
        (DVM, "{dcc: certificates/meter.xml, signed_by: no.pem}", "signed_by: there is no file"),
        (", serial: SIM-PT-01}", "}", "needs the serial number of the instrument"),
        (", serial: SIM-PT-01}", ", serial: SIM-PT-02}", "thermometer.xml:3: is of serial number SIM-PT-01"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_the_bench_file_is_refused_at_its_line(bench_with, old, new, words):
    text = refused(bench_with, bench=((old, new),))
    assert words in text
    assert len(text.splitlines()) == 1


def test_an_instrument_without_values_takes_number_and_dates(bench_with):
    safe = "    safe: {temperature: 25 °C}\n"
    chamber = (safe, f"{safe}    calibration: {{dcc: certificates/c.xml}}\n")
    text = METER.replace("SIM-3458A-01", "SIM-F4T-01").replace("itb_gain", "gain").replace("itb_offset", "offset")
    found = bench_with(extra=text, bench=(chamber,)).devices["chamber"].calibration
    assert (found.certificate, str(found.due)) == ("SIM-2026-0205", "2030-12-31")


def test_limits_beyond_a_certificate_are_a_warning(bench_with, tmp_path):
    from bench.app.request import RunRequest, load_checked

    bench_with(("-55 -20 20 60 105", "-40 -20 20 60 85"), file="thermometer.xml")
    found = load_checked(RunRequest("smoke", bench=str(BENCH(tmp_path)), units=("A",)))
    (words,) = [each.text for each in found.warnings if each.rule == "beyond-certificate"]
    assert "covers -40 °C to 85 °C only" in words


ENTITIES = {
    "an external file": '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/hostname">]>',
    "an entity bomb": '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>',
    "a document type": '<!DOCTYPE x SYSTEM "http://192.0.2.1/x.dtd">',
}


@pytest.mark.parametrize("declared", ENTITIES.values(), ids=ENTITIES)
def test_entities_and_other_files_are_refused_before_they_are_read(bench_with, declared):
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    text = refused(bench_with, (head, head + declared + "\n"), ("SIM-2026-0205", "&b;" if "b " in declared else "x"))
    assert "meter.xml:2: declares a document type" in text


def test_a_file_that_is_no_utf_8_or_too_large_or_too_deep_is_refused(tmp_path):
    path = tmp_path / "big.xml"
    with path.open("wb") as file:
        file.truncate(2**30)
    with pytest.raises(InputError, match="has 1073741824 bytes, at most"):
        read_certificate(path)
    path.write_bytes('<?xml version="1.0" encoding="UTF-16"?>\n<!DOCTYPE x []><x/>'.encode("utf-16"))
    with pytest.raises(InputError, match=r"big\.xml:1: is not UTF-8"):
        read_certificate(path)
    path.write_text("<a>" * 5000)
    with pytest.raises(InputError, match=r"big\.xml:1: is not XML"):
        read_certificate(path)
    path.write_text("")
    with pytest.raises(InputError, match="is not XML"):
        read_certificate(path)
    with pytest.raises(InputError, match="is a folder"):
        read_certificate(tmp_path)


def test_a_kept_bench_needs_its_certificates_and_has_their_values(tmp_path):
    shutil.copy(BENCH(ROOT), tmp_path / "bench.yaml")
    with pytest.raises(InputError, match="there is no such file"):
        load_kept_bench(tmp_path / "bench.yaml")
    shutil.copytree(ROOT / "config/certificates", tmp_path / "certificates")
    assert load_kept_bench(tmp_path / "bench.yaml").devices["dvm"].calibration.U.gain == 8e-6
