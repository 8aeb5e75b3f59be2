"""Clearances in figures, the same wherever the page tells them: rounded down.

Apart from `wording`, which `--help` loads too: it must load no numerics.
"""

from __future__ import annotations

from topo_search.model import Clearance
from topo_search.model.proven import at_least, lower_text
from topo_search.report.wording import length


def clearance(pair: Clearance) -> str:
    """Return a clearance in figures with its unit."""
    return length(at_least(pair.analytic_m, 3))


def millimetres(pair: Clearance) -> str:
    """Return the same figures in millimetres, without the unit."""
    return lower_text(1000 * pair.analytic_m, 3).replace("-", "−")
