"""Tables as people see them: CSV files that they open in spreadsheets, and HTML in a notebook."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any, TypeVar

Cell = TypeVar("Cell")


def escape_formula(cell: Cell) -> Cell | str:
    """Return what to write for a cell: a text that would be a formula gets a quote before it, as in spreadsheets.

    Numbers stay numbers, also those that are given as texts.
    """
    # a spreadsheet takes a text that begins like this for a formula, and runs it
    if not isinstance(cell, str) or not cell.startswith(("=", "+", "-", "@", "\t", "\r")):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def csv_text(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a table as the text of a CSV file."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(head)
    table.writerows([escape_formula(cell) for cell in row] for row in rows)
    return text.getvalue()


def heading(text: str) -> str:
    """Return a line in bold."""
    return f"<p><b>{escape(text)}</b></p>"


def paragraph(text: str) -> str:
    """Return a line."""
    return f"<p>{escape(text)}</p>"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table; None is an empty cell, a number is written with six digits."""
    lines = ["".join(f"<td>{escape(_cell(value))}</td>" for value in row) for row in rows]
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"<table><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>"


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
