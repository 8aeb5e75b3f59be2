r"""Clearance of rigid parts, the contacts that bolted parts are allowed, and solid regions.

The hubs and arms of two modules that share a joint may touch, but only near the connector. A rotor turns freely and
may touch nothing. The rod may touch its own module only with its fitting.

| symbol | meaning | unit |
|---|---|---|
| l_c, e_a | distance of the connectors from the module's centre, direction of port a | l_arm, - |
| u | l_c - e_a.x, depth of a point x inside the plane of connector a, which contains the hinge's axis | l_arm |

A point of a frame is near the connector if -OUTWARDS l_c < u < INWARDS l_c. Two frames may share only points that
are near both connectors. So planes cut off the rest of each frame, and that rest must keep clear of the other
frame. Frames that end at their connectors and reach at most INWARDS l_c above and below the hinge's axis satisfy
this at all hinge angles: folded by 90 degrees, a frame reaches as far into the other as it is high above the axis.

If a task has `[module.bracket]`, the brackets keep clear of airflow and rotors.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | the connector of a joint, the origin of the flange of either module | (3,) | l_arm |
| x, z | from a module's centre to its port; the module's thrust axis | (3,) | - |
| r, d, t | half-width of a flange, its set-back from c, its thickness (`model.bracket`) | scalar | l_arm |

A flange is the box of the points c + u with -d <= u.x <= -d + t that are within r of c along z and along z x x. A
bracket counts as the hull of its two flanges, including the space between its webs, which airflow and rotors must
not enter. A joint is identified by its child module.

Solid target regions are walls, panes, objects.

| symbol | meaning | shape |
|---|---|---|
| K | the region; for a cone or planes, everything outside | |
| p_E, r | the end-effector, radius of its rod | (3,), scalar |

The parts of every module and the rod keep out of K. If p_E is within r of the surface of K, the tip touches K, and
the rod keeps out except for its last TIP r before p_E. If p_E is deeper inside, at the centre of a ball or box or
on a path, the rod has to reach into K and is not checked. Lengths are in l_arm.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, combinations, product
from typing import Any

import numpy as np

from topo_search.model import AllowedContact, Design, Mount, Status
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.clearance import Kind
from topo_search.model.exposure import EXPOSURE_KINDS
from topo_search.model.module import TIP
from topo_search.model.room import INWARDS, OUTWARDS
from verify.beside_airflow import beside_airflow, certify_beside
from verify.bodies import AllowedCone, Array, ConeSphere, ball
from verify.certificate import FLOOR, Certificate, ClearanceCheck, Solid, certify_pairs
from verify.compounds import Compound, certify_compounds
from verify.cones import certify_inside, certify_parts_inside
from verify.convex import CLIPPING, Convex, Polyhedron, capsule, clip
from verify.hulls import HullBody, approach, hull
from verify.parts import FIT, UP
from verify.requirements import ClearanceRequirement, Scene

AnyCheck = ClearanceCheck[Any, Any]
"""A check between sides of any two types."""


def checks(scene: Scene, mount: Mount | None, kind: Kind | None = None) -> Iterator[AnyCheck]:
    """Yield all checks of a scene with the rod's mount, or only those made together with a kind."""
    brackets, counts = bracket_hulls(scene), scene.design.task.parts_off_airflow
    geometry: tuple[Kind, ...] = ("airflow", *EXPOSURE_KINDS, "exclusion", "separation")
    groups: dict[tuple[Kind, ...], Callable[[], Iterator[AnyCheck]]] = {
        geometry: scene.requirements,
        ("body", "rod"): lambda: keep_apart(scene, mount),
        ("rotor-airflow",): lambda: beside_airflow(scene.modules, scene.envelopes, counts=counts),
        ("rod-airflow",): lambda: scene.rod(mount),
        ("bracket-airflow",): lambda: beside_brackets(brackets, scene.envelopes),
        ("bracket-rotor",): lambda: rotors_beside_brackets(brackets, scene.modules),
        ("part-region",): lambda: parts_beside_regions(scene),
        ("rod-region",): lambda: rod_beside_regions(scene, mount),
    }
    return chain.from_iterable(make() for kinds, make in groups.items() if kind is None or kind in kinds)


