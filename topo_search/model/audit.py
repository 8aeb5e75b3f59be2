"""The audit of a design, as `audit.json` holds it, and the assembly sheet. Positive numbers are clear.

The air of a design, `air` of `audit.json`, is that of the jet model. Speeds are time averages in free air: no wall,
ground, ceiling or wind. The speed at a point is the sum of the modules' speeds there, which no sum of their
velocities exceeds; the estimate is Reichardt's sum of their momenta, the root of the sum of squares.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from topo_search.model.design import NOT_CERTIFIED, Mount, StatedCheck
from topo_search.model.exposure import EXPOSURE_KINDS, PART_NAMES, ExposureKind
from topo_search.model.flight import CasePower, Flight
from topo_search.model.proven import lower_text, upper_text
from topo_search.model.text import csv_text, heading, paragraph, table
from topo_search.model.value import OMIT_EMPTY, Flag, Index, NonNegative, Number, Omitted, Value, Vector


class BoltedJoint(Value):
    """One joint between two modules."""

    module: Index
    """The module that is already there."""
    port: Index
    """Its port: 0..3 for +x, +y, -x, -y."""
    child: Index
    """The module that is bolted to it."""
    child_port: Index
    """The child's port."""
    angle_deg: Number
    """The hinge angle [deg]."""


class Obstacle(Value):
    """Part that a straight rod would touch."""

    module: Index
    part: str
    """`hub`, `arm 0`, ..., `rotor 3`."""


class FreeConnector(Value):
    """A connector without a joint, as a mount for the end-effector's rod."""

    module: Index
    port: Index
    length_m: Number
    """From the connector to the end-effector [m]."""
    blocked_by: tuple[Obstacle, ...]
    """Obstacles to a straight rod; empty if it is available."""
    in_airflow_of: tuple[Index, ...] = ()
    """Modules whose airflow a straight rod would pass through."""


class Rod(Value):
    """A straight rod from its mount to the end-effector."""

    length_m: Number
    radius_m: Number
    mass_kg: Number
    """At `end_effector.rod_linear_density`; part of the model's mass with `rod_mass = "included"`."""
    direction: Vector
    """Unit vector from the connector to the end-effector, in W."""
    direction_in_module: Vector
    """The same in the frame of the module that carries it."""


class EndEffectorSheet(Value):
    """Position of the end-effector, and what holds it there."""

    position_m: Vector
    """p'_E in W [m]."""
    from_com_m: Vector
    """p_E [m]."""
    mount: Mount | None = None
    """The connector that carries the rod; None if no straight rod reaches the end-effector."""
    rod: Rod | None = None
    note: str | None = None
    """Remark on the mount."""
    connectors: tuple[FreeConnector, ...] = ()
    """Every free connector, nearest to the end-effector first."""

    @property
    def clear_rod(self) -> bool:
        """True if the mount's straight rod is clear of all parts and of all airflow."""
        return any(
            (one.module, one.port) == (self.mount.module, self.mount.port)
            for one in self.connectors
            if self.mount is not None and not one.blocked_by and not one.in_airflow_of
        )


class Assembly(Value):
    """The joints in bolting order, every first module being there already, and the end-effector."""

    joints: tuple[BoltedJoint, ...] = ()
    end_effector: EndEffectorSheet | None = None

    @property
    def mount(self) -> Mount | None:
        """The connector that carries the end-effector, if any does."""
        return None if self.end_effector is None else self.end_effector.mount

    def csv(self) -> str:
        """Return the sheet as a table: one row per joint, then one for the rod; its child is the end-effector."""
        of_joint = ("step", "module", "port", "child", "child_port", "angle_deg")
        rows: list[tuple[object, ...]] = [
            (step, joint.module, joint.port, joint.child, joint.child_port, joint.angle_deg, "", "", "", "")
            for step, joint in enumerate(self.joints, start=1)
        ]
        tip = self.end_effector
        if tip is not None and tip.mount is not None and tip.rod is not None:
            mount = (len(self.joints) + 1, tip.mount.module, tip.mount.port, "end-effector", "", "")
            rows.append((*mount, tip.rod.length_m, *tip.rod.direction_in_module))
        return csv_text((*of_joint, "rod_length_m", "rod_x", "rod_y", "rod_z"), rows)


