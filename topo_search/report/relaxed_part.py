"""What would give the closest trees a design: the part of the page of a run that found none."""

from __future__ import annotations

from topo_search.report.page import RelaxedLimits, Table
from topo_search.report.wording import modules
from topo_search.study import SizeAnswer

COLUMNS = ("limit", "enough", "setting", "tree", "tried in vain")


def relaxed_limits(size: SizeAnswer) -> RelaxedLimits | None:
    """Return which limits to relax for a size without a design; None where nothing was tried."""
    found = size.relaxed
    if found is None or not found.sentences:
        return None
    rows = [
        [
            one.limit,
            one.change,
            one.setting,
            one.topology_key,
            "" if one.not_enough is None else f"{100 * one.not_enough:.3g} %",
        ]
        for one in found.relaxations
    ]
    rows += [[text, "not enough", "", "", ""] for text in found.in_vain]
    rows += [[text, "could not be tried", "", "", ""] for text in found.untried]
    caption = f"{modules(size.modules)}: limits of the task, each relaxed alone and solved again; not a proof"
    return RelaxedLimits(caption, Table(COLUMNS, rows))
