"""Audit of a design, as in `audit.json`, and assembly sheet. Positive clearances are clear.

Air speeds, `air` of `audit.json`, are those of the jet model: time averages in free air, without walls, ground,
ceiling or wind. The speed at a point is the sum of the modules' speeds there, an upper bound for the sum of their
velocities; the estimate is Reichardt's superposition of momenta, the root of the sum of squares.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import ConfigDict, Field

from topo_search.model.design import NOT_CERTIFIED, StatedCheck
from topo_search.model.exposure import EXPOSURE_KINDS, PART_NAMES, ExposureKind
from topo_search.model.flight import CasePower, Flight, Size
from topo_search.model.module import Mount
from topo_search.model.proven import lower_text, upper_text
from topo_search.model.text import csv_text, heading, paragraph, table
from topo_search.model.value import OMIT_EMPTY, Flag, Index, NonNegative, Number, Omitted, Value, Vector

if TYPE_CHECKING:
    from topo_search.model.task import ResolvedTask


class BoltedJoint(Value):
    """Joint between two modules."""

    module: Index
    """Module that is already in place."""
    port: Index
    """Its port: 0..3 for +x, +y, -x, -y."""
    child: Index
    """Module that is bolted to it."""
    child_port: Index
    """The child's port."""
    angle_deg: Number
    """Hinge angle [deg]."""


class Obstacle(Value):
    """Part that a straight rod would touch."""

    module: Index
    part: str
    """`hub`, `arm 0`, ..., `rotor 3`."""


class FreeConnector(Mount):
    """Connector without a joint, a possible mount for the end-effector's rod."""

    length_m: Number
    """From the connector to the end-effector [m]."""
    blocked_by: tuple[Obstacle, ...]
    """Obstacles to a straight rod; empty if it is available."""
    in_airflow_of: tuple[Index, ...] = ()
    """Modules whose airflow a straight rod would pass through."""


class Rod(Value):
    """Straight rod from its mount to the end-effector."""

    length_m: Number
    radius_m: Number
    mass_kg: Number
    """Mass by `end_effector.rod_linear_density` [kg]; part of the platform's mass with `rod_mass = "included"`."""
    direction: Vector
    """Unit vector from the connector to the end-effector, in W."""
    direction_in_module: Vector
    """The same direction in the frame of the module that carries the rod."""


class EndEffectorSheet(Value):
    """Position of the end-effector, and its mount."""

    position_m: Vector
    """p'_E in W [m]."""
    from_com_m: Vector
    """p_E [m]."""
    mount: Mount | None = None
    """Connector that carries the rod; None if no straight rod reaches the end-effector."""
    rod: Rod | None = None
    note: str | None = None
    """Remark on the mount."""
    connectors: tuple[FreeConnector, ...] = ()
    """Every free connector, nearest to the end-effector first."""

    @property
    def clear_rod(self) -> bool:
        """True if the mount's straight rod is clear of all parts and of all airflow."""
        return any(
            (connector.module, connector.port) == (self.mount.module, self.mount.port)
            for connector in self.connectors
            if self.mount is not None and not connector.blocked_by and not connector.in_airflow_of
        )


class Assembly(Value):
    """Joints in bolting order, so that `module` is always in place already, and the end-effector."""

    joints: tuple[BoltedJoint, ...] = ()
    end_effector: EndEffectorSheet | None = None

    @property
    def mount(self) -> Mount | None:
        """Connector that carries the end-effector, if any."""
        return None if self.end_effector is None else self.end_effector.mount

    def csv(self) -> str:
        """Return the sheet as CSV: one row per joint, then one for the rod, whose child is the end-effector."""
        joint_columns = ("step", "module", "port", "child", "child_port", "angle_deg")
        rows: list[tuple[object, ...]] = [
            (step, joint.module, joint.port, joint.child, joint.child_port, joint.angle_deg, "", "", "", "")
            for step, joint in enumerate(self.joints, start=1)
        ]
        tip = self.end_effector
        if tip is not None and tip.mount is not None and tip.rod is not None:
            mount = (len(self.joints) + 1, tip.mount.module, tip.mount.port, "end-effector", "", "")
            rows.append((*mount, tip.rod.length_m, *tip.rod.direction_in_module))
        return csv_text((*joint_columns, "rod_length_m", "rod_x", "rod_y", "rod_z"), rows)