WITHIN_TOLERANCES = "least clearance within the tolerances"
"""The residual of a task that requires its tolerances."""


class Status(StrEnum):
    """The verdict on one clearance, or on a whole design; from mildest to gravest."""

    CLEAR = "clear"
    UNDECIDED = "undecided"
    VIOLATED = "violated"
    INCONSISTENT = "inconsistent"

    @classmethod
    def worst(cls, statuses: Iterable[Status]) -> Status:
        """Return the gravest of some statuses, in the order of this class; clear if there are none.

        A proven violation stands whatever else is undecided; a fault of the audit itself stands above all.
        """
        order = list(cls)
        return max(statuses, key=order.index, default=cls.CLEAR)


Kind = Literal[
    "airflow",
    ExposureKind,
    "exclusion",
    "separation",
    "body",
    "rod",
    "rotor-airflow",
    "rod-airflow",
    "bracket-airflow",
    "bracket-rotor",
    "part-region",
    "rod-region",
]


class Pair(Value):
    """Two volumes that must keep clear of each other."""

    kind: Kind
    a: Index
    """A module; of a bracket the child of its joint."""
    b: Annotated[int, Field(strict=True, ge=-1)]
    """The other module, or whose airflow or rotors they are, or the number of the requirement; -1 for p_E, or for
    its rod."""
    segment: Index | None = None
    """Index of the straight piece in a directional requirement, or of the plane in an allowed one; of a
    `rotor-airflow` the rotor, None for hub and arms."""

    @property
    def name(self) -> str:
        """Both sides in the user's words, as the solver names its constraints."""
        a, b, segment, rod = f"module {self.a}", f"module {self.b}", self.segment, "the end-effector's rod"
        if self.kind in EXPOSURE_KINDS:
            part = "" if segment is None else f", {PART_NAMES[self.kind]} {segment}"
            return f"exposure {self.b} ({self.kind}{part}) of {a}"
        part = "hub and arms" if segment is None else f"rotor {segment}"
        region = f"solid exposure {self.b}" + ("" if segment is None else f", segment {segment}")
        names: dict[str, str] = {
            "exclusion": f"end-effector exclusion of {a}",
            "rod": f"{rod} and {a}",
            "rod-airflow": f"{rod} and airflow of {b}",
            "rotor-airflow": f"{part} of {a} and airflow of {b}",
            "part-region": f"{a} and {region}",
            "rod-region": f"{rod} and {region}",
            "bracket-airflow": f"the bracket of {a} and airflow of {b}",
            "bracket-rotor": f"the bracket of {a} and rotors of {b}",
        }
        return names.get(self.kind, f"{self.kind} of modules {self.a} and {self.b}")


class Clearance(Pair):
    """The certified clearance of one pair of volumes."""

    status: Status
    lower_m: Number | None
    """Proven lower bound of the clearance [m]; None when violated."""
    upper_m: Number | None
    """Proven upper bound [m]; for a violation minus the proven depth."""
    analytic_m: Number
    """Exact value from the closed form [m]."""
    level: Index
    """Mesh refinement that decided it."""
    percent: Number | None = None
    """`analytic_m` in percent of the deepest overlap of two envelopes, 2 (r_air + dr_air); only for `airflow`."""
    evidence: tuple[str, ...] = ()
    """Findings of closed form, meshes and FCL where they disagree; empty unless `inconsistent`."""
    closest_m: tuple[Vector, Vector] | None = None
    """Closest points: of a gap, the nearest point of either side; of an overlap, a point in both, twice; of a
    `separation` or `exclusion` the two centres. From the root's centre in the axes of the task [m]; None where
    digits are lost, and in files of programs that do not tell."""


