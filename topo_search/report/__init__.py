"""The report: one HTML file that works offline, for a run or for a single audited design."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

Figure = dict[str, Any]
"""Data and layout of a figure in the format of plotly.js."""
PLOTLY_LAYOUT: dict[str, Any] = {
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#222222"},
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "rgba(0,0,0,0)",
    "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "#777777", "activecolor": "#0072b2"},
    "autosize": True,
    "margin": {"l": 60, "r": 20, "t": 36, "b": 50},
}
"""Layout shared by all figures."""
ON_ANY_PAGE: dict[str, Any] = {
    "template": "plotly_white",
    "font": {**PLOTLY_LAYOUT["font"], "color": "#767676"},
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "rgba(0,0,0,0)",
}
"""Layout of figures in notebooks, which do not say whether they are dark: legible on both, without a background."""


class Table(NamedTuple):
    """A table with a heading per column."""

    columns: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    numeric: Collection[int] = ()
    """Indices of columns of numbers, which are right-aligned."""

    @classmethod
    def from_rows(cls, rows: Sequence[dict[str, str]], numeric: Collection[int] = ()) -> Table:
        """Return a table from rows that map the same headings to cells."""
        return cls(tuple(rows[0]) if rows else (), [list(row.values()) for row in rows], numeric)


class Tile(NamedTuple):
    """A figure of a design with a name and an explanation, as a tile of the headline."""

    name: str
    figure: str
    meaning: str
    status: str = ""
    """Verdict that sets the colour, or `fragile`; empty for none."""


def json_in_script(value: Any) -> str:
    """Return a value as JSON that is safe inside a script element."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    # no text may end the script element
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
