"""Page that shows the designs of two runs, or two designs, beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from topo_search.model import Audit, Design
from topo_search.report.headline import card, headline
from topo_search.report.page import Table, Tile
from topo_search.report.scene import shared_meshes
from topo_search.report.wording import EFFORT, figures


class Compared(NamedTuple):
    """A design with the name that tells it from the others."""

    name: str
    design: Design
    audit: Audit | None
    gap: float | None
    """Largest share of its effort that another platform of its size can save."""


def compare_page(first: Sequence[Compared], second: Sequence[Compared]) -> dict[str, Any]:
    """Return the page.

    Args:
        first: designs of the first run, the best first; or the first design alone.
        second: those of the second.
    """
    most = 10  # designs of one run
    shown = {one.name: one for one in (*first[:most], *reversed(second[:most]))}
    cards = []
    for one in shown.values():
        made = card(one.name, one.design, one.audit, _effort(one.design), one.gap)
        made["view"]["value"]["meshes"] = shared_meshes(one.design)
        cards.append(made)
    return {
        "title": f"{first[0].name} beside {second[0].name}",
        "answer": "Designs of two sources in linked views; figures that differ are marked.",
        "tiles": (),
        "compared": {"figures": figure_table(first[0], second[0]), "cards": cards},
    }


def figure_table(first: Compared, second: Compared) -> Table:
    """Return every figure of two designs, a row each."""
    sides = [
        {"Control effort": _effort(one.design).figure}
        | {tile.name: tile.figure for tile in headline(one.design, one.audit, one.gap, "")}
        for one in (first, second)
    ]
    rows = [[name, *(side.get(name, "") for side in sides)] for name in sides[0] | sides[1]]
    return Table(("figure", first.name, second.name), rows)


def _effort(design: Design) -> Tile:
    return Tile("Control effort", f"{figures(design.objective, 5)} rad⁴/s⁴", EFFORT)
