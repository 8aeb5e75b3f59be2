"""Columns of a run's tables: fields of rows, figures from audits and proofs, and their rounding in words."""

import re

from topo_search.model import Audit
from topo_search.model.proven import lower_text, upper_text
from topo_search.study.ledger import FLIGHT, ROW_FIELDS

AUDIT_FIGURES = ("power_W", "air_tip_m_s", "air_region_m_s", "force_reserve_com_N", "tilt_deg")
"""Columns of figures that are read from the audit itself; rows do not store them."""
COLUMNS = (
    *(*ROW_FIELDS[: ROW_FIELDS.index("asked")], *FLIGHT, *AUDIT_FIGURES),
    *("proven_bound", "proven_gap", "proof", "proven_problem"),
    *("value", "value_bound", "reach"),
)
"""Columns of `candidates.csv`: the row's fields before `asked`, then figures from audits, then proofs."""


def proven_cell(name: str, value: object, digits: int = 6) -> object:
    """Return an audit's figure for a table, rounded towards the side that is proven."""
    if not isinstance(value, float):
        return value
    upper_bounds = {"air_tip_m_s", "air_region_m_s", "joint_moment_Nm", "rod_length_m"}  # others: lower bounds
    upper_bounds |= {"speed", "joint_moment", "peak_input"}  # goals
    return upper_text(value, digits) if name in upper_bounds else lower_text(value, digits)


def figures_of(audit: Audit) -> dict[str, float | None]:
    """Return the audit's figures that a row does not store, by the names of AUDIT_FIGURES.

    Shaft power in hover [W]; the fastest air at the end-effector and over regions in any load case [m/s]; in hover,
    the size of any force that can be added at the centre of mass [N] and the largest tilt [deg].
    """
    hover, air = None if audit.flight is None else audit.flight.hover, audit.air
    return {
        "power_W": next((case.shaft_W for case in audit.power if hover and case.name == hover.name), None),
        "air_tip_m_s": None if air is None else air.tip_m_s,
        "air_region_m_s": None if air is None else air.region_m_s,
        "force_reserve_com_N": None if hover is None else hover.force_reserve_com_N,
        "tilt_deg": None if hover is None else hover.tilt_deg,
    }


def kind_of(constraint: str) -> str:
    """Return the name of a constraint without module numbers."""
    return re.sub(r"\bmodule \d+", "a module", re.sub(r"\bmodules \d+ and \d+", "two modules", constraint))
