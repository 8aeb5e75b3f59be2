r"""Rigid parts and the rod against target regions that are solid: walls, panes, objects.

| symbol | meaning | shape |
|---|---|---|
| K | the region; of a cone or planes all that is outside | |
| p_E, r | the end-effector, radius of its rod | (3,), scalar |

The parts of every module keep out of K. So does the rod. Where p_E is within r of the surface of K, its tip touches
K, and the rod keeps out but for the last TIP r before p_E. Where p_E is deeper inside, in the middle of a ball or a
box or on a path, the rod has to reach into K, and nothing is required of it. Lengths are in l_arm.
"""

from __future__ import annotations

from collections.abc import Iterator

from topo_search.model import Design, Mount, Status
from topo_search.model.module import TIP
from verify.bodies import Array, Cone, ConeSphere, ball
from verify.certificate import FLOOR, Certificate, Row, Solid, certify_pairs
from verify.compounds import Compound, certify_compounds
from verify.cones import certify_inside, certify_parts_inside
from verify.contacts import RigidRequirement
from verify.convex import Convex, Polyhedron, capsule
from verify.hulls import Hull, approach, certify_outside
from verify.kinematics import platform
from verify.parts import RigidParts
from verify.requirements import Requirement, Scene
from verify.rod import straight_rod


class InsideCone(Row[Compound, Cone]):
    """The parts of a module that must stay inside a cone, beyond which all is solid."""


PartsRow = RigidRequirement | InsideCone


def parts_beside_regions(scene: Scene, parts: RigidParts) -> Iterator[PartsRow]:
    """Yield every module against every solid region."""
    for number, segment, region in _regions(scene):
        for a, module in enumerate(parts.modules):
            if isinstance(region, Cone):
                yield InsideCone("part-region", a, number, module, region, segment)
            else:
                yield RigidRequirement("part-region", a, number, module, _body(region), segment)


def rod_beside_regions(scene: Scene, parts: RigidParts, mount: Mount | None) -> Iterator[Requirement]:
    """Yield the rod from a mount against every solid region that it need not reach into.

    It counts where the task asks for a rod.
    """
    if mount is None or not parts.in_range:
        return
    rod = straight_rod(scene.design, parts, mount)
    counts = scene.design.task.end_effector.rod == "straight"
    for number, segment, region in _regions(scene):
        apart = _distance(scene.p_E, region)
        tip = TIP * rod.radius if apart <= rod.radius + FLOOR else 0.0
        if apart <= FLOOR - rod.radius or 0 < tip >= rod.length:
            continue
        kept = 1.0 - tip / rod.length if tip else 1.0
        body = Solid(ConeSphere(rod.start, kept * rod.path, rod.radius, 0.0))
        yield Requirement("rod-region", mount.module, number, body, region, segment, counts=counts)


def _distance(x: Array, region: Solid | Cone | Hull) -> float:
    """Return how far a point is outside a solid region, negative inside."""
    if isinstance(region, Cone):
        return float(region.s(x))
    if isinstance(region, Solid):
        return -float(region.body.depth(x))
    depth = region.depth(x)
    return -depth if depth > 0 else approach(ball(x, 0.0), region).d


def tip_distances(design: Design) -> dict[tuple[int, int | None], float]:
    """Return how far the end-effector is outside every solid region [m], negative inside.

    Keys are the requirement's number and that of its path or plane, None where it has but one region.
    """
    scene, l_arm = Scene(design, platform(design)), design.task.module.arm_length
    return {(number, segment): l_arm * _distance(scene.p_E, region) for number, segment, region in _regions(scene)}


def rod_keeps_out(scene: Scene, parts: RigidParts, mount: Mount) -> bool:
    """Return whether the rod from a mount is proven to keep out of every solid region."""
    certificates = certify_all(list(rod_beside_regions(scene, parts, mount)))
    return all(certificate.status is Status.CLEAR for certificate in certificates)


def certify_all(requirements: list[Requirement]) -> list[Certificate]:
    """Return one certificate a requirement, pairs of cone-spheres all at once."""
    certified = iter(certify_pairs([(r.body, r.against) for r in requirements if isinstance(r.against, Solid)]))

    def certificate(body: Solid, against: Solid | Cone | Hull) -> Certificate:
        if isinstance(against, Cone):
            return certify_inside(body, against)
        return certify_outside(body, against) if isinstance(against, Hull) else next(certified)

    return [certificate(r.body, r.against) for r in requirements]


def certify_rigid(rows: list[RigidRequirement]) -> list[Certificate]:
    """Return one certificate a row, all at once."""
    return certify_compounds([(row.body, row.against) for row in rows], [row.bolted for row in rows])


def certify_parts(rows: list[PartsRow]) -> list[Certificate]:
    """Return the certificates of what `parts_beside_regions` yields."""
    certified = iter(certify_rigid([row for row in rows if isinstance(row, RigidRequirement)]))
    return [
        next(certified) if isinstance(row, RigidRequirement) else certify_parts_inside(row.body, row.against)
        for row in rows
    ]


def _regions(scene: Scene) -> Iterator[tuple[int, int | None, Solid | Cone | Hull]]:
    """Yield every solid region with its requirement's number, and that of its path."""
    for number, exposure in enumerate(scene.design.task.exposure):
        if exposure.solid:
            yield from ((number, segment, region) for segment, region in scene.regions(exposure))


def _body(region: Solid | Hull) -> Compound:
    """Return a convex region as a rigid body."""
    solid: Convex
    if isinstance(region, Hull):
        solid = Polyhedron("region", region.mesh.vertices, region.mesh.triangles)
    else:
        body = region.body
        solid = capsule("region", body.o, body.o + body.d, body.r)
    return Compound((solid,), solid)