def counterpart(scene: Scene, mount: Mount | None, other: AnyCheck) -> AnyCheck | None:
    """Return the check that corresponds to one of another platform of the same task and tree, if there is one."""
    if other.kind == "airflow":  # thousands for a hundred modules, too many to search
        return ClearanceRequirement("airflow", other.a, other.b, scene.envelopes[other.a], scene.envelopes[other.b])
    same = (check for check in checks(scene, mount, other.kind) if check.key == other.key)
    return next(same, None)


def keep_apart(scene: Scene, mount: Mount | None) -> Iterator[AnyCheck]:
    """Yield every pair of modules as `body`, and every module against the rod from the mount as `rod`.

    Both count unless the task waives body clearance; the rod also counts if the task requires a straight rod.
    """
    task, modules = scene.design.task, scene.modules
    counts = task.body_clearance is not None
    needs_rod = counts or task.end_effector.rod == "straight"
    joints = {(h, i): ports for h, i, *ports in scene.design.topology.edges()}
    l_c = task.module.connector_distance / scene.l_arm
    for a, b in combinations(range(len(modules)), 2):
        body, against = modules[a], modules[b]
        if (a, b) in joints:
            ports = zip((body, against), joints[a, b], strict=True)
            body, against = (_side_at(scene.body, port, l_c).place_like(module) for module, port in ports)
        yield ClearanceCheck("body", a, b, body, against, counts=counts, bolted=(a, b) in joints)
    if mount is None:
        return
    rod = scene.straight_rod(mount)
    for a, module in enumerate(modules):
        rod_body = rod.body_beside(a)
        if rod_body is not None:
            yield ClearanceCheck("rod", a, -1, module, rod_body, counts=needs_rod)


@functools.lru_cache(maxsize=16)
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
    l_c = 1e3 * design.task.module.connector_distance
    near_connector = f"from {INWARDS * l_c:g} mm inside the connector's plane to {OUTWARDS * l_c:g} mm past it"
    joints = [
        AllowedContact(kind="body", a=h, b=i, parts=f"hub and arms, by ports {a} and {b}, {near_connector}")
        for h, i, a, b in design.topology.edges()
    ]
    if mount is None:
        return tuple(joints)
    reach = 1e3 * FIT.socket * design.task.end_effector.rod_radius
    fitting = AllowedContact(
        kind="rod", a=mount.module, b=-1, parts=f"the first {reach:g} mm of the rod, at port {mount.port}"
    )
    return (*joints, fitting)


def bracket_hulls(scene: Scene) -> dict[int, HullBody]:
    """Return the bracket of every joint by child module; empty without brackets or if coordinates are too large."""
    if scene.design.task.module.bracket is None or not scene.in_range:
        return {}
    return {
        i: hull(np.concatenate([_flange(scene, h, a), _flange(scene, i, b)]))
        for h, i, a, b in scene.design.topology.edges()
    }


def beside_brackets(brackets: dict[int, HullBody], envelopes: Sequence[Solid]) -> Iterator[ClearanceRequirement]:
    """Yield every bracket against every airflow."""
    for a, bracket in brackets.items():
        for b, envelope in enumerate(envelopes):
            yield ClearanceRequirement("bracket-airflow", a, b, envelope, bracket)


def rotors_beside_brackets(brackets: dict[int, HullBody], modules: Sequence[Compound]) -> Iterator[AnyCheck]:
    """Yield every bracket against the rotors of every module."""
    for a, bracket in brackets.items():
        solid = _body(bracket, "bracket")
        for b, module in enumerate(modules):
            rotors = Compound(module.parts[module.frame :], module.bounds)
            yield ClearanceCheck("bracket-rotor", a, b, rotors, solid)


def _flange(scene: Scene, i: int, port: int) -> Array:
    """Return the corners of the flange bolted to a port of module i, shape (8, 3)."""
    module, sizes = scene.design.task.module, scene.design.task.module.bracket_sizes
    l_c, r, d, t = (
        x / module.arm_length
        for x in (module.connector_distance, sizes.half_width, sizes.set_back, sizes.thickness)
    )
    x = PORT_DIRECTIONS[port]
    corners = [(l_c + u) * x + v * np.cross(UP, x) + w * UP for u, v, w in product((-d, t - d), (-r, r), (-r, r))]
    return np.asarray(np.array(corners) @ scene.R[i].T + scene.centres[i])


