"""Reports in other languages: what their catalogues have to hold, and what comes of it."""

import ast
import re
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path
from string import Formatter
from typing import get_args

import numpy as np
import pypdf
import pytest
from jinja2 import Environment, nodes

from bench.config.document import read_document
from bench.config.fixture import Compass, Direction
from bench.figures import after_run, languages, svg, words
from bench.figures.languages import LANGUAGES, catalogue_of, language, tr
from bench.methods.channel.words import NO_RATE, SERVES_TOO, SLOPE_FROM
from bench.methods.imu.words import FEW_TEMPERATURES, HEADINGS_UNKNOWN
from bench.methods.indexing.words import FEW_ANGLES, WARMED
from bench.metrology.least_squares import NotDetermined
from bench.metrology.nonlinear import NotConverged
from bench.metrology.results.curves import Equation
from bench.metrology.results.flag import Flag
from bench.overview import words as of_cards
from bench.overview.site import PLACES
from bench.reduce.stored_run import open_run
from bench.report import flag_words
from bench.report.tables import VARIABLES, WORST, model_sheet
from bench.report.write import write_report
from bench.sequence.method import known_methods, texts_of
from bench.station.prepare.sequences import head_of, purpose_of
from bench.web import news, sentence
from bench.web.pages import alerts, instruments, panels, places, problems
from drivers.installed import loaded
from tests.support.runs import ROOT, run_short

OTHERS = LANGUAGES[1:]
HOSTILE = "{text.__class__}<b>"
VERDICTS = ("PASS", "FAIL", "INVALID", "INCOMPLETE", "ERROR", "ABORTED", "NOT JUDGED", "not judged")
CHINESE = re.compile("[\u4e00-\u9fff]")

GENERIC_WORDS = (
    {
        "REASONS": words.REASONS._generic,
        "READINGS": flag_words._READINGS._generic,
        "QUANTITIES": flag_words._QUANTITIES._generic,
        "VARIABLES": VARIABLES._generic,
        "NOTES": flag_words.NOTES,
        "SOURCES": words.SOURCES,
    },
)
KINDS = (
    *GENERIC_WORDS[0], "UNITS", "PARTS", "NAMES", "FORMS", "WHERE", "CONDITIONS",
)  # fmt: skip


def words_of_methods():
    targets = {method.words for method in known_methods().values() if method.words}
    return [loaded(target) for target in sorted(targets)]


class Missing(dict):
    """A catalogue that keeps what it was asked for in vain."""

    def __init__(self, known):
        super().__init__(known)
        self.missed = set()

    def get(self, text, otherwise=None):
        if text not in self:
            self.missed.add(text)
        return super().get(text, otherwise)


@pytest.fixture
def missing(monkeypatch):
    catalogue = Missing(catalogue_of("zh"))
    monkeypatch.setattr(languages, "catalogue_of", lambda name: catalogue if name == "zh" else {})
    return catalogue.missed


@pytest.fixture
def run(tumble_run, tmp_path):
    """The directory of a tumble; reports are written into it."""
    return Path(shutil.copytree(tumble_run.path, tmp_path / tumble_run.path.name))


def report(run, form, lang):
    with open_run(run) as stored:
        return write_report(stored, form, lang)


def texts_in_python():
    """The literal first arguments of `tr` in every module."""
    for path in (ROOT / "bench").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "tr":
                first = node.args[0]
                for text in (first.body, first.orelse) if isinstance(first, ast.IfExp) else (first,):
                    if isinstance(text, ast.Constant):
                        yield text.value


def texts_in_templates():
    folders = ("bench/report/templates", "bench/web/templates")
    for path in (each for folder in folders for each in (ROOT / folder).rglob("*.j2")):
        for call in Environment().parse(path.read_text("utf-8")).find_all(nodes.Call):
            if isinstance(call.node, nodes.Name) and call.node.name == "tr" and isinstance(call.args[0], nodes.Const):
                yield call.args[0].value


