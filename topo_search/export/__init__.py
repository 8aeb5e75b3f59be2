"""Pictures of designs, files of designs for other programs, and the colours of both."""

from collections.abc import Mapping
from typing import NamedTuple


class Palette(NamedTuple):
    """Colours of all pictures: the set of Okabe and Ito, which stay distinct with colour-vision deficiency.

    M. Okabe, K. Ito, "Color Universal Design", 2008.
    """

    MODULE: str = "#262626"
    TYPES: tuple[str, ...] = ("#262626", "#ddcc77", "#882255", "#88ccee", "#999933")
    """Types of module; from Paul Tol's muted colours, which stay distinct as well."""
    ARM: str = "#6b6b6b"
    ROTOR: str = "#c9c9c9"
    THRUST_AXIS: str = "#d55e00"
    SPINS: tuple[str, ...] = ("#56b4e9", "#cc79a7")
    """Rotors that turn counter-clockwise, and clockwise, seen from above."""
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
    """Colours of audit verdicts; the word always stands beside them."""
    STATUSES: Mapping[str, str] = {
        "feasible": "#009e73",
        "infeasible": "#e69f00",
        "impossible": "#cc79a7",
        "failed": "#000000",
    }
    """Colours of candidates' statuses; the word always stands beside them."""
    SERIES: tuple[str, ...] = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
    """Lines and points of one chart; their markers differ too."""
    CASES: tuple[str, ...] = ("#000000", "#cc79a7", "#56b4e9", "#e69f00", "#009e73")
    """Arrows of load cases; distinct from thrust axes and joints, the first ones from the rod too."""

    CELL: str = "rgba(128, 128, 128, 0.12)"
    TIGHT: str = "#ffd166"
    NOT_CLEAR: str = "#a84700"
    """Cells of a matrix of clearances: plain (`CELL`), tight, not clear."""
    IN_CELLS: tuple[str, ...] = ("#222222", "#221c10", "#fffffe")
    """Text in these three kinds of cell, with a contrast of at least 4.5."""


palette = Palette()
PAPER = "topo_search.paper"
"""Style of matplotlib for all figures: fonts, sizes and colours, in `topo_search/paper.mplstyle`."""
TWO_COLUMNS = 7.16
"""Width of a figure across two columns of a paper [in], as in `topo_search/two_columns.mplstyle`."""
