r"""Brackets of joints beside airflow and rotors.

If a task has `[module.bracket]`, the brackets keep clear of airflow and rotors. They have these sizes at modules of
all types.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | the connector of a joint, the origin of the flange of either module, at its own l_c | (3,) | l_arm |
| x, z | from a module's centre to its port; the module's thrust axis | (3,) | - |
| r, d, t | half-width of a flange, its set-back from c, its thickness (`Module.bracket_sizes`) | scalar | l_arm |

A flange is the box of the points c + u with -d <= u.x <= -d + t that are within r of c along z and along z x x. A
bracket counts as the hull of its two flanges, including the space between its webs, which airflow and rotors must
not enter. A joint is identified by its child module.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from topo_search.model import PORT_DIRECTIONS, Array, Mount
from topo_search.model.rotors import UP
from verify.certificate import ClearanceCheck
from verify.compounds import Compound
from verify.contacts import AnyCheck
from verify.convex import Polyhedron
from verify.hulls import HullBody, hull
from verify.requirements import ClearanceRequirement, Scene


def beside_brackets(scene: Scene, _: Mount | None) -> Iterator[AnyCheck]:
    """Yield every bracket against every airflow, then against the rotors of every module."""
    brackets = bracket_hulls(scene)
    for a, bracket in brackets.items():
        for b, rotor, envelope in scene.envelopes:
            yield ClearanceRequirement("bracket-airflow", a, b, envelope, bracket, rotor=rotor)
    for a, bracket in brackets.items():
        solid = Polyhedron("bracket", bracket.mesh.vertices, bracket.mesh.triangles)
        body = Compound((solid,), solid)
        for b, module in enumerate(scene.modules):
            if not module.rotors:
                continue
            rotors = Compound(module.parts[module.frame :], module.bounds)
            yield ClearanceCheck("bracket-rotor", a, b, rotors, body)


def bracket_hulls(scene: Scene) -> dict[int, HullBody]:
    """Return the bracket of every joint by child module; empty without brackets or if coordinates are too large."""
    if scene.design.task.module.bracket is None or not scene.in_range:
        return {}
    return {
        i: hull(np.concatenate([_flange(scene, h, a), _flange(scene, i, b)]))
        for h, i, a, b in scene.design.topology.edges()
    }


def _flange(scene: Scene, i: int, port: int) -> Array:
    """Return the corners of the flange bolted to a port of module i, shape (8, 3)."""
    sizes, l_c = scene.design.task.module.bracket_sizes, scene.design.task.connector_distances[i]
    l_c, r, d, t = (x / scene.l_arm for x in (l_c, sizes.half_width, sizes.set_back, sizes.thickness))
    x = PORT_DIRECTIONS[port]
    corners = [(l_c + u) * x + v * np.cross(UP, x) + w * UP for u, v, w in product((-d, t - d), (-r, r), (-r, r))]
    return np.asarray(np.array(corners) @ scene.R[i].T + scene.centres[i])