class Interference(Value):
    """Severity of airflow envelope overlaps: the metrics of the paper's ablation (Sec. IV)."""

    colliding_pairs: Index
    """Number of pairs of envelopes that are proven to overlap."""
    deepest_percent: NonNegative
    """Depth of the deepest overlap in percent of 2 (r_air + dr_air); 0 without any."""
    clusters: tuple[tuple[Index, ...], ...]
    """Modules whose envelopes overlap, directly or through others; the largest cluster first."""


class Residual(Value):
    """One checked number of a design: how far it is off, against what is allowed."""

    name: str
    """Name of the check, in the user's words, e.g. `load case 2, torque`."""
    value: Number
    """Largest deviation, in `unit`; zero when met."""
    unit: str
    scaled: Number
    """The deviation in units of its tolerance's scale (m_t g, l_arm m_t g, u_max, relative, rad)."""
    tolerance: NonNegative
    """Largest `scaled` that passes."""
    status: Status
    stated: Number | None = None
    """The number that the design states, where it states one."""
    derived: Number | None = None
    """The same number or its limit, as the audit derives it."""

    @property
    def words(self) -> str:
        """Name of the check where a person reads it."""
        return "control effort J" if self.name == "objective" else self.name


class Limit(Pair):
    """Largest error of one kind that is tolerated, and the pair that a larger one violates first."""

    tolerated: NonNegative
    """Proven: no error up to this violates any pair."""
    violated_at: NonNegative | None
    """Shown by an example: some error of this size does; None if none was found."""


class WorstCase(Pair):
    """Effect of errors as large as the task's tolerances, all at once, on the pair that is nearest to violation."""

    status: Status
    """Clear if no such error violates any pair, violated if one is known that does, else undecided."""
    lower_m: Number
    """Proven lower bound of the clearance [m]."""
    attained_m: Number
    """Clearance that some such errors leave: the bound is too low by no more than the difference [m]."""
    factor: Limit | None
    """By what factor all tolerances may grow together; None if no factor is too large."""


class Sensitivity(Value):
    """Errors that the clearances of a design tolerate, one kind at a time; None where no size violates anything."""

    hinge_angle_deg: Limit | None
    """Every hinge angle off by as much [deg]."""
    position_m: Limit | None
    """Every module's centre and the end-effector off by as much [m]."""
    envelope_m: Limit | None
    """The airflow reaching beyond its envelope by as much [m]."""
    tolerances: WorstCase | None = None
    """The tolerances of the task, if it has any."""


class AllowedContact(Value):
    """Rigid parts that may touch, because they are bolted together."""

    kind: Literal["body", "rod"]
    a: Index
    """A module."""
    b: Annotated[int, Field(strict=True, ge=-1)]
    """The module that is bolted to it; -1 for the end-effector's rod."""
    parts: str
    """Parts of a and b that may touch."""


class MeshExcess(Value):
    """Excess of a region over the mesh from which it was read."""

    exposure: Index
    """Number of the requirement."""
    segment: Index | None
    """Index of the convex piece; None where there is one alone."""
    at_most_m: NonNegative
    """No point of the piece's surface is farther from that of the mesh [m]."""

    @property
    def words(self) -> str:
        """Region that is larger than its mesh, and by how much."""
        piece = "" if self.segment is None else f", piece {self.segment},"
        return f"exposure {self.exposure}{piece} reaches up to {upper_text(self.at_most_m, 3)} m beyond its mesh"