def texts_in_tables():
    """What is translated where it is looked up."""
    tables = (
        words.ENDINGS,
        words.REASONS,
        words.CONTENTS,
        after_run.SENTENCES,
        words.CONDITIONS,
        flag_words._READINGS,
        flag_words._UNITS,
        flag_words._QUANTITIES,
        flag_words._PARTS,
        flag_words._WHERE,
        VARIABLES,
        WORST,
        sentence.NOW,
        sentence.NEXT,
        sentence.STATES,
        news.NEWS,
        panels.TITLES,
        problems.TITLES,
        instruments.GUARDING,
        alerts.KINDS,
        alerts.STATES,
        of_cards.NAMES,
        of_cards.GROUPS,
    )
    yield from (*places.TITLES, *(each.title for each in PLACES))
    for table in tables:
        yield from table.values()
    yield from (
        *texts_of("NOTES", flag_words.NOTES),
        *texts_of("FORMS", ()),
        *texts_of("SOURCES", words.SOURCES),
        *get_args(Direction),
        *get_args(Compass),
    )
    yield from (*VERDICTS, *words.SAID, "unit temperature")
    for method in known_methods().values():
        yield from (method.title, method.meaning)
        for quantity in method.quantities:
            yield from words.quantity_text(quantity).split(": ")


def test_a_flag_of_a_reading_and_one_of_a_part_have_no_name_in_common():
    """Both follow a step and a colon: one name would have the words of the other."""
    tables = (flag_words._READINGS, flag_words._PARTS)
    assert not set.intersection(*map(set, tables))


@pytest.mark.parametrize("kind", KINDS)
def test_no_two_methods_have_words_for_one_flag(kind):
    """Each would get those of the first."""
    of_methods = [each[kind] for each in (*GENERIC_WORDS, *words_of_methods()) if kind in each]
    keys = [key for of_one in of_methods for key in of_one]
    assert keys
    assert [key for key, times in Counter(keys).items() if times > 1] == []


def test_every_kind_of_words_of_a_method_is_looked_up():
    assert {kind for each in words_of_methods() for kind in each} <= {*KINDS, "CONTENTS"}


@pytest.mark.parametrize("name", OTHERS)
def test_every_text_of_a_report_is_in_the_catalogue(name):
    texts = {*texts_in_python(), *texts_in_templates(), *texts_in_tables()}
    assert len(texts) > 200
    assert sorted(texts - set(catalogue_of(name))) == []


@pytest.mark.parametrize("name", OTHERS)
def test_the_titles_of_shipped_sequences_are_in_the_catalogue(name):
    titles = {read_document(path).value["title"] for path in (ROOT / "sequences").glob("*.yaml")}
    assert len(titles) > 10
    assert sorted(titles - set(catalogue_of(name))) == []


@pytest.mark.parametrize("name", OTHERS)
def test_purpose_presets_and_parameters_of_shipped_sequences_are_in_the_catalogue(name):
    lacking = []
    for path in sorted((ROOT / "sequences").glob("*.yaml")):
        document = read_document(path)
        blocks = (document.value.get(key, {}) for key in ("parameters", "presets"))
        texts = [purpose_of(head_of(document.text)), *(each["help"] for block in blocks for each in block.values())]
        lacking += [text for text in texts if text not in catalogue_of(name)]
    assert lacking == []


def sources_of_uncertainty():
    """The literal names of sources in the analyses, as in `BudgetLine("head: zero", …)`."""
    for path in [*(ROOT / "bench/metrology").rglob("*.py"), *(ROOT / "bench/methods").glob("*/reduction/*.py")]:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
                called = getattr(node.func, "id", getattr(node.func, "attr", ""))
                if called in ("BudgetLine", "common"):
                    yield node.args[0].value


def test_every_source_of_uncertainty_is_told_in_chinese(missing):
    sources = set(sources_of_uncertainty())
    assert len(sources) > 30
    with language("zh"):
        reported = {source: words.source_in_words(source) for source in sources}
    assert sorted(missing) == []
    assert [source for source, shown in reported.items() if re.search("[a-z]{3}", shown.replace("alias", ""))] == []


