r"""Rigid parts and the rod against target regions that are solid: walls, panes, objects.

| symbol | meaning | shape |
|---|---|---|
| K | the region; of a cone or planes all that is outside | |
| p_E, r | the end-effector, radius of its rod | (3,), scalar |

The parts of every module keep out of K. So does the rod, but for its tip, the last TIP r before p_E; where p_E is
inside K, in the middle of a ball or a box or on a path, the rod has to reach into it, and is not asked about.
Lengths are in l_arm.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from topo_search.model import Mount, Status
from topo_search.model.audit import Kind
from verify.bodies import Cone, ConeSphere
from verify.certificate import FLOOR, Certificate, Solid
from verify.compound_certificate import certify_compounds
from verify.compounds import Compound
from verify.cone_certificate import certify_inside
from verify.contacts import RigidRequirement
from verify.convex import Convex, Polyhedron, capsule
from verify.hull_certificate import certify_outside
from verify.hulls import Hull
from verify.parts import RigidParts
from verify.parts_in_cone import certify_parts_inside
from verify.requirements import Requirement, Scene
from verify.rod import straight_rod

TIP = 2.0
"""Length of the tip, in radii of the rod."""


@dataclass(frozen=True, eq=False)
class InsideCone:
    """The parts of a module that must stay inside a cone, beyond which all is solid."""

    a: int
    b: int
    body: Compound
    against: Cone
    kind: Kind = "part-region"
    segment: int | None = None
    counts: bool = True


PartsRow = RigidRequirement | InsideCone


def parts_beside_regions(scene: Scene, parts: RigidParts) -> Iterator[PartsRow]:
    """Yield every module against every solid region."""
    for number, segment, region in _regions(scene):
        for a, module in enumerate(parts.modules):
            if isinstance(region, Cone):
                yield InsideCone(a, number, module, region, segment=segment)
            else:
                yield RigidRequirement("part-region", a, number, module, _body(region), True, segment=segment)


def rod_beside_regions(scene: Scene, parts: RigidParts, mount: Mount | None) -> Iterator[Requirement]:
    """Yield the rod from a mount, but for its tip, against every solid region that p_E is not inside of.

    It counts where the task asks for a rod.
    """
    if mount is None or not parts.in_range:
        return
    rod = straight_rod(scene.design, parts, mount)
    if rod.length <= TIP * rod.radius:
        return
    kept, counts = 1.0 - TIP * rod.radius / rod.length, scene.design.task.end_effector.rod == "straight"
    body = Solid(ConeSphere(rod.start, kept * rod.path, rod.radius, 0.0))
    for number, segment, region in _regions(scene):
        if isinstance(region, Cone):
            outside = float(region.s(scene.p_E)) >= -FLOOR  # else p_E is beyond a plane
        else:
            outside = isinstance(region, Hull) and region.depth(scene.p_E) <= FLOOR
        if outside:
            yield Requirement("rod-region", mount.module, number, body, region, segment, counts=counts)


def rod_keeps_out(scene: Scene, parts: RigidParts, mount: Mount) -> bool:
    """Return whether the rod from a mount is proven to keep out of every solid region."""
    certificates = [
        certify_outside(asked.body, asked.against)
        if isinstance(asked.against, Hull)
        else certify_inside(asked.body, asked.against)
        for asked in rod_beside_regions(scene, parts, mount)
        if isinstance(asked.against, Hull | Cone)
    ]
    return all(certificate.status is Status.CLEAR for certificate in certificates)


def certify_parts(rows: list[PartsRow]) -> list[Certificate]:
    """Return the certificates of what `parts_beside_regions` yields."""
    beside = [row for row in rows if isinstance(row, RigidRequirement)]
    certified = iter(certify_compounds([(row.body, row.against) for row in beside], [False] * len(beside)))
    return [
        next(certified) if isinstance(row, RigidRequirement) else certify_parts_inside(row.body, row.against)
        for row in rows
    ]


def _regions(scene: Scene) -> Iterator[tuple[int, int | None, Solid | Cone | Hull]]:
    """Yield every solid region with its requirement's number, and that of its path."""
    for number, requirement in enumerate(scene.design.task.exposure):
        if requirement.solid:
            yield from ((number, segment, region) for segment, region in scene.regions(requirement))


def _body(region: Solid | Hull) -> Compound:
    """Return a convex region as a rigid body."""
    solid: Convex
    if isinstance(region, Hull):
        solid = Polyhedron("region", region.mesh.vertices, region.mesh.triangles)
    else:
        ends = region.body
        solid = capsule("region", ends.o, ends.o + ends.d, ends.r)
    return Compound((solid,), solid)