class Audit(Value):
    """Everything recomputed from a design alone, and the verdict."""

    model_config = ConfigDict(extra="ignore")

    format: Literal["topo-search/audit"] = "topo-search/audit"
    version: Literal[1] = 1
    verdict: Status
    inputs_computed: Annotated[Flag, OMIT_EMPTY] = False
    """True if the design came without inputs, and the best that the audit finds are judged."""
    pairs: tuple[Clearance, ...]
    residuals: tuple[Residual, ...]
    interference: Interference | None = None
    """None where envelopes may merge, and in files of programs that do not compute it."""
    sensitivity: Sensitivity | None = None
    """None if there is no clearance to lose, and where airflow envelopes may merge."""
    flight: Flight | None = None
    """Capabilities of the design beyond its task; None if its numbers are too large to compute with, and in files
    of programs that do not compute it."""
    power: Annotated[tuple[CasePower, ...], OMIT_EMPTY] = ()
    """Power of the rotors in hover, where that is possible, and in every load case; empty in older files."""
    air: Omitted[AirSpeeds] = None
    """Air speeds by the jet model; None if numbers are too large to compute with, and in older files."""
    stated: Annotated[tuple[StatedCheck, ...], OMIT_EMPTY] = ()
    """The user's own constraints: evaluated by their functions, not certified.

    A violated one makes the verdict `violated`; a met one is not a proof."""
    mesh_excess: Annotated[tuple[MeshExcess, ...], OMIT_EMPTY] = ()
    """Regions larger than the mesh that they were read from, as the design's file says."""
    assembly: Assembly
    """Assembly sheet: what to bolt to what."""
    allowed_contacts: tuple[AllowedContact, ...]
    """Parts that may touch by construction; any other contact is a violation."""
    versions: dict[str, str]
    seconds: NonNegative

    @property
    def inputs_words(self) -> str | None:
        """Origin of the inputs and their effort, in words; None if the design gives them."""
        if not self.inputs_computed:
            return None
        J = next(row.derived for row in self.residuals if row.name == "objective")
        return f"the design gives no inputs; judged with the best that the audit finds, J = {J:.6g} rad^4/s^4"

    @property
    def tolerances_words(self) -> str | None:
        """Clearances that the task's tolerances, all at once, leave, in words; None if it has none."""
        worst = None if self.sensitivity is None else self.sensitivity.tolerances
        if worst is None:
            return None
        measured = all(row.name != WITHIN_TOLERANCES for row in self.residuals)
        least, attained = lower_text(worst.lower_m, 3), upper_text(worst.attained_m, 3)
        return (
            f"within the task's tolerances: {worst.status}, least clearance {least} m or more "
            f"({attained} m in an example), {worst.name}" + measured * "; measured, not required"
        )

    def _repr_html_(self) -> str:
        """Show a notebook the verdict, the least clearances, and all that is not clear."""
        nearest = sorted(self.pairs, key=lambda pair: (pair.status is Status.CLEAR, pair.analytic_m))
        odd = sum(pair.status is not Status.CLEAR for pair in self.pairs)
        pairs = [
            (
                *(pair.name, pair.status, None if pair.lower_m is None else lower_text(pair.lower_m)),
                *(None if pair.upper_m is None else upper_text(pair.upper_m), lower_text(pair.analytic_m)),
            )
            for pair in nearest[: max(odd, 10)]  # the nearest ten at least
        ]
        html = heading(f"audit: {self.verdict}, {len(self.pairs)} clearances, the least of them:")
        html += paragraph(self.inputs_words) if self.inputs_words is not None else ""
        head = ("clearance of", "audit", "proven at least [m]", "proven at most [m]", "closed form [m]")
        html += table(head, pairs)
        if broken := [residual for residual in self.residuals if residual.status is not Status.CLEAR]:
            rows = [
                (
                    *(one.name, upper_text(one.value), one.unit, upper_text(one.scaled)),
                    *(lower_text(one.tolerance), one.status),
                )
                for one in broken
            ]
            html += heading("not met:") + table(("name", "value", "unit", "scaled", "tolerance", "status"), rows)
        if self.stated:
            checks = [(one.name, one.bounds, one.words) for one in self.stated]
            html += heading(f"{NOT_CERTIFIED}:") + table(("constraint", "bounds", "it came to"), checks)
        return html


Speed = Annotated[float, Field(strict=True, ge=0)]
"""[m/s]"""