WITHIN_TOLERANCES = "least clearance within the tolerances"
"""Name of the residual of a task that requires its tolerances."""


class Status(StrEnum):
    """Verdict on a clearance or a design, from best to worst."""

    CLEAR = "clear"
    UNDECIDED = "undecided"
    VIOLATED = "violated"
    INCONSISTENT = "inconsistent"

    @classmethod
    def worst(cls, statuses: Iterable[Status]) -> Status:
        """Return the worst of some statuses, in the order of this class; clear if there are none.

        A proven violation outranks undecided clearances; a fault of the audit itself outranks everything.
        """
        return max(statuses, key=list(cls).index, default=cls.CLEAR)


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
    """Two volumes that must stay clear of each other."""

    kind: Kind
    a: Index
    """Module; for a bracket, the child of its joint."""
    b: Annotated[int, Field(strict=True, ge=-1)]
    """The other module, the module with the airflow or rotors, or the number of the requirement; -1 for p_E or its
    rod."""
    segment: Index | None = None
    """Index of the straight piece of a directional requirement, or the plane of an allowed one; for
    `rotor-airflow` the rotor, or None for hub and arms."""

    @property
    def name(self) -> str:
        """Name of the pair, the same as the solver's name of the constraint."""
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
    """Certified clearance of a pair of volumes."""

    status: Status
    lower_m: Number | None
    """Proven lower bound of the clearance [m]; None when violated."""
    upper_m: Number | None
    """Proven upper bound [m]; for a violation, minus the proven depth."""
    analytic_m: Number
    """Exact value from the closed form [m]. Of overlapping rigid bodies, minus the depth of their deepest two
    parts: an upper bound on it if one is a rotor, or if they have too many edges."""
    level: Index
    """Level of mesh refinement that decided the status."""
    percent: Number | None = None
    """`analytic_m` as a percentage of the deepest possible overlap, 2 (r_air + dr_air); only for `airflow`."""
    evidence: tuple[str, ...] = ()
    """Results of closed form, meshes and FCL if they disagree; empty unless `inconsistent`."""
    closest_m: tuple[Vector, Vector] | None = None
    """Closest points: for a gap, the nearest point of each volume; for an overlap, one common point, twice; for
    `separation` and `exclusion`, the two centres. From the root's centre, in task axes [m]; None if lost to
    rounding, or if the file does not say."""


def counts(kind: Kind, task: ResolvedTask) -> bool:
    """True if a clearance of a kind that is not clear affects the verdict on a design for a task."""
    needs_rod = task.end_effector.rod == "straight"
    conditions = {
        "airflow": task.search.interference == "airflow",
        "body": task.body_clearance is not None,
        "rod": needs_rod or task.body_clearance is not None,
        "rod-airflow": needs_rod,
        "rod-region": needs_rod,
        "rotor-airflow": task.parts_off_airflow,
    }
    return conditions.get(kind, True)


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
    """Largest deviation, in `unit`; zero if the check passes."""
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


class Limit(Pair):
    """Largest tolerated error of one kind, and the pair that larger errors violate first."""

    tolerated: NonNegative
    """Proven: no error up to this size violates any pair."""
    violated_at: NonNegative | None
    """Shown by an example: some error of this size violates a pair; None if none was found."""


class WorstCase(Pair):
    """Effect of all errors within the task's tolerances, combined, on the most critical pair."""

    status: Status
    """Clear if no such error violates any pair, violated if a known one does, otherwise undecided."""
    lower_m: Number
    """Proven lower bound of the clearance [m]."""
    attained_m: Number
    """Clearance in an example of such errors [m]; the bound is too low by at most the difference."""
    factor: Limit | None
    """Factor by which all tolerances may grow together; None if no factor is too large."""


class Sensitivity(Value):
    """Errors that all clearances of a design tolerate, one kind at a time; None if no size violates any.

    Errors are in the frame of the module that carries the rod.
    """

    hinge_angle_deg: Limit | None
    """Error of every hinge angle [deg]; the end-effector and its regions keep their place at the rod's module."""
    position_m: Limit | None
    """Error of the position of every module's centre and the end-effector [m]."""
    envelope_m: Limit | None
    """Reach of airflow beyond its envelope [m]."""
    tolerances: WorstCase | None = None
    """Effect of the task's tolerances, if it has any."""


