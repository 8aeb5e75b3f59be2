"""Clearance of rigid parts, and the contacts that bolted parts are allowed.

The hubs and arms of two modules that share a joint may touch, but only near the connector. A rotor turns freely and
may touch nothing. The rod may touch its own module only with its fitting.

| symbol | meaning | unit |
|---|---|---|
| l_c, e_a | distance of a module's own connectors from its centre, direction of port a | l_arm, - |
| u | l_c - e_a.x, depth of a point x inside the plane of connector a, which contains the hinge's axis | l_arm |

A point of a frame is near the connector if -OUTWARDS l_c < u < INWARDS l_c. Two frames may share only points that
are near both connectors. So planes cut off the rest of each frame, and that rest must keep clear of the other
frame. Frames that end at their connectors and reach at most INWARDS l_c above and below the hinge's axis satisfy
this at all hinge angles: folded by 90 degrees, a frame reaches as far into the other as it is high above the axis.
"""

import functools
from collections.abc import Callable, Iterator, Sequence
from itertools import combinations
from typing import Any

from topo_search.model import PORT_DIRECTIONS, AllowedContact, Design, Mount
from topo_search.model.body import INWARDS, OUTWARDS
from verify.bodies import AllowedCone
from verify.certificate import Certificate, ClearanceCheck, RoundBody, certify_pairs
from verify.compounds import Compound, certify_compounds
from verify.cones import certify_inside, certify_parts_inside
from verify.convex import CLIPPING, Convex, Polyhedron, clip
from verify.hulls import HullBody
from verify.parts import FIT
from verify.requirements import Scene

AnyCheck = ClearanceCheck[Any, Any]
"""A check between sides of any two types."""


def keep_apart(scene: Scene, mount: Mount | None) -> Iterator[AnyCheck]:
    """Yield every pair of modules as `body`, and every module against the rod from the mount as `rod`.

    Both count unless the task waives body clearance; the rod also counts if the task requires a straight rod.
    """
    task, modules = scene.design.task, scene.modules
    counts = task.body_clearance is not None
    needs_rod = counts or task.end_effector.rod == "straight"
    joints = {(h, i): (a, b) for h, a, i, b in scene.design.topology.bolts}
    l_c = task.connector_distances / scene.l_arm
    for a, b in combinations(range(len(modules)), 2):
        body, against = modules[a], modules[b]
        if (a, b) in joints:
            ports = zip((a, b), joints[a, b], strict=True)
            body, against = (
                _side_at(scene.bodies[i], port, float(l_c[i])).place_like(modules[i]) for i, port in ports
            )
        yield ClearanceCheck("body", a, b, body, against, counts=counts, bolted=(a, b) in joints)
    if mount is None:
        return
    rod = scene.straight_rod(mount)
    for a, module in enumerate(modules):
        rod_body = rod.body_beside(a)
        if rod_body is not None:
            yield ClearanceCheck("rod", a, -1, module, rod_body, counts=needs_rod)


@functools.lru_cache(maxsize=128)
def _side_at(whole: Compound, port: int, l_c: float) -> Compound:
    """Return a module, in its own frame, as it is checked against its neighbour at a port.

    The parts of the frame that come near the connector are first; the pieces of these that are not near it are
    last.
    """
    inner, outer, outwards = (1 - INWARDS) * l_c, (1 + OUTWARDS) * l_c, PORT_DIRECTIONS[port]
    near_parts, other_parts, outer_pieces = list[Convex](), list[Convex](), list[Convex]()
    for part in whole.parts[: whole.frame]:
        assert isinstance(part, Polyhedron)
        if (
            part.support(outwards) <= inner + CLIPPING.thinnest
            or -part.support(-outwards) >= outer - CLIPPING.thinnest
        ):
            other_parts.append(part)
            continue
        near_parts.append(part)
        pieces = clip(part, outwards, inner), clip(part, -outwards, -outer)
        outer_pieces += [piece for piece in pieces if piece is not None]
    parts = (*near_parts, *other_parts, *whole.parts[whole.frame :], *outer_pieces)
    return Compound(parts, whole.bounds, len(near_parts), len(outer_pieces))


def allowed_contacts(design: Design, mount: Mount | None) -> tuple[AllowedContact, ...]:
    """Return the pairs that may touch, and the parts that may."""
    l_c = (1e3 * design.task.connector_distances).tolist()
    near = [f"from {INWARDS * l:g} mm inside the connector's plane to {OUTWARDS * l:g} mm past it" for l in l_c]
    joints = [
        AllowedContact(kind="body", a=h, b=i, parts=f"hub and arms, by ports {a} and {b}, {zone}")
        for h, a, i, b in design.topology.bolts
        for zone in [" and ".join(dict.fromkeys((near[h], near[i])))]
    ]
    if mount is None:
        return tuple(joints)
    reach = 1e3 * FIT.socket * design.task.end_effector.rod_radius
    fitting = AllowedContact(
        kind="rod", a=mount.module, b=-1, parts=f"the first {reach:g} mm of the rod, at port {mount.port}"
    )
    return (*joints, fitting)


CERTIFIERS: dict[tuple[type, type], Callable[[list[AnyCheck]], list[Certificate]]] = {
    (RoundBody, RoundBody): lambda batch: certify_pairs([(check.body, check.against) for check in batch]),
    (RoundBody, AllowedCone): lambda batch: [certify_inside(check.body, check.against) for check in batch],
    (RoundBody, HullBody): lambda batch: certify_pairs([(check.body, check.against) for check in batch]),
    (Compound, Compound): lambda batch: certify_compounds(
        [(check.body, check.against) for check in batch], [check.bolted for check in batch]
    ),
    (Compound, AllowedCone): lambda batch: [certify_parts_inside(check.body, check.against) for check in batch],
}
"""Certifiers of checks by the types of their sides."""


def certify(checks: Sequence[AnyCheck]) -> list[Certificate]:
    """Return one certificate per check; all checks with the same certifier are certified in one batch."""
    certifiers = [check.certifier or CERTIFIERS[type(check.body), type(check.against)] for check in checks]
    batches = {certifier: list[AnyCheck]() for certifier in certifiers}
    for check, certifier in zip(checks, certifiers, strict=True):
        batches[certifier].append(check)
    certificates = {certifier: iter(certifier(batch)) for certifier, batch in batches.items()}
    return [next(certificates[certifier]) for certifier in certifiers]
