"""The page that a run ends in: one file that opens without a network, for a run or for a single audited design."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

Figure = dict[str, Any]
"""Data and layout of a figure, as plotly.js takes them."""
PLOTLY_LAYOUT: dict[str, Any] = {
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#222222"},
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "rgba(0,0,0,0)",
    "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "#777777", "activecolor": "#0072b2"},
    "autosize": True,
    "margin": {"l": 60, "r": 20, "t": 36, "b": 50},
}
"""Layout of all figures."""


class Table(NamedTuple):
    """A table with a heading a column."""

    columns: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    numeric: Collection[int] = ()
    """Columns of numbers, which are aligned to the right."""

    @classmethod
    def from_rows(cls, rows: Sequence[dict[str, str]], numeric: Collection[int] = ()) -> Table:
        """Return a table of rows that have the same headings, each beside its cell."""
        return cls(tuple(rows[0]) if rows else (), [list(row.values()) for row in rows], numeric)


class Tile(NamedTuple):
    """A figure of the headline."""

    name: str
    figure: str
    meaning: str
    status: str = ""
    """A verdict that colours it, or `fragile`; empty for none."""


def json_in_script(value: Any) -> str:
    """Return a value as JSON inside a script element."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    # no text in the JSON can end the script element
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