class AllowedContact(Value):
    """Rigid parts that may touch, because they are bolted together."""

    kind: Literal["body", "rod"]
    a: Index
    """Module."""
    b: Annotated[int, Field(strict=True, ge=-1)]
    """Module that is bolted to it; -1 for the end-effector's rod."""
    parts: str
    """Parts of a and b that may touch."""


class MeshExcess(Value):
    """Excess of a region over its source mesh."""

    exposure: Index
    """Number of the requirement."""
    segment: Index | None
    """Index of the convex piece; None for a single one."""
    at_most_m: NonNegative
    """Upper bound for the distance of the piece's surface from that of the mesh [m]."""

    @property
    def words(self) -> str:
        """Region and excess, in words."""
        piece = "" if self.segment is None else f", piece {self.segment},"
        return f"exposure {self.exposure}{piece} reaches up to {upper_text(self.at_most_m, 3)} m beyond its mesh"


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
    sensitivity: Sensitivity | None = None
    """None without clearances, and where airflow envelopes may merge."""
    flight: Flight | None = None
    """Capabilities of the design beyond its task; None if its numbers are too large to compute with, or if the file
    does not say."""
    power: Annotated[tuple[CasePower, ...], OMIT_EMPTY] = ()
    """Power of the rotors in hover, if possible, and in every load case; empty in older files."""
    air: Omitted[AirSpeeds] = None
    """Air speeds by the jet model; None if numbers are too large to compute with, or in older files."""
    stated: Annotated[tuple[StatedCheck, ...], OMIT_EMPTY] = ()
    """Results of the user's own constraints: evaluated, not certified.

    A violated one makes the verdict `violated`; a met one proves nothing."""
    mesh_excess: Annotated[tuple[MeshExcess, ...], OMIT_EMPTY] = ()
    """Regions that are larger than their source mesh, according to the design file."""
    assembly: Assembly
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
                held = self._missed_tolerances(task) if row.name == WITHIN_TOLERANCES else ""
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
        measured = all(row.name != WITHIN_TOLERANCES for row in self.residuals)
        least, attained = lower_text(worst.lower_m, 3), upper_text(worst.attained_m, 3)
        return (
            f"within the task's tolerances: {worst.status}, smallest clearance {least} m or more "
            f"({attained} m in an example), {worst.name}" + measured * "; measured, not required"
        )

    def _repr_html_(self) -> str:
        """Show the verdict, the smallest clearances and all failures in a notebook."""
        nearest = sorted(self.pairs, key=lambda pair: (pair.status is Status.CLEAR, pair.analytic_m))
        not_clear = sum(pair.status is not Status.CLEAR for pair in self.pairs)

        def bound(value: float | None, text: Callable[[float], str]) -> str | None:
            return None if value is None else text(value)

        pairs = [
            (p.name, p.status, bound(p.lower_m, lower_text), bound(p.upper_m, upper_text), lower_text(p.analytic_m))
            for p in nearest[: max(not_clear, 10)]  # at least ten
        ]
        html = heading(f"audit: {self.verdict}, {len(self.pairs)} clearances, the least of them:")
        html += paragraph(self.inputs_words) if self.inputs_words is not None else ""
        head = ("clearance of", "audit", "proven at least [m]", "proven at most [m]", "closed form [m]")
        html += table(head, pairs)
        if failures := [residual for residual in self.residuals if residual.status is not Status.CLEAR]:
            rows = [
                (r.name, upper_text(r.value), r.unit, upper_text(r.scaled), lower_text(r.tolerance), r.status)
                for r in failures
            ]
            html += heading("not met:") + table(("name", "value", "unit", "scaled", "tolerance", "status"), rows)
        if self.stated:
            checks = [(row.name, row.bounds, row.words) for row in self.stated]
            html += heading(f"{NOT_CERTIFIED}:") + table(("constraint", "bounds", "result"), checks)
        return html


class RegionAir(Value):
    """Air speeds in the region of an exposure requirement in one load case."""

    name: str
    """Name of the requirement."""
    speed_m_s: Size
    """Largest speed found at a point of the region [m/s]."""
    speed_at_most_m_s: Size
    """Proven upper bound of the speed in the region, by the model [m/s]."""
    estimate_m_s: Size
    """Reichardt's estimate at the point of `speed_m_s` [m/s]."""
    limit_m_s: Size | None = None
    """Limit, the requirement's `speed` [m/s]; None without one."""
    status: Literal["clear", "undecided", "violated"] | None = None
    """Verdict on the limit; None without a limit."""