def test_what_a_source_is_of_and_the_signs_between_are_in_the_language_of_the_report():
    with language("zh"):
        assert words.source_in_words("src_1g: source: gain") == "src_1g：电流源：增益"
        assert words.source_in_words("unit_temperature: gain") == "unit_temperature：增益"
        assert words.quantity_in_words("K0/temperature_coefficient") == "零偏 K0：温度系数"
    assert words.source_in_words("src_1g: source: gain") == "src_1g: source: gain"


@pytest.mark.parametrize(
    ("flag", "chinese"),
    [
        (Flag(NO_RATE, at="skew"), "skew：不作结论：有脉冲频率为 0"),
        (Flag(HEADINGS_UNKNOWN, values={"untold": 4, "count": 96}), "96 个位置中有 4 个无法由陀螺仪得出方位"),
        (Flag(FEW_ANGLES, at="end up", values={"least": 3}), "+Z 向上：剩余的不同角度少于 3 个"),
        (Flag(FEW_TEMPERATURES, at="T=20", values={"sensor": "acc_x"}), "T=20：acc_x 的温度计读数不足一半"),
        (Flag("of a plug-in: something it says"), "of a plug-in: something it says"),
        (Flag(WARMED, at=HOSTILE, values={"change": "{x}"}), f"{HOSTILE}：温度变化了 {{x}} °C"),
        (replace(NotDetermined(["a", "b"], rank=1, of=2, condition=np.inf).note, at="clock"), None),
        (replace(NotConverged(Flag("no step makes the residuals smaller")).note, at="model"), None),
    ],
)
def test_sentences_of_analyses_are_in_the_language_of_the_report(flag, chinese):
    assert flag_words.flag_in_words(flag).endswith(flag.code.format(**flag.values))
    with language("zh"):
        told = flag_words.flag_in_words(flag)
    assert CHINESE.search(told) if chinese is None else told == chinese


def test_every_sentence_that_a_reduction_gives_as_a_flag_is_translated():
    """One that is neither a name nor among the words of its method would stay English."""
    known = {*flag_words._UNITS, *flag_words._PARTS, *texts_of("NOTES", flag_words.NOTES), flag_words.SAMPLES}
    calls = [
        (path.name, node.args[0].value)
        for path in [*(ROOT / "bench/metrology").rglob("*.py"), *(ROOT / "bench/methods").glob("*/reduction/*.py")]
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Flag" and node.args
        if isinstance(node.args[0], ast.Constant)
    ]
    assert len(calls) > 30
    assert [call for call in calls if " " in call[1] and call[1] not in known] == []


def test_what_people_type_stays_as_they_typed_it_and_what_the_program_says_is_told_in_the_language():
    with language("zh"):
        message = [words.answer_text(text) for text in ("done", "scripted technician", "air", "93 °", HOSTILE)]
    assert message == ["已完成", "脚本模拟的操作员", "air", "93 °", HOSTILE]


def test_an_equation_keeps_its_symbols_and_tells_what_they_are():
    clauses = (Flag(SLOPE_FROM, values={"level": "up_1g"}), Flag(SERVES_TOO), Flag("x = y, unknown"))
    model = Equation("id", "uut", "rate", "up_1g: D = D_ref + k · (T - T_ref)", {}, {}, clauses=clauses)
    with language("zh"):
        told = model_sheet(model).title
    assert told.endswith(
        "up_1g: D = D_ref + k · (T - T_ref)，采用 up_1g 的斜率，该斜率同样适用于本量级，x = y, unknown"
    )
    form = "up_1g: D = D_ref + k · (T - T_ref), slope from up_1g, which serves this level too, x = y, unknown"
    assert model.to_json()["form"] == form
    assert model_sheet(model).title.endswith(form)


@pytest.mark.parametrize("name", OTHERS)
def test_every_translation_has_the_places_of_its_text(name):
    def places(text):
        return sorted(place for _, place, _, _ in Formatter().parse(text) if place is not None)

    wrong = [text for text, translated in catalogue_of(name).items() if places(text) != places(translated)]
    assert wrong == []


