"""The README and the pages of the documentation, as they are written."""

import math
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs/pages"
TEXT = "\n".join(path.read_text(encoding="utf-8") for path in [ROOT / "README.md", *sorted(PAGES.rglob("*.md"))])

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
NEAR = 0.02
"""Relative difference up to which a printed number is the same: libraries round differently."""


def blocks(language: str, page: str) -> list[str]:
    """Return what a page of the documentation shows in a language."""
    text = (PAGES / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def same(shown: str, printed: str) -> bool:
    """True if two lines have the same words, and nearly the same numbers."""
    words = [" ".join(NUMBER.sub("#", line).split()) for line in (shown, printed)]
    if words[0] != words[1]:
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    return all(math.isclose(float(a), float(b), rel_tol=NEAR, abs_tol=0.011) for a, b in pairs)
