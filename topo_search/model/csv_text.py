"""Cells of CSV files that people open in spreadsheets."""

from __future__ import annotations

from typing import TypeVar

FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a text begins with that a spreadsheet takes for a formula, and runs."""

Cell = TypeVar("Cell")


def harmless(cell: Cell) -> Cell | str:
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
