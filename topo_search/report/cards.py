"""The best designs of a run as the page shows them beside the winner: a card each, while the page stays small."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator

from markupsafe import Markup

from topo_search.export.poses import poses_to_draw
from topo_search.export.tree_drawing import tree_svg
from topo_search.model import Audit, BadInput, Design
from topo_search.report.design_part import nearest
from topo_search.report.flight_part import reserves
from topo_search.report.headline import headline
from topo_search.report.page import Card, Tile
from topo_search.report.view import view
from topo_search.report.wording import modules
from topo_search.study import Answer, Row

OF_OTHER_SIZES = 3
"""Number of designs of each size but the winner's."""
LARGEST = 2_500_000
"""Characters that all cards may take: what would lead beyond is left out, the least effort first to stay."""


def rows_to_show(answer: Answer, shown: Row) -> list[Row]:
    """Return which designs get a card: the winner, the best of its size and those near it, some of other sizes."""
    own = next(size for size in answer.sizes if size.modules == shown.modules)
    others = (row for size in answer.sizes if size is not own for row in size.top[:OF_OTHER_SIZES])
    found = {row.key: row for row in itertools.chain([shown], own.top, own.near_ties, others)}
    return list(found.values())


def cards(
    found: Iterable[tuple[Row, Design, Audit | None]], best: Row, *, scoped: Collection[int] = ()
) -> Iterator[Card]:
    """Yield a card for each design that can be drawn, the winner's first, until they take too much.

    Args:
        found: rows with their designs and audits, the winner first.
        best: the winner.
        scoped: the sizes whose gaps branch and bound proves.
    """
    taken = 0
    for row, design, audit in found:
        try:
            card = _card(row, design, audit, best, scoped=row.modules in scoped)
        except BadInput:  # its end-effector is too far away to be drawn: the ranking still has its row
            continue
        if row.key != best.key:
            taken += len(card.view.data) + len(card.tree)
        if taken > LARGEST:
            return
        yield card


def _card(row: Row, design: Design, audit: Audit | None, best: Row, *, scoped: bool) -> Card:
    at = poses_to_draw(design)
    assembly = None if audit is None else audit.assembly
    verdict = "none" if audit is None else str(audit.verdict)
    return Card(
        key=row.key,
        heading=f"{row.key}, {modules(row.modules)}",
        view=view(f"view-{row.key}", design, at, audit),
        tree=Markup(tree_svg(design, assembly)),
        figures=(
            Tile("Audit", verdict, "", verdict),
            _effort(row, best),
            *headline(design, audit, row.gap, "", scoped=scoped),
        ),
        nearest=nearest(audit.pairs) if audit is not None and audit.pairs else None,
        cases=None if audit is None or audit.flight is None else reserves(audit.flight),
    )


def _effort(row: Row, best: Row) -> Tile:
    """Return the effort of a design over that of the winner."""
    if row.key == best.key or not row.objective or not best.objective or row.modules != best.modules:
        return Tile("Effort", "least found" if row.key == best.key else "of another size", "")
    return Tile("Effort", f"+{100 * (row.objective / best.objective - 1):.2f} %", "over that of the best")
