"""The report of a run on paper: what stands in a PDF, where, and what a screen reader finds."""

import io
import sys
from base64 import b64encode
from functools import partial
from xml.etree import ElementTree

import pypdf
import pytest
import typst
from markupsafe import escape
from PIL import Image

from bench.errors import InputError
from bench.reduce.stored_run import open_run
from bench.report.paper import pdf
from bench.report.write import write_report
from bench.xml_text import xml_text
from tests.support.paper import page_of
from tests.support.runs import copy_bench, run_short

HOSTILE = '"}</style><script>alert(1)</script> #panic() $x$'
A4_MM = (210, 297)
SIDE_MM, TOP_MM, BOTTOM_MM = 13, 20, 17
LONG = {"a word": "0123456789abcdef" * 40, "many words": "some words " * 2500 + "end"}
HOLDERS = {
    "paragraph": "<p>{}</p>",
    "cell": "<table><thead><tr><th></th></tr></thead><tbody><tr><td>{}</td></tr></tbody></table>",
    "entry": '<div class="alert"><ul><li>{}</li></ul></div>',
    "file": "<pre>{}</pre>",
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short run on a bench whose title is hostile to style sheets, XML and Typst."""
    folder = tmp_path_factory.mktemp("paper")
    title = ("title: Simulated accelerometer bench", f"title: '{HOSTILE}'")
    return run_short(
        folder, bench=copy_bench(folder / "config", title), sequence="smoke", units=("QF-0001",), no_report=False
    )


@pytest.fixture(scope="module")
def paper(run):
    """The PDF of the run."""
    with open_run(run.path) as stored:
        return pypdf.PdfReader(write_report(stored, "pdf"))


def read(page):
    return pypdf.PdfReader(io.BytesIO(pdf(page)))


def text_of(reader):
    """Text of all pages, with single spaces; a place where a long word may be broken leaves no trace."""
    return " ".join(" ".join(page.extract_text() for page in reader.pages).replace("\u200b", "").split())


def visible_words(element):
    """Words of a part of a page that a reader sees, but for those in its figures."""
    if element.tag not in ("style", "svg", "title"):
        yield from (element.text or "").split()
        for child in element:
            yield from visible_words(child)
            yield from (child.tail or "").split()


def test_every_page_is_a4_with_what_it_is_of_and_its_number(run, paper):
    assert 4 <= len(paper.pages) <= 9
    for number, page in enumerate(paper.pages, start=1):
        assert tuple(round(float(side) / 72 * 25.4) for side in page.mediabox[2:]) == A4_MM
        words = " ".join(page.extract_text().split())
        assert f"Page {number} of {len(paper.pages)}" in words
        assert run.path.name in words
        assert HOSTILE in words


def test_the_page_is_well_formed_and_all_of_it_is_on_paper(run, paper):
    page = (run.path / "report.html").read_text("utf-8")
    words = list(visible_words(ElementTree.fromstring(page.partition("\n")[2])))
    written = text_of(paper).replace(" ", "")
    assert len(words) > 1500
    assert [word for word in words if word not in written and word not in ("{page}", "{pages}")] == []


def test_a_figure_has_its_text_and_a_description(paper):
    assert "time since the run" in text_of(paper)
    assert list(alternative_texts(paper.trailer["/Root"]["/StructTreeRoot"])) == ["Course of the run"]


def test_it_passes_the_checks_of_typst_for_pdf_ua(run, monkeypatch):
    monkeypatch.setattr(typst, "compile", partial(typst.compile, pdf_standards=["ua-1"]))  # an error otherwise
    assert b"pdfuaid" in pdf((run.path / "report.html").read_text("utf-8"))


def alternative_texts(tag):
    """Texts that a screen reader says for the figures in a part of the tree of tags."""
    part = tag.get_object()
    if isinstance(part, list):
        for each in part:
            yield from alternative_texts(each)
    elif isinstance(part, dict):
        if part.get("/S") == "/Figure":
            yield part.get("/Alt")
        yield from alternative_texts(part.get("/K", pypdf.generic.NullObject()))


def test_equal_pages_are_equal_pdfs_and_state_no_time():
    page = page_of("<h1>A page</h1><p>PASS</p>")
    content = pdf(page)
    assert content == pdf(page)
    assert b"CreationDate" not in content


def test_its_title_and_language_are_those_of_the_page():
    reader = read(page_of("<p>PASS</p>", "zh"))
    assert reader.metadata.title == "A page"
    assert reader.trailer["/Root"]["/Lang"] == "zh"


def pieces(reader):
    """Every piece of text, with its left end and its height above the lower edge in mm."""
    found = []

    def seen(text, to_page, to_text, *_):
        if text.strip():
            left, height = pypdf.mult(to_text, to_page)[4:]
            found.append((text.strip(), left / 72 * 25.4, height / 72 * 25.4))

    for page in reader.pages:
        page.extract_text(visitor_text=seen)
    return found


def table(heads, rows):
    head = "".join(f'<th class="n">{each}</th>' for each in heads)
    cells = ("".join(f'<td class="n">{each}</td>' for each in row) for row in rows)
    body = "".join(f"<tr>{each}</tr>" for each in cells)
    return f"<table><caption>A table</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def test_a_table_that_is_wider_than_the_paper_is_smaller():
    heads = [f"source{number}" for number in range(40)]
    reader = read(page_of(table(heads, [[f"{number}.123456" for number in range(40)]])))
    assert len(reader.pages) == 1
    lefts = [left for _, left, _ in pieces(reader)]
    assert max(lefts) < A4_MM[0] - SIDE_MM
    assert min(lefts) > SIDE_MM - 1
    assert [head for head in heads if head not in text_of(reader)] == []


def test_a_row_with_a_wide_cell_makes_its_other_columns_wide_enough():
    rows = (
        f"<tr><td>x</td><td>y</td><td>{'words ' * 100}</td></tr>",
        "<tr><td>D04 /1.2.3</td><td colspan='2'>no certificate</td></tr>",  # no line ends before a slash
    )
    page = page_of(table(["a", "b", "c"], []).replace("<tbody>", f"<tbody>{''.join(rows)}"))
    found = {text: left for text, left, _ in pieces(read(page))}
    assert found["no certificate"] > found["D04 /1.2.3"] + 13  # mm, the width of the text


def test_the_head_of_a_table_is_on_every_page_of_it():
    reader = read(page_of(table(["number"], [[number] for number in range(200)])))
    assert len(reader.pages) > 2
    assert [page.extract_text().count("number") - 1 for page in reader.pages] == [1] * len(reader.pages)


@pytest.mark.parametrize("holder", HOLDERS)
@pytest.mark.parametrize("long", LONG)
def test_what_is_long_is_broken_and_stays_between_the_margins(holder, long):
    reader = read(page_of(HOLDERS[holder].format(LONG[long])))
    found = pieces(reader)
    in_body = [left for _, left, height in found if BOTTOM_MM < height < A4_MM[1] - TOP_MM]
    assert len(found) - len(in_body) == 4 * len(reader.pages)  # the texts in the margins of each page
    assert all(SIDE_MM - 1 < left < A4_MM[0] - SIDE_MM for left in in_body)
    lines = [line for page in reader.pages for line in page.extract_text().replace("\u200b", "").split("\n")]
    assert max(map(len, lines)) < 160  # letters between the margins
    written = text_of(reader)
    for number in range(1, 1 + len(reader.pages)):
        for each in ("title", "number", "bench", f"{number} of {len(reader.pages)}"):
            written = written.replace(each, "")
    assert "".join(LONG[long].split()) in "".join(written.split())


@pytest.mark.peer("a Chinese font")
def test_a_line_of_chinese_does_not_begin_with_a_comma():
    text = "测量结果，" * 200
    lines = read(page_of(f"<p>{text}</p>", "zh")).pages[0].extract_text().split("\n")
    of_text = [line for line in lines if "测量" in line]
    assert len(of_text) > 5
    assert [line for line in of_text if line.startswith("，")] == []


@pytest.mark.peer("a Chinese font")
def test_a_chinese_head_of_a_narrow_column_is_not_set_letter_by_letter():
    heads = ["读数：全程合并的分散性", *("inner:harmonics",) * 11]
    text = read(page_of(table(heads, [["1.234"] * 12]), "zh")).pages[0].extract_text()
    assert "的分散性" in text
    assert [line for line in text.split("\n") if len(line) == 1] == []


def test_lines_of_a_message_stay_lines():
    reader = read(page_of('<div class="alert"><ul><li>sent: P?\ncame: ERR 7</li></ul></div>'))
    assert "sent: P?\ncame: ERR 7" in reader.pages[0].extract_text()


@pytest.mark.parametrize("text", ["\x00\x1b[31m", "#set text(red)", "*b* _e_ $x$ @a <b> \\", "a\u00a0b", "=1+2"])
def test_any_text_is_text(text):
    written = text_of(read(page_of(f"<p>before {escape(text)} after</p>")))
    expected = text.replace("\x00", "\ufffd").replace("\x1b", "\ufffd").replace("\u00a0", " ")
    assert f"before {expected} after" in written


ALLOWED = [0x9, 0xA, 0x20, 0x7F, 0xD7FF, 0xE000, 0xFFFD, 0x10000, 0x10FFFF]
NOT_ALLOWED = [0x0, 0x8, 0xB, 0xC, 0xE, 0x1F, 0xD800, 0xDFFF, 0xFFFE, 0xFFFF]


def test_what_xml_does_not_allow_is_replaced_and_nothing_else():
    for code in (*ALLOWED, *NOT_ALLOWED):
        found = ElementTree.fromstring(f"<a>{xml_text(chr(code))}</a>").text
        assert found == (chr(code) if code in ALLOWED else "\ufffd"), hex(code)


@pytest.fixture
def png():
    """The smallest image that a mark can be."""
    file = io.BytesIO()
    Image.new("RGB", (1, 1)).save(file, "PNG")
    return file.getvalue()


def marked(content):
    mark = f'<img class="mark" src="data:image/png;base64,{b64encode(content).decode()}" alt="A mark"/>'
    facts = '<dl class="facts"><dt>Number</dt><dd>7</dd></dl>'
    return page_of(f'<section id="certificate"><h2>Certificate</h2>{mark}{facts}</section>')


def test_a_certificate_has_the_mark_of_the_accreditation_body(png):
    reader = read(marked(png))
    assert [image.name for image in reader.pages[0].images]
    assert list(alternative_texts(reader.trailer["/Root"]["/StructTreeRoot"])) == ["A mark"]
    assert "Certificate Number 7" in text_of(reader)


def test_a_damaged_mark_is_an_error_and_not_left_out(png):
    with pytest.raises(InputError, match=r"cannot be written as PDF: .*(image|PNG).*; as HTML it can"):
        pdf(marked(png[:40]))


def test_without_typst_the_command_says_what_to_install(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "typst", None)
    with (
        open_run(run.path) as stored,
        pytest.raises(InputError, match=r"typst is not installed; .* 'inertial-test-bench\[pdf\]'"),
    ):
        write_report(stored, "pdf")