class RotorAir(Value):
    """Average wake of other modules through a rotor's disc."""

    module: Index
    rotor: Index
    ingested_m_s: Size
    """Sum of the speeds of their jets [m/s]."""
    thrust_loss: Annotated[float, Field(strict=True, ge=0, le=1)]
    """Share of the rotor's thrust lost."""
    lost_N: Omitted[Size] = None
    """Thrust lost [N]; None in older audits."""


class CaseAir(Value):
    """Air speeds in one load case."""

    name: str
    """Name of the load case."""
    tip_m_s: Size
    """Speed at the end-effector [m/s]."""
    tip_estimate_m_s: Size
    """Reichardt's estimate at the end-effector [m/s]."""
    regions: tuple[RegionAir, ...] = ()
    """One entry per exposure requirement."""
    rotors: tuple[RotorAir, ...] = ()


FAST_AIR = 3.0
"""Speed of the air over a region without a limit from which answers warn [m/s]."""


class FastAir(Value):
    """Fast air over a region without a limit on air speed, in its worst load case."""

    exposure: Index
    """Number of the requirement."""
    case: str
    """Name of the load case."""
    speed_at_most_m_s: Size
    """Same as in `RegionAir`."""


class AirSpeeds(Value):
    """Air speeds in every load case, in the order of the task."""

    cases: tuple[CaseAir, ...]

    @property
    def tip_m_s(self) -> float:
        """Largest speed at the end-effector [m/s]."""
        return max(case.tip_m_s for case in self.cases)

    @property
    def region_m_s(self) -> float | None:
        """Proven upper bound of the speed in all regions [m/s]; None without regions."""
        return max((region.speed_at_most_m_s for case in self.cases for region in case.regions), default=None)

    @property
    def fast(self) -> tuple[FastAir, ...]:
        """Regions without a limit whose air may move at FAST_AIR or more."""
        over = zip(*(case.regions for case in self.cases), strict=True)
        worst = (
            max(zip(regions, self.cases, strict=True), key=lambda pair: pair[0].speed_at_most_m_s)
            for regions in over
        )
        return tuple(
            FastAir(exposure=number, case=case.name, speed_at_most_m_s=region.speed_at_most_m_s)
            for number, (region, case) in enumerate(worst)
            if region.limit_m_s is None and region.speed_at_most_m_s > FAST_AIR
        )

    @property
    def worst_rotor(self) -> tuple[CaseAir, RotorAir] | None:
        """Rotor that loses the most thrust to wakes, with its load case; None without losses."""
        rotors = ((case, rotor) for case in self.cases for rotor in case.rotors)
        worst = max(rotors, key=lambda pair: (pair[1].lost_N or 0.0, pair[1].thrust_loss), default=None)
        return worst if worst is not None and worst[1].thrust_loss > 0 else None

    def sentences(self) -> Iterator[str]:
        """Yield sentences about the largest speeds: at the end-effector, in each region, through a rotor."""
        tip = max(self.cases, key=lambda case: case.tip_m_s)
        yield f"air at the tip: {upper_text(tip.tip_m_s, 3)} m/s by the jet model, in {tip.name}"
        for number, region in enumerate(tip.regions):
            case = max(self.cases, key=lambda case: case.regions[number].speed_at_most_m_s)
            fastest = case.regions[number]
            limit = "" if fastest.limit_m_s is None else f", allowed {fastest.limit_m_s:g} m/s: {fastest.status}"
            if number in {air.exposure for air in self.fast}:
                limit = f"; envelopes do not limit speed, exposure[{number}].speed does"
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
    """Largest speeds on the airflow envelope of a single module in free air, proven to 0.1 % for the model."""

    side_m_s: Size
    """On the side of the cone [m/s]."""
    side_merged_m_s: Size | None
    """The same below the point where the rotors' jets merge [m/s]; None if the side ends above it."""
    end_m_s: Size
    """On the far ball [m/s]."""
    rotor_plane_m_s: Size
    """In the plane of the rotors, outside the envelope [m/s]."""


class SpeedEnvelope(Value):
    """Cone-sphere around all air of a module above a speed; the smallest one, to a percent."""

    start_radius_m: Size
    spread_angle_deg: Size
    reach_m: Size
    volume_m3: Size
    least_volume_m3: Size
    """Lower bound for the volume of such a cone-sphere that starts at the module's centre and widens downwards."""
