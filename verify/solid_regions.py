"""Parts and rod of a design beside its solid target regions.

Solid target regions are walls, panes, objects.

| symbol | meaning | shape |
|---|---|---|
| K | the region; for a cone or planes, everything outside | |
| p_E, r | the end-effector, radius of its rod | (3,), scalar |

The parts of every module and the rod keep out of K. If p_E is within r of the surface of K, the tip touches K, and
the rod keeps out except for its last TIP r before p_E. If p_E is deeper inside, at the centre of a ball or box or
on a path, the rod has to reach into K and is not checked. Lengths are in l_arm.
"""

from collections.abc import Iterator

from topo_search.model import Array, Design, Mount, Status
from topo_search.model.end_effector import TIP
from verify.bodies import AllowedCone, ConeSphere, ball
from verify.certificate import FLOOR, ClearanceCheck, RoundBody
from verify.compounds import Compound
from verify.contacts import AnyCheck, certify
from verify.convex import Convex, Polyhedron, capsule
from verify.hulls import HullBody, approach
from verify.requirements import ClearanceRequirement, Scene


def beside_regions(scene: Scene, mount: Mount | None) -> Iterator[AnyCheck]:
    """Yield every module against every solid region, then the rod."""
    for number, contact, segment, region in solid_regions(scene):
        against = region if isinstance(region, AllowedCone) else _body(region)
        for a, module in enumerate(scene.modules):
            yield ClearanceCheck("part-region", a, number, module, against, segment, contact=contact)
    yield from rod_beside_regions(scene, mount)


def rod_beside_regions(scene: Scene, mount: Mount | None) -> Iterator[ClearanceRequirement]:
    """Yield the rod from a mount against every solid region that it need not reach into.

    The checks count if the task requires a straight rod.
    """
    if mount is None or not scene.in_range:
        return
    rod = scene.straight_rod(mount)
    counts = scene.design.task.end_effector.rod == "straight"
    for number, contact, segment, region in solid_regions(scene):
        distance = _distance(scene.tip, region)
        tip = TIP * rod.radius if distance <= rod.radius + FLOOR else 0.0
        if distance <= FLOOR - rod.radius or (tip and tip >= rod.length):
            continue
        share = 1.0 - tip / rod.length if tip else 1.0
        body = RoundBody(ConeSphere(rod.start, share * rod.path, rod.radius, 0.0))
        sides = mount.module, number, body, region, segment
        yield ClearanceRequirement("rod-region", *sides, counts=counts, contact=contact)


def rod_keeps_out(scene: Scene, mount: Mount) -> bool:
    """Return whether the rod from a mount is proven to keep out of every solid region."""
    certificates = certify(list(rod_beside_regions(scene, mount)))
    return all(certificate.status is Status.CLEAR for certificate in certificates)


def tip_distances(design: Design) -> dict[tuple[int, int | None], float]:
    """Return the distance of the end-effector from every solid region [m], negative inside.

    A key is the requirement's number and that of its path or plane, None if it has only one region.
    """
    scene = Scene(design)
    return {
        (number, segment): scene.l_arm * _distance(scene.tip, region)
        for number, _, segment, region in solid_regions(scene)
    }


def _distance(x: Array, region: RoundBody | AllowedCone | HullBody) -> float:
    """Return the distance of a point from a solid region, negative inside."""
    if isinstance(region, AllowedCone):
        return float(region.s(x))
    if isinstance(region, RoundBody):
        return -float(region.body.depth(x))
    depth = region.depth(x)
    return -depth if depth > 0 else approach(ball(x, 0.0), region).d


def solid_regions(scene: Scene) -> Iterator[tuple[int, int | None, int | None, RoundBody | AllowedCone | HullBody]]:
    """Yield solid regions: number of the requirement, load case of a contact, path or plane, and volume."""
    for number, exposure in enumerate(scene.design.task.exposure):
        if exposure.solid:
            yield from ((number, exposure.contact, segment, region) for segment, region in scene.regions(exposure))


def _body(region: RoundBody | HullBody) -> Compound:
    """Return a convex solid as a rigid body."""
    solid: Convex
    if isinstance(region, HullBody):
        solid = Polyhedron("region", region.mesh.vertices, region.mesh.triangles)
    else:
        body = region.body
        solid = capsule("region", body.o, body.o + body.d, body.r)
    return Compound((solid,), solid)
