"""Evidence of a disagreement between closed form, meshes and python-fcl about a clearance.

An `inconsistent` verdict is a fault of this tool, or of a library that it trusts. So that someone else can find it,
what each of them says is written out, after the bodies and the witness with all their digits: in l_arm, from the
mean of the module centres.
"""

from __future__ import annotations

from collections.abc import Iterator

from verify.bodies import Array, Cone, ConeSphere
from verify.certificate import TURNED_LEVELS, Solid, inner_shapes, outer_meshes, plane_gap, witnesses
from verify.clearance import cone_clearance
from verify.cones import MESHES, keeps_off, least_s, reaches_beyond
from verify.hulls import Hull, inner_overlap, outer_gap, witness


def evidence(body: Solid, against: Solid | Cone | Hull) -> tuple[str, ...]:
    """Return what is found about a body and what it must keep clear of, or inside of; one finding a line."""
    if isinstance(against, Cone):
        return tuple(_of_cone(body, against))
    return tuple(_of_hull(body.body, against) if isinstance(against, Hull) else _of_pair(body, against))


def _of_pair(A: Solid, B: Solid) -> Iterator[str]:
    (at,) = witnesses([(A, B)])
    yield f"A: {_describe(A.body)}"
    yield f"B: {_describe(B.body)}"
    yield f"closed form: clearance {at.d!r}, normal from A to B {_vector(at.n)}, at {_vector(at.x)}"
    yield f"depth of that place in A {float(A.body.depth(at.x))!r}, in B {float(B.body.depth(at.x))!r}"
    yield f"upper bound that the closed form's points prove: {'none' if at.upper is None else repr(at.upper)}"
    for level in range(1 + len(TURNED_LEVELS)):
        outer, inner = outer_meshes(A, B, at, level), inner_shapes(A, B, at, level)
        if outer is None:
            yield f"level {level}: an outer mesh does not hold its body"
        else:
            (mesh_A, shape_A), (mesh_B, shape_B) = outer
            yield (
                f"level {level}: outer meshes {plane_gap(mesh_A, mesh_B, at.n)!r} apart along the normal, "
                f"FCL: {_overlap(shape_A.overlaps(shape_B))}"
            )
        if inner is None:
            yield f"level {level}: an inner mesh is not within its body"
        else:
            yield f"level {level}: inner meshes, FCL: {_overlap(inner[0].overlaps(inner[1]))}"


def _of_cone(solid: Solid, cone: Cone) -> Iterator[str]:
    body = solid.body
    d, worst = cone_clearance(body, cone)
    x = body.centre(worst) - body.radius(worst) * cone.inward_normal(body.centre(worst))
    yield f"body: {_describe(body)}"
    yield f"cone: apex {_vector(cone.apex)}, axis {_vector(cone.axis)}, half-angle {cone.half_angle_deg!r} deg"
    yield f"closed form: clearance {d!r} at the {'last' if worst else 'first'} ball"
    yield f"its nearest point {_vector(x)}: depth in the body {float(body.depth(x))!r}, s {float(cone.s(x))!r}"
    for sides in MESHES.sides:
        yield f"polytope of {sides} sides around the body: inside by {least_s(body, cone, sides)!r}"
    for eta, name in zip((0.0, 1.0), ("first", "last"), strict=True):
        off, beyond = keeps_off(solid, cone, eta), reaches_beyond(body, cone, eta)
        yield f"plane at the {name} ball, FCL: outer mesh {'off it' if off else 'not off it'}"
        yield f"plane at the {name} ball, FCL: inner mesh {'reaches' if beyond else 'does not reach'} beyond it"


def _of_hull(body: ConeSphere, region: Hull) -> Iterator[str]:
    at = witness(body, region)
    yield f"body: {_describe(body)}"
    yield f"corners of the region: {region.mesh.vertices.tolist()}"
    yield f"closed form: clearance {at.d!r}, normal from body to region {_vector(at.n)}, at {_vector(at.x)}"
    yield f"depth of that place in the body {float(body.depth(at.x))!r}, in the region {region.depth(at.x)!r}"
    yield f"upper bound that the closed form's points prove: {'none' if at.upper is None else repr(at.upper)}"
    for level in range(len(TURNED_LEVELS)):
        outer, inner = outer_gap(body, region, at, level), inner_overlap(body, region, at, level)
        if outer is None:
            yield f"level {level}: the outer mesh does not hold its body"
        else:
            yield f"level {level}: outer mesh {outer[0]!r} apart along the normal, FCL: {_overlap(outer[1])}"
        if inner is None:
            yield f"level {level}: the inner mesh is not within its body"
        else:
            yield f"level {level}: inner mesh, FCL: {_overlap(inner)}"


def _describe(body: ConeSphere) -> str:
    return f"ball of radius {body.r!r} at {_vector(body.o)}, swept by {_vector(body.d)}, growing by {body.dr!r}"


def _vector(x: Array) -> str:
    return str(x.tolist())


def _overlap(overlaps: bool) -> str:
    return "overlap" if overlaps else "apart"
