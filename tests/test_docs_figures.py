"""The drawings of the documentation: current, described in words, and shown."""

import math
import re
import runpy

import pytest
from documented import PAGES, ROOT, TEXT

FIGURES = runpy.run_path(str(ROOT / "docs/figures.py"))
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


@pytest.mark.parametrize("name", FIGURES["DRAWN"])
def test_a_drawing_is_current(name):
    kept, drawn = (PAGES / f"figures/{name}.svg").read_text(encoding="utf-8"), FIGURES["svg"](name)
    if kept == drawn:
        return
    assert NUMBER.sub("#", kept) == NUMBER.sub("#", drawn), "run `.venv/bin/python docs/figures.py`"
    pairs = zip(NUMBER.findall(kept), NUMBER.findall(drawn), strict=True)  # processors round differently
    assert all(math.isclose(float(a), float(b), rel_tol=1e-6, abs_tol=1e-4) for a, b in pairs)


def test_every_drawing_is_shown_and_no_other_is_kept():
    kept = {path.stem for path in (PAGES / "figures").glob("*.svg")}
    assert kept == {*FIGURES["DRAWN"]} == set(re.findall(r"figures/([\w-]+)\.svg\)", TEXT))


def test_forty_pictures_are_shown_and_each_is_described_in_words():
    shown = re.findall(r"!\[([^]]*)\]\(([^)]*)\)", TEXT)
    assert len({path.rpartition("/")[2] for _, path in shown}) >= 40
    assert min(len(words) for words, _ in shown) > 20
