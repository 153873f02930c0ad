"""`lab.yaml`: the mark of the accreditation body is a PNG beside it."""

import pytest

from bench.config.laboratory import PNG, CertificateFields, load_laboratory, mark_of, missing_fields
from bench.errors import InputError

LABORATORY = """\
schema: itb-laboratory/1
name: Inertial Laboratory
address: 1 Bench Street
accreditation: {body: National Body, number: "0815", mark: mark.png}
environment: (22 ± 2) °C
traceability: to the SI
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "lab.yaml").write_text(LABORATORY)
    return tmp_path / "lab.yaml"


def test_the_mark_is_beside_the_file(file):
    file.with_name("mark.png").write_bytes(PNG + b"picture")
    found = load_laboratory(file)
    assert mark_of(found).startswith("data:image/png;base64,iVBORw0KGgpwaWN0dXJl")
    assert "the environment" not in missing_fields(found, CertificateFields(), {})


@pytest.mark.parametrize(
    ("content", "why"),
    [(b"<svg onload=alert(1)>", "no PNG image"), (None, "there is no such file"), (PNG * 40000, "at most")],
)  # fmt: skip
def test_a_mark_that_cannot_be_shown_is_refused(file, content, why):
    if content is not None:
        file.with_name("mark.png").write_bytes(content)
    with pytest.raises(InputError, match=why):
        load_laboratory(file)
