"""The README and the pages of the documentation, as they are written."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs/pages"
TEXT = "\n".join(path.read_text(encoding="utf-8") for path in [ROOT / "README.md", *sorted(PAGES.rglob("*.md"))])


def blocks(language: str, page: str) -> list[str]:
    """Return what a page of the documentation shows in a language."""
    text = (PAGES / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