@pytest.mark.lengthy
@pytest.mark.peer("a Chinese font")
def test_a_report_misses_no_word_and_is_in_chinese(run, missing):
    page = report(run, "html", "zh").read_text("utf-8")
    assert sorted(missing) == []
    assert page.startswith('<!doctype html>\n<html lang="zh">')
    for text in ("合格", "标度因数 K1", "零偏", "不确定度", "判定规则", "自由度", "试验过程", "被测件温度 / °C"):
        assert text in page
    for text in ("Decision rule", "degrees of freedom", "Serial number", "temperature of the unit"):
        assert text not in page
    assert "QF-0001，安装位置 a" in page
    assert ">被测件温度<" in page  # the legend of the course
    english = report(run, "html", "en")
    assert english.name == "report.html"
    assert not CHINESE.search(english.read_text("utf-8"))


def test_names_with_braces_and_markup_are_text_in_every_language(tmp_path):
    run = run_short(tmp_path, sequence="smoke", units=(HOSTILE,), operator=HOSTILE)
    assert "{text.__class__}&lt;b&gt;，安装位置 a" in report(run.path, "html", "zh").read_text("utf-8")
    assert "{text.__class__}&lt;b&gt; in place a" in report(run.path, "html", "en").read_text("utf-8")


def test_a_text_without_translation_stays_english(missing):
    with language("zh"):
        assert tr("of a plug-in: {number} things", number=3) == "of a plug-in: 3 things"
        assert tr("of a plug-in: 3 things") == "of a plug-in: 3 things"
    assert missing == {"of a plug-in: {number} things", "of a plug-in: 3 things"}


def test_numbers_in_a_text_that_is_made_elsewhere_may_be_any():
    with language("zh"):
        assert tr("largest residual of the model of degree 7") == "7 阶模型的最大残差"
        assert tr("steps of more than 12.5 µg between 30 samples") == "30 个采样点之间大于 12.5 µg 的跳变"
    assert tr("largest residual of the model of degree 7") == "largest residual of the model of degree 7"


@pytest.mark.parametrize(
    ("names", "face"),
    [
        (["Noto Sans CJK JP", "Noto Sans CJK KR", "Noto Sans CJK SC", "Noto Sans CJK TC"], "Noto Sans CJK SC"),
        (["WenQuanYi Zen Hei", "WenQuanYi Zen Hei Mono"], "WenQuanYi Zen Hei"),
    ],
)
def test_figures_have_the_chinese_forms_of_characters(names, face):
    assert svg.chinese_face(names) == face


def test_without_a_font_the_figures_are_english_and_the_page_says_so(run, monkeypatch):
    svg.font_of.cache_clear()
    monkeypatch.setattr(svg, "FONTS", {"zh": ()})
    page = report(run, "html", "zh").read_text("utf-8")
    svg.font_of.cache_clear()
    assert "图中文字为英文" in page
    assert "temperature of the unit / °C" in page
    assert "判定规则" in page


@pytest.mark.lengthy
@pytest.mark.peer("a Chinese font")
def test_a_pdf_brings_the_chinese_characters_that_it_uses(smoke_copy):
    path = report(smoke_copy, "pdf", "zh")
    reader = pypdf.PdfReader(path)
    fonts = {}
    for page in reader.pages:
        for font in page["/Resources"]["/Font"].values():
            font = font.get_object()
            fonts[str(font["/BaseFont"])] = font["/DescendantFonts"][0].get_object()["/FontDescriptor"].get_object()
    embedded = [name for name, found in fonts.items() if {"/FontFile2", "/FontFile3"} & set(found)]
    assert sorted(embedded) == sorted(fonts)
    assert any(re.search("WenQuanYi|CJK|SourceHan|Droid", name) for name in fonts)
    assert path.stat().st_size < 1_000_000
    text = reader.pages[0].extract_text()
    assert f"第 1 页，共 {len(reader.pages)} 页" in text
    assert "合格" in text
