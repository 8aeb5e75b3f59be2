"""Audit of a design, as in `audit.json`: clearances, checked numbers and the sections of features."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import ConfigDict, Field

from topo_search.model import features
from topo_search.model.clearance import Clearance, Status, counts
from topo_search.model.kinds import OMIT_EMPTY, Flag, Index, NonNegative, Number, Omitted
from topo_search.model.proven import lower_text, upper_text
from topo_search.model.value import Value

if TYPE_CHECKING:
    from topo_search.model.task import ResolvedTask


class Interference(Value):
    """Severity of overlaps of airflow envelopes: the metrics of the paper's ablation (Sec. IV)."""

    colliding_pairs: Index
    """Number of pairs of envelopes proven to overlap."""
    deepest_percent: NonNegative
    """Depth of the deepest overlap as a percentage of 2 (r_air + dr_air); 0 without overlaps."""
    clusters: tuple[tuple[Index, ...], ...]
    """Groups of modules whose envelopes overlap directly or through others, the largest first."""


class Residual(Value):
    """Checked number of a design: its deviation and the allowed one."""

    name: str
    """Name of the check, e.g. `load case 2, torque`."""
    value: Number
    """Largest deviation, in `unit`; zero or within the tolerance if the check passes."""
    unit: str
    """Unit of `value`."""
    scaled: Number
    """The deviation in units of the scale of its tolerance (m_t g, l_arm m_t g, u_max, relative, rad)."""
    tolerance: NonNegative
    """Largest `scaled` that passes."""
    status: Status
    stated: Number | None = None
    """The number in the design, if it has one."""
    derived: Number | None = None
    """The same number, or its limit, as computed by the audit."""

    @property
    def words(self) -> str:
        """Name of the check for a reader."""
        return "control effort J" if self.name == "objective" else self.name


class AllowedContact(Value):
    """Rigid parts that may touch, because they are bolted together."""

    kind: Literal["body", "rod"]
    a: Index
    """Module."""
    b: Annotated[int, Field(strict=True, ge=-1)]
    """Module that is bolted to it; -1 for the end-effector's rod."""
    parts: str
    """Parts of a and b that may touch."""


class Audit(Value):
    """Verdict on a design, with all numbers recomputed from the design alone."""

    model_config = ConfigDict(extra="ignore")

    format: Literal["topo-search/audit"] = "topo-search/audit"
    version: Literal[1] = 1
    verdict: Status
    inputs_computed: Annotated[Flag, OMIT_EMPTY] = False
    """True if the design has no inputs, so that the best inputs that the audit finds are judged."""
    pairs: tuple[Clearance, ...]
    residuals: tuple[Residual, ...]
    interference: Interference | None = None
    """None where envelopes may merge, or if the file does not say."""
    sensitivity: features.Sensitivity | None = None
    """None without clearances, and where airflow envelopes may merge."""
    flight: features.Flight | None = None
    """Capabilities of the design beyond its task; None if its numbers are too large to compute with, or if the file
    does not say."""
    power: Annotated[tuple[features.CasePower, ...], OMIT_EMPTY] = ()
    """Power of the rotors in hover, if possible, and in every load case; empty in older files."""
    air: Omitted[features.AirSpeeds] = None
    """Air speeds by the jet model; None if numbers are too large to compute with, or in older files."""
    stated: Annotated[tuple[features.StatedCheck, ...], OMIT_EMPTY] = ()
    """Results of the user's own constraints: evaluated, not certified.

    A violated one makes the verdict `violated`; a met one proves nothing."""
    mesh_excess: Annotated[tuple[features.MeshExcess, ...], OMIT_EMPTY] = ()
    """Regions that are larger than their source mesh, according to the design file."""
    placement: Omitted[features.Placement] = None
    """Load cases in which the rod pulls, and solid half-spaces near rotors; None without either."""
    assembly: features.Assembly
    """Assembly sheet."""
    allowed_contacts: tuple[AllowedContact, ...]
    """Parts that may touch by construction; any other contact is a violation."""
    versions: dict[str, str]
    """Versions of the libraries."""
    seconds: NonNegative
    """Wall-clock time of the audit [s]."""

    def failure(self, task: ResolvedTask) -> str | None:
        """Return the first check that keeps the audit of a design for a task from being clear, in words."""
        judged = [pair for pair in self.pairs if pair.status is not Status.CLEAR and counts(pair.kind, task)]
        if judged:
            worst = min(judged, key=lambda pair: pair.analytic_m)
            return f"{worst.name} ({worst.status}, clearance {upper_text(worst.analytic_m, 3)} m)"
        for row in self.residuals:
            if row.status is not Status.CLEAR:
                held = self._missed_tolerances(task) if row.name == features.WITHIN_TOLERANCES else ""
                return f"{row.words} ({row.status}, off by {upper_text(row.value, 3)} {row.unit}{held})"
        return next((f"{row.name} ({row.words})" for row in self.stated if row.status == "missed"), None)

    def _missed_tolerances(self, task: ResolvedTask) -> str:
        """Return the task's tolerances that a design does not hold even alone, with what it holds."""
        limits = {} if self.sensitivity is None else dict(self.sensitivity)
        asked = (("hinge_angle_deg", "hinge_angle_deg"), ("position", "position_m"), ("envelope", "envelope_m"))
        words = [
            f"; tolerances.{field} = {value:g}, but {lower_text(limit.tolerated, 3)} is held"
            for field, name in asked
            if (value := getattr(task.tolerances, field)) and (limit := limits.get(name))
            if limit.tolerated < value
        ]
        return "".join(words) or "; all of [tolerances] at once, but each alone is held"

    @property
    def inputs_words(self) -> str | None:
        """Note on computed inputs and their effort; None if the design has inputs."""
        if not self.inputs_computed:
            return None
        J = next(row.derived for row in self.residuals if row.name == "objective")
        return f"the design gives no inputs; judged with the best that the audit finds, J = {J:.6g} rad^4/s^4"

    @property
    def tolerances_words(self) -> str | None:
        """Least clearance within the task's tolerances, in words; None without tolerances."""
        worst = None if self.sensitivity is None else self.sensitivity.tolerances
        if worst is None:
            return None
        measured = all(row.name != features.WITHIN_TOLERANCES for row in self.residuals)
        least, attained = lower_text(worst.lower_m, 3), upper_text(worst.attained_m, 3)
        return (
            f"within the task's tolerances: {worst.status}, smallest clearance {least} m or more "
            f"({attained} m in an example), {worst.name}" + measured * "; measured, not required"
        )

    _repr_html_ = features.audit_html