def parts_beside_regions(scene: Scene) -> Iterator[AnyCheck]:
    """Yield every module against every solid region."""
    for number, segment, region in _regions(scene):
        for a, module in enumerate(scene.modules):
            against = region if isinstance(region, AllowedCone) else _body(region, "region")
            yield ClearanceCheck("part-region", a, number, module, against, segment)


def rod_beside_regions(scene: Scene, mount: Mount | None) -> Iterator[ClearanceRequirement]:
    """Yield the rod from a mount against every solid region that it need not reach into.

    The checks count if the task requires a straight rod.
    """
    if mount is None or not scene.in_range:
        return
    rod = scene.straight_rod(mount)
    counts = scene.design.task.end_effector.rod == "straight"
    for number, segment, region in _regions(scene):
        distance = _distance(scene.tip, region)
        tip = TIP * rod.radius if distance <= rod.radius + FLOOR else 0.0
        if distance <= FLOOR - rod.radius or (tip and tip >= rod.length):
            continue
        share = 1.0 - tip / rod.length if tip else 1.0
        body = Solid(ConeSphere(rod.start, share * rod.path, rod.radius, 0.0))
        yield ClearanceRequirement("rod-region", mount.module, number, body, region, segment, counts=counts)


def _distance(x: Array, region: Solid | AllowedCone | HullBody) -> float:
    """Return the distance of a point from a solid region, negative inside."""
    if isinstance(region, AllowedCone):
        return float(region.s(x))
    if isinstance(region, Solid):
        return -float(region.body.depth(x))
    depth = region.depth(x)
    return -depth if depth > 0 else approach(ball(x, 0.0), region).d


def tip_distances(design: Design) -> dict[tuple[int, int | None], float]:
    """Return the distance of the end-effector from every solid region [m], negative inside.

    A key is the requirement's number and that of its path or plane, None if it has only one region.
    """
    scene = Scene(design)
    regions = _regions(scene)
    return {(number, segment): scene.l_arm * _distance(scene.tip, region) for number, segment, region in regions}


def rod_keeps_out(scene: Scene, mount: Mount) -> bool:
    """Return whether the rod from a mount is proven to keep out of every solid region."""
    certificates = certify(list(rod_beside_regions(scene, mount)))
    return all(certificate.status is Status.CLEAR for certificate in certificates)


def certify(checks: Sequence[AnyCheck]) -> list[Certificate]:
    """Return one certificate per check; checks between the same two types of sides are certified in one batch."""
    certifiers: dict[tuple[type, type], Callable[[list[AnyCheck]], list[Certificate]]] = {
        (Solid, Solid): lambda batch: certify_pairs([(check.body, check.against) for check in batch]),
        (Solid, AllowedCone): lambda batch: [certify_inside(check.body, check.against) for check in batch],
        (Solid, HullBody): lambda batch: certify_pairs([(check.body, check.against) for check in batch]),
        (Compound, Compound): lambda batch: certify_compounds(
            [(check.body, check.against) for check in batch], [check.bolted for check in batch]
        ),
        (Compound, AllowedCone): lambda batch: [certify_parts_inside(check.body, check.against) for check in batch],
        (Compound, Solid): certify_beside,
    }
    types = [(type(check.body), type(check.against)) for check in checks]
    certificates = {
        key: iter(certify_batch([check for check, sides in zip(checks, types, strict=True) if sides == key]))
        for key, certify_batch in certifiers.items()
    }
    return [next(certificates[key]) for key in types]


def _regions(scene: Scene) -> Iterator[tuple[int, int | None, Solid | AllowedCone | HullBody]]:
    for number, exposure in enumerate(scene.design.task.exposure):
        if exposure.solid:
            yield from ((number, segment, region) for segment, region in scene.regions(exposure))


def _body(region: Solid | HullBody, name: str) -> Compound:
    """Return a convex solid as a rigid body."""
    solid: Convex
    if isinstance(region, HullBody):
        solid = Polyhedron(name, region.mesh.vertices, region.mesh.triangles)
    else:
        body = region.body
        solid = capsule(name, body.o, body.o + body.d, body.r)
    return Compound((solid,), solid)
