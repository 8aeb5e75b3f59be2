"""Cells of CSV files that people open in spreadsheets."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a text begins with that a spreadsheet takes for a formula, and runs."""

Cell = TypeVar("Cell")


def escape_formula(cell: Cell) -> Cell | str:
    """Return what to write for a cell: a text that would be a formula gets a quote before it, as in spreadsheets.

    Numbers stay numbers, also those that are given as texts.
    """
    if not isinstance(cell, str) or not cell.startswith(FORMULA):
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
