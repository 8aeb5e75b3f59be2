"""Pairs of volumes that must stay clear of each other, and their certified clearances; positive ones are clear."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from topo_search.model.exposure import EXPOSURE_KINDS, PART_NAMES, ExposureKind, solid_name
from topo_search.model.kinds import Index, Number, Omitted, Vector
from topo_search.model.value import Value

if TYPE_CHECKING:
    from topo_search.model.task import ResolvedTask


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
    rotor: Omitted[Index] = None
    """Rotor whose airflow it is, where each has an envelope of its own."""
    contact: Omitted[Index] = None
    """Load case whose object the solid region `b` is."""

    @property
    def name(self) -> str:
        """Name of the pair, the same as the solver's name of the constraint."""
        a, b, segment, rod = f"module {self.a}", f"module {self.b}", self.segment, "the end-effector's rod"
        of_rotor = "" if self.rotor is None else f"rotor {self.rotor} of "
        if self.kind in EXPOSURE_KINDS:
            part = "" if segment is None else f", {PART_NAMES[self.kind]} {segment}"
            return f"exposure {self.b} ({self.kind}{part}) of {of_rotor}{a}"
        part = "hub and arms" if segment is None else f"rotor {segment}"
        region = solid_name(self.b, segment, self.contact)
        names: dict[str, str] = {
            "exclusion": f"end-effector exclusion of {a}",
            "rod": f"{rod} and {a}",
            "rod-airflow": f"{rod} and airflow of {of_rotor}{b}",
            "rotor-airflow": f"{part} of {a} and airflow of {of_rotor}{b}",
            "part-region": f"{a} and {region}",
            "rod-region": f"{rod} and {region}",
            "bracket-airflow": f"the bracket of {a} and airflow of {of_rotor}{b}",
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
