"""One candidate's row, as the ledger keeps it and `candidates.csv` shows it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

from topo_search.engine import Failed, Outcome, Scored, record_of, scaled_violation
from topo_search.model import Audit, Design, Flight, Infeasible, ResolvedTask
from topo_search.model.proven import lower_text, upper_text

FLIGHT: dict[str, Callable[[Flight], float | int | None]] = {
    "force_reserve_N": lambda flight: flight.hover.force_reserve_N,
    "torque_reserve_Nm": lambda flight: flight.hover.torque_reserve_Nm,
    "rotors_out_hover": lambda flight: flight.rotors_out_hover.survive,
    "load_factor": lambda flight: flight.load_factor,
    "joint_moment_Nm": lambda flight: flight.joint_moment_Nm,
    "hinge_tolerance_deg": lambda flight: flight.hinge_tolerance_deg,
    "rod_length_m": lambda flight: flight.rod_length_m,
}
"""Columns of an audited design: what its audit reports beyond the task."""
AUDITED = ("power_W", "air_tip_m_s", "air_region_m_s", "force_reserve_com_N", "tilt_deg")
"""Columns of an audited design that are read from its audit, not from its row in the ledger."""


@dataclass(frozen=True)
class Row:
    """Result of one candidate."""

    key: str
    modules: int
    orbit: int
    """Number of classes of the exact quotient that the candidate stands for."""
    status: str
    """feasible, infeasible, impossible, pruned or failed."""
    objective: float | None = None
    """J [rad^4/s^4]."""
    lower_bound: float | None = None
    """[rad^4/s^4]"""
    gap: float | None = None
    worst_constraint: str | None = None
    """The constraint that was missed; for `failed` the reason."""
    violation: float | None = None
    unit: str | None = None
    starts: int = 0
    starts_feasible: int = 0
    seconds: float = 0.0
    audit: str | None = None
    """The verdict, once there is one."""
    starts_at_best: int = 0
    """Number of starts that reached the same optimum as the best."""
    asked: int = 0
    """Number of starts that need no more solving: tried, replaced by a design carried over, or given up."""
    audit_failure: str | None = None
    """Why there is no verdict though an audit was tried."""
    margin: float = 0.0
    """The margin that the solver was asked for [m]."""
    step: int = 0
    """Its place among the `margins` of the task, 0 for the task's own."""
    force_reserve_N: float | None = None
    """Any force of this size can be added at the end-effector in hover [N]; this and what follows of an audit."""
    torque_reserve_Nm: float | None = None
    """Any torque of this size can be added in hover [N m]."""
    rotors_out_hover: int | None = None
    """Number of rotors any one of which may fail in hover."""
    load_factor: float | None = None
    """The least of hover and all load cases."""
    joint_moment_Nm: float | None = None
    """The largest of all joints and load cases [N m]."""
    hinge_tolerance_deg: float | None = None
    """Proven: hinge angles off by as much lose no clearance [deg]."""
    rod_length_m: float | None = None

    @property
    def feasible(self) -> bool:
        """True if there is a design."""
        return self.status == "feasible"

    @property
    def clear(self) -> bool:
        """True if there is a design and its audit passed."""
        return self.audit == "clear"

    @property
    def audit_ended(self) -> bool:
        """True if an audit need not be tried (again)."""
        return self.audit is not None or self.audit_failure is not None


ROW_FIELDS = tuple(field.name for field in fields(Row))
PROVEN = ("proven_bound", "proven_gap", "proof", "proven_problem")
COLUMNS = (*ROW_FIELDS[: ROW_FIELDS.index("asked")], *FLIGHT, *AUDITED, *PROVEN)
"""The columns of `candidates.csv`: fields of a row before `asked`, then what audits say, last what proofs do."""


@dataclass(frozen=True)
class SolveEvent:
    """One solve, when it ended."""

    at: float
    """Time of its end [s since 1970, UTC]."""
    key: str
    status: str
    """Key of the candidate after it."""
    objective: float | None
    """The candidate's best after it [rad^4/s^4]."""
    margin: float
    """The margin that the solver was asked for [m]."""


def row_of(outcome: Outcome, *, key: str, modules: int, orbit: int, starts: int, lower_bound: float) -> Row:
    """Return the row of a candidate that was solved from its first `starts` starts, or given up."""
    candidate = Row(key=key, modules=modules, orbit=orbit, status="failed", asked=starts, lower_bound=lower_bound)
    if isinstance(outcome, Failed):
        return replace(candidate, worst_constraint=outcome.reason)
    if record := record_of(outcome):
        counts = ("starts", "starts_feasible", "starts_at_best", "seconds")
        candidate = replace(candidate, **{name: getattr(record, name) for name in counts})
    if isinstance(outcome, Infeasible):
        missed = ("status", "worst_constraint", "violation", "unit")
        return replace(candidate, **{name: getattr(outcome, name) for name in missed})
    gap = Design.gap_of(outcome.objective, lower_bound)
    return replace(candidate, status="feasible", objective=outcome.objective, gap=gap)


def proven_cell(name: str, value: object, digits: int = 6) -> object:
    """Return what a table prints of one of an audit's figures, rounded to the side on which it is proven."""
    if not isinstance(value, float):
        return value
    at_most = {"air_tip_m_s", "air_region_m_s", "joint_moment_Nm", "rod_length_m"}  # all others are no less
    at_most |= {"speed", "joint_moment", "peak_input"}  # the goals among them
    return upper_text(value, digits) if name in at_most else lower_text(value, digits)


def flight_of(audit: Audit) -> dict[str, float | int | None]:
    """Return what a row says of its audit's figures of flight, by the names of FLIGHT."""
    flight = audit.flight
    return {name: None if flight is None else read(flight) for name, read in FLIGHT.items()}


def figures_of(audit: Audit) -> dict[str, float | None]:
    """Return what an audit says by the names of AUDITED.

    Power at the rotors' shafts in hover [W]; of all load cases the fastest air at the end-effector and over regions
    [m/s]; in hover any force that can be added at the centre of mass [N], and the tilt that can be held [deg].
    """
    hover, air = None if audit.flight is None else audit.flight.hover, audit.air
    return {
        "power_W": next((case.shaft_W for case in audit.power if hover and case.name == hover.name), None),
        "air_tip_m_s": None if air is None else air.tip_m_s,
        "air_region_m_s": None if air is None else air.region_m_s,
        "force_reserve_com_N": None if hover is None else hover.force_reserve_com_N,
        "tilt_deg": None if hover is None else hover.tilt_deg,
    }


def score(row: Row, task: ResolvedTask) -> Scored:
    """Return what a strategy learns of a candidate."""
    violation = None if row.violation is None else scaled_violation(row.violation, row.unit or "", task)
    return Scored(row.key, row.asked, row.status, row.objective, violation)


def kind_of(constraint: str) -> str:
    """Return the name of a constraint without the numbers of its modules."""
    return re.sub(r"\bmodule \d+", "a module", re.sub(r"\bmodules \d+ and \d+", "two modules", constraint))
