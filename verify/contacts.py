r"""Rigid parts that must keep apart, those that may touch because they are bolted together, and solid regions.

Two modules that share a joint may touch with hub and arms, but only near the connector. A rotor must turn freely:
it may touch nothing. The rod may touch the module that carries it with its fitting alone.

| symbol | meaning | unit |
|---|---|---|
| l_c, e_a | distance of the connectors from the module's centre, direction of port a | l_arm, - |
| u | l_c - e_a.x: how far inside the plane of connector a, which the hinge's axis lies in, a point x is | l_arm |

A point of a frame is near the connector if -OUTWARDS l_c < u < INWARDS l_c. Two frames may have a common point only
where it is near the connector of both; so what each has beyond, cut off by planes, keeps clear of the other one.
Frames that end at their connectors, no more than INWARDS l_c above and below the hinge's axis, do so at all hinge
angles: folded by 90 degrees, one reaches as far into the other as it is high over the axis.

Where a task has `[module.bracket]`, the brackets keep clear of airflow and rotors.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | the connector of a joint, the origin of the flange of either module | (3,) | l_arm |
| x, z | from a module's centre to its port; the module's thrust axis | (3,) | - |
| r, d, t | half width of a flange, its set-back from c, its thickness (`model.bracket`) | scalar | l_arm |

A flange is the box of the points c + u with -d <= u.x <= -d + t that are within r of c along z and along z x x. A
bracket counts as the hull of its two flanges: with the room between its webs, where neither airflow nor a rotor is
let in. The joint is named by its child.

Solid target regions are walls, panes, objects.

| symbol | meaning | shape |
|---|---|---|
| K | the region; of a cone or planes all that is outside | |
| p_E, r | the end-effector, radius of its rod | (3,), scalar |

The parts of every module and the rod keep out of K. Where p_E is within r of the surface of K, its tip touches
K, and the rod keeps out but for the last TIP r before p_E. Where p_E is deeper inside, in the middle of a ball or a
box or on a path, the rod has to reach into K, and nothing is required of it. Lengths are in l_arm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, product
from typing import Any

import numpy as np

from topo_search.model import AllowedContact, Design, Mount, Status
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.module import TIP
from topo_search.model.room import INWARDS, OUTWARDS
from verify.beside_airflow import certify_beside
from verify.bodies import Array, Cone, ConeSphere, ball
from verify.certificate import FLOOR, Certificate, ClearanceRow, Solid, certify_pairs
from verify.compounds import Compound, certify_compounds
from verify.cones import certify_inside, certify_parts_inside
from verify.convex import CLIPPING, Convex, Polyhedron, capsule, clip
from verify.hulls import Hull, approach, hull
from verify.parts import FIT, UP
from verify.requirements import Requirement, Scene

AnyClearanceRow = ClearanceRow[Any, Any]
"""A row of any two sides."""


def keep_apart(scene: Scene, mount: Mount | None) -> Iterator[AnyClearanceRow]:
    """Yield every pair of modules as `body`, and every module against the rod from the mount as `rod`.

    Both set the verdict unless the task gives body clearance up; the rod does where the task asks for one.
    """
    task, modules = scene.design.task, scene.modules
    counts = task.body_clearance is not None
    needs_rod = counts or task.end_effector.rod == "straight"
    joints = {(h, i): ports for h, i, *ports in scene.design.topology.edges()}
    sides = {port: _side_at(scene, port) for port in {port for ports in joints.values() for port in ports}}
    for a, b in combinations(range(len(modules)), 2):
        body, against = modules[a], modules[b]
        if (a, b) in joints:
            ports = zip((a, b), joints[a, b], strict=True)
            body, against = (sides[k].place(scene.R[i], scene.centres[i]) for i, k in ports)
        yield ClearanceRow("body", a, b, body, against, counts=counts, bolted=(a, b) in joints)
    if mount is None:
        return
    rod = scene.straight_rod(mount)
    for a, module in enumerate(modules):
        beside = rod.body_beside(a)
        if beside is not None:
            yield ClearanceRow("rod", a, -1, module, beside, counts=needs_rod)


def _side_at(scene: Scene, port: int) -> Compound:
    """Return a module as its neighbour at a port meets it, in the module's own frame.

    First come the parts of the frame that are near the connector, if only with a piece; last, pieces of these that
    are not.
    """
    module, whole = scene.design.task.module, scene.body
    l_c, outwards = module.connector_distance / module.arm_length, PORT_DIRECTIONS[port]
    inner, outer = (1 - INWARDS) * l_c, (1 + OUTWARDS) * l_c
    near, others, beyond = list[Convex](), list[Convex](), list[Convex]()
    for part in whole.parts[: whole.frame]:
        assert isinstance(part, Polyhedron)
        if (
            part.support(outwards) <= inner + CLIPPING.thinnest
            or -part.support(-outwards) >= outer - CLIPPING.thinnest
        ):
            others.append(part)
            continue
        near.append(part)
        pieces = clip(part, outwards, inner), clip(part, -outwards, -outer)
        beyond += [piece for piece in pieces if piece is not None]
    parts = (*near, *others, *whole.parts[whole.frame :], *beyond)
    return Compound(parts, whole.bounds, len(near), len(beyond))


def allowed_contacts(design: Design, mount: Mount | None) -> tuple[AllowedContact, ...]:
    """Return the pairs that may touch, and with which parts."""
    l_c = 1e3 * design.task.module.connector_distance
    near = f"from {INWARDS * l_c:g} mm inside the connector's plane to {OUTWARDS * l_c:g} mm past it"
    joints = [
        AllowedContact(kind="body", a=h, b=i, parts=f"hub and arms, by ports {a} and {b}, {near}")
        for h, i, a, b in design.topology.edges()
    ]
    if mount is None:
        return tuple(joints)
    reach = 1e3 * FIT.socket * design.task.end_effector.rod_radius
    fitting = AllowedContact(
        kind="rod", a=mount.module, b=-1, parts=f"the first {reach:g} mm of the rod, at port {mount.port}"
    )
    return (*joints, fitting)


def bracket_hulls(scene: Scene) -> dict[int, Hull]:
    """Return the bracket of every joint by its child; none if the task states no brackets, or digits are lost."""
    if scene.design.task.module.bracket is None or not scene.in_range:
        return {}
    return {
        i: hull(np.concatenate([_flange(scene, h, a), _flange(scene, i, b)]))
        for h, i, a, b in scene.design.topology.edges()
    }


def beside_brackets(brackets: dict[int, Hull], envelopes: Sequence[Solid]) -> Iterator[Requirement]:
    """Yield every bracket against every airflow."""
    for a, bracket in brackets.items():
        for b, envelope in enumerate(envelopes):
            yield Requirement("bracket-airflow", a, b, envelope, bracket)


def rotors_beside_brackets(brackets: dict[int, Hull], modules: Sequence[Compound]) -> Iterator[AnyClearanceRow]:
    """Yield every bracket against the rotors of every module."""
    for a, bracket in brackets.items():
        solid = _body(bracket, "bracket")
        for b, module in enumerate(modules):
            turning = Compound(module.parts[module.frame :], module.bounds)
            yield ClearanceRow("bracket-rotor", a, b, turning, solid)


def _flange(scene: Scene, i: int, port: int) -> Array:
    """Return the corners of a flange that is bolted to module i, shape (8, 3)."""
    module, sizes = scene.design.task.module, scene.design.task.module.bracket_sizes
    l_c, r, d, t = (
        x / module.arm_length
        for x in (module.connector_distance, sizes.half_width, sizes.set_back, sizes.thickness)
    )
    x = PORT_DIRECTIONS[port]
    corners = [(l_c + u) * x + v * np.cross(UP, x) + w * UP for u, v, w in product((-d, t - d), (-r, r), (-r, r))]
    return np.asarray(np.array(corners) @ scene.R[i].T + scene.centres[i])


def parts_beside_regions(scene: Scene) -> Iterator[AnyClearanceRow]:
    """Yield every module against every solid region."""
    for number, segment, region in _regions(scene):
        for a, module in enumerate(scene.modules):
            against = region if isinstance(region, Cone) else _body(region, "region")
            yield ClearanceRow("part-region", a, number, module, against, segment)


def rod_beside_regions(scene: Scene, mount: Mount | None) -> Iterator[Requirement]:
    """Yield the rod from a mount against every solid region that it need not reach into.

    It counts where the task asks for a rod.
    """
    if mount is None or not scene.in_range:
        return
    rod = scene.straight_rod(mount)
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
    scene = Scene(design)
    regions = _regions(scene)
    return {(number, segment): scene.l_arm * _distance(scene.p_E, region) for number, segment, region in regions}


def rod_keeps_out(scene: Scene, mount: Mount) -> bool:
    """Return whether the rod from a mount is proven to keep out of every solid region."""
    certificates = certify(list(rod_beside_regions(scene, mount)))
    return all(certificate.status is Status.CLEAR for certificate in certificates)


def certify(rows: Sequence[AnyClearanceRow]) -> list[Certificate]:
    """Return one certificate a row, those of all rows with the same kinds of sides at once."""
    certifiers: dict[tuple[type, type], Callable[[list[AnyClearanceRow]], list[Certificate]]] = {
        (Solid, Solid): lambda some: certify_pairs([(row.body, row.against) for row in some]),
        (Solid, Cone): lambda some: [certify_inside(row.body, row.against) for row in some],
        (Solid, Hull): lambda some: certify_pairs([(row.body, row.against) for row in some]),
        (Compound, Compound): lambda some: certify_compounds(
            [(row.body, row.against) for row in some], [row.bolted for row in some]
        ),
        (Compound, Cone): lambda some: [certify_parts_inside(row.body, row.against) for row in some],
        (Compound, Solid): certify_beside,
    }
    sides = [(type(row.body), type(row.against)) for row in rows]
    certified = {
        both: iter(certify_some([row for row, kinds in zip(rows, sides, strict=True) if kinds == both]))
        for both, certify_some in certifiers.items()
    }
    return [next(certified[both]) for both in sides]


def _regions(scene: Scene) -> Iterator[tuple[int, int | None, Solid | Cone | Hull]]:
    """Yield every solid region with its requirement's number, and that of its path."""
    for number, exposure in enumerate(scene.design.task.exposure):
        if exposure.solid:
            yield from ((number, segment, region) for segment, region in scene.regions(exposure))


def _body(region: Solid | Hull, name: str) -> Compound:
    """Return a convex region as a rigid body."""
    solid: Convex
    if isinstance(region, Hull):
        solid = Polyhedron(name, region.mesh.vertices, region.mesh.triangles)
    else:
        body = region.body
        solid = capsule(name, body.o, body.o + body.d, body.r)
    return Compound((solid,), solid)
