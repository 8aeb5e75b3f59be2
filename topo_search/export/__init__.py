"""Designs for other eyes and tools: pictures and files of other formats, and their colours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Palette(NamedTuple):
    """Colours of the pictures: the set of Okabe and Ito, told apart with every kind of colour vision.

    M. Okabe, K. Ito, "Color Universal Design", 2008.
    """

    MODULE: str = "#262626"
    ARM: str = "#6b6b6b"
    ROTOR: str = "#c9c9c9"
    THRUST_AXIS: str = "#d55e00"
    SPINS: tuple[str, ...] = ("#56b4e9", "#cc79a7")
    """Rotors that turn counter-clockwise and clockwise, seen from above."""
    CONNECTOR: str = "#0072b2"
    FREE_PORT: str = "#b0b0b0"
    AIRFLOW: str = "#cc79a7"
    AIR: str = "#56b4e9"
    EXPOSURE: str = "#e69f00"
    WALL: str = "#b3aa9e"
    END_EFFECTOR: str = "#009e73"
    CENTRE_OF_MASS: str = "#f0e442"
    OFFSET: str = "#56b4e9"
    CLOSEST_PAIR: str = "#000000"
    WRENCH: str = "#000000"
    CONTACT: str = "#56b4e9"
    BLOCKED_PORT: str = "#f0e442"

    VERDICTS: Mapping[str, str] = {
        "clear": "#009e73",
        "undecided": "#e69f00",
        "violated": "#d55e00",
        "inconsistent": "#000000",
    }
    """Colours of audit verdicts, always beside the word."""
    STATUSES: Mapping[str, str] = {
        "feasible": "#009e73",
        "infeasible": "#e69f00",
        "impossible": "#cc79a7",
        "failed": "#000000",
    }
    """Colours of candidates' statuses, always beside the word."""
    SERIES: tuple[str, ...] = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
    """Lines and points of one chart, told apart by their markers too."""
    CASES: tuple[str, ...] = ("#000000", "#cc79a7", "#009e73", "#e69f00", "#56b4e9")
    """Arrows of load cases beside thrust axes and joints."""

    CELL: str = "rgba(128, 128, 128, 0.12)"
    TIGHT: str = "#ffd166"
    NOT_CLEAR: str = "#a84700"
    """Cells of a matrix of clearances: plain, tight, not clear."""
    IN_CELLS: tuple[str, ...] = ("#222222", "#221c10", "#fffffe")
    """Text in them, with a contrast of 4.5 at least."""


palette = Palette()
