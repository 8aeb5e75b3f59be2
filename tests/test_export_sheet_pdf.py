"""The assembly sheet as a PDF, read back and looked at as a printer in grey makes it."""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pypdfium2
import pytest
from commands import invoke
from export_cases import random_design, with_rod

from topo_search.export.brackets import printed_parts
from topo_search.export.sheet import sheet
from topo_search.export.sheet_pdf import sheet_pdf
from topo_search.model import Design, Topology
from topo_search.model.files import read_json
from topo_search.topologies import sample

SAVED = Path(__file__).parent / "designs" / "wall-push.json"
DESIGN = read_json(Design, SAVED)


def page_of(design: Design, *notes: str) -> str:
    return sheet(design, printed_parts(design), notes)


def texts(content: bytes) -> list[str]:
    """Words of each page, with single spaces."""
    return [" ".join(page.get_textpage().get_text_bounded().split()) for page in pypdfium2.PdfDocument(content)]


@pytest.mark.parametrize(
    "design",
    [
        DESIGN,
        random_design(Topology.from_key("a0"), 1),
        with_rod(random_design(Topology.from_key("ab414041100"), 2)),
    ],
    ids=["three modules", "one module", "ten modules"],
)
def test_the_pdf_has_all_words_of_the_page_on_sheets_of_a4(design: Design) -> None:
    page = page_of(design, "a first note with signs: 5 < 6 & 7", "a minus \u2212 and a letter \u03b1")
    content = sheet_pdf(page)
    assert content == sheet_pdf(page)  # nothing of the day or the machine
    body = ElementTree.fromstring(page.split("\n", 1)[1]).find("body")
    cells = [element for tag in ("h1", "h2", "p", "th", "td") for element in body.iter(tag)]
    words = [" ".join("".join(cell.itertext()).split()) for cell in cells]
    assert len(words) > 40
    found = re.sub(r"\s|Assembly of \S+ \S+ page \d+", "", " ".join(texts(content)))
    for text in words:
        told = text.replace("\u2212", "-").replace("\u03b1", "?")
        assert re.sub(r"\s", "", told) in found, text
    for sheet_of_paper in pypdfium2.PdfDocument(content):
        assert sheet_of_paper.get_size() == pytest.approx((595.3, 841.9), abs=0.1)


def test_each_picture_is_on_the_page_of_its_step_with_its_numbers() -> None:
    steps = [re.findall(r"Step (\d)\.", text) for text in texts(sheet_pdf(page_of(DESIGN)))]
    assert [number for found in steps for number in found] == ["1", "2", "3"]
    (at,) = (k for k, found in enumerate(steps) if found)  # all three fit on one page
    document = pypdfium2.PdfDocument(sheet_pdf(page_of(DESIGN)))
    letters = texts(sheet_pdf(page_of(DESIGN)))[at].split()
    assert [letters.count(number) >= 3 for number in "012"] == [True] * 3
    assert "E" in letters
    grey = np.asarray(document[at].render(scale=2, grayscale=True).to_pil(), dtype=float)
    shown = grey[:, : grey.shape[1] // 2]  # pictures are on the left
    new, built = np.count_nonzero((shown > 40) & (shown < 110)), np.count_nonzero((shown > 150) & (shown < 235))
    assert new > 2000
    assert built > 2000


def test_a_long_table_goes_on_below_its_head_on_the_next_page() -> None:
    pages = texts(sheet_pdf(page_of(random_design(next(iter(sample(16, 1, 0))), 2))))
    assert sum("PX4 motor column" in text for text in pages) == 2


def test_the_sheet_is_exported_in_either_form(tmp_path: Path) -> None:
    for name in ("sheet.html", "sheet.pdf"):
        invoke("export", SAVED, "--format", "sheet", "--out", tmp_path / name)
    assert (tmp_path / "sheet.pdf").read_bytes() == sheet_pdf((tmp_path / "sheet.html").read_text())
    invoke("export", SAVED, "--out", tmp_path / "other.pdf")  # by the suffix
    assert (tmp_path / "other.pdf").read_bytes() == (tmp_path / "sheet.pdf").read_bytes()