class RegionAir(Value):
    """The air over the region of one exposure requirement in one load case."""

    name: str
    speed_m_s: Speed
    """Speed at a point of the region, the largest that was found."""
    speed_at_most_m_s: Speed
    """Proven of the model: no point of the region has more."""
    estimate_m_s: Speed
    """Reichardt's estimate at the point of `speed_m_s`."""
    limit_m_s: Speed | None = None
    """The requirement's `speed`."""
    status: Literal["clear", "undecided", "violated"] | None = None
    """Verdict on the limit; None without one."""


class RotorAir(Value):
    """Wakes of other modules through a rotor's disc, on average."""

    module: Index
    rotor: Index
    ingested_m_s: Speed
    """Sum of the speeds of their jets."""
    thrust_loss: Annotated[float, Field(strict=True, ge=0, le=1)]
    """Share of the rotor's thrust lost."""


class CaseAir(Value):
    """The air in one load case."""

    name: str
    tip_m_s: Speed
    """Speed at the end-effector."""
    tip_estimate_m_s: Speed
    """Reichardt's estimate there."""
    regions: tuple[RegionAir, ...] = ()
    """One an exposure requirement."""
    rotors: tuple[RotorAir, ...] = ()


class AirSpeeds(Value):
    """The air in every load case, in the order of the task's."""

    cases: tuple[CaseAir, ...]

    @property
    def tip_m_s(self) -> float:
        """Largest speed at the end-effector."""
        return max(case.tip_m_s for case in self.cases)

    @property
    def region_m_s(self) -> float | None:
        """Proven bound of the speed over all regions; None without regions."""
        return max((region.speed_at_most_m_s for case in self.cases for region in case.regions), default=None)

    @property
    def worst_rotor(self) -> tuple[CaseAir, RotorAir] | None:
        """The rotor that loses the largest share of its thrust to wakes; None if none does."""
        rotors = ((case, rotor) for case in self.cases for rotor in case.rotors)
        worst = max(rotors, key=lambda pair: pair[1].thrust_loss, default=None)
        return worst if worst is not None and worst[1].thrust_loss > 0 else None

    def sentences(self) -> Iterator[str]:
        """Yield the largest speeds: at the end-effector, over each region, through a rotor."""
        tip = max(self.cases, key=lambda case: case.tip_m_s)
        yield f"air at the tip: {upper_text(tip.tip_m_s, 3)} m/s by the jet model, in {tip.name}"
        for number, region in enumerate(tip.regions):
            case = max(self.cases, key=lambda case: case.regions[number].speed_at_most_m_s)
            fastest = case.regions[number]
            limit = "" if fastest.limit_m_s is None else f", allowed {fastest.limit_m_s:g} m/s: {fastest.status}"
            yield (
                f"air over {region.name}: at most {upper_text(fastest.speed_at_most_m_s, 3)} m/s, "
                f"in {case.name}{limit}"
            )
        if (worst := self.worst_rotor) is not None:
            case, rotor = worst
            yield (
                f"wakes through rotors: {upper_text(rotor.ingested_m_s, 3)} m/s through rotor {rotor.rotor} of "
                f"module {rotor.module}, which loses {upper_text(100 * rotor.thrust_loss, 3)} % of its thrust, "
                f"in {case.name}"
            )


class EnvelopeAir(Value):
    """The largest speeds on a module's airflow envelope, alone in free air, proven of the model, to 0.1 %."""

    side_m_s: Speed
    """On the side of the cone."""
    side_merged_m_s: Speed | None
    """The same, from where the jets of the rotors have merged; None if the side ends above."""
    end_m_s: Speed
    """On the far ball."""
    rotor_plane_m_s: Speed
    """In the plane of the rotors, outside the envelope."""


class SpeedEnvelope(Value):
    """The smallest cone-sphere, to a percent, around all air of a module that is at least as fast as a speed."""

    start_radius_m: Speed
    spread_angle_deg: Speed
    reach_m: Speed
    volume_m3: Speed
    least_volume_m3: Speed
    """No cone-sphere around that air is smaller, if it starts at the module's centre and widens downwards."""
