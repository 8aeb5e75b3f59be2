r"""The brackets that hold bolted modules, against airflow and rotors, where a task states `[module.bracket]`.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | the connector of a joint, the origin of the flange of either module | (3,) | l_arm |
| x, z | from a module's centre to its port; the module's thrust axis | (3,) | - |
| r, d, t | half width of a flange, its set-back from c, its thickness (`model.bracket`) | scalar | l_arm |

A flange is the box of the points c + u with -d <= u.x <= -d + t that are within r of c along z and along z x x. A
bracket counts as the hull of its two flanges: with the room between its webs, where neither airflow nor a rotor is
let in. The joint is named by its child.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from topo_search.model import Design
from topo_search.model.layout import PORT_DIRECTIONS
from verify.bodies import Array
from verify.certificate import Solid
from verify.compounds import Compound
from verify.contacts import RigidRequirement
from verify.convex import Polyhedron
from verify.hulls import Hull, hull
from verify.parts import RigidParts
from verify.requirements import Requirement

UP = np.array([0.0, 0.0, 1.0])


def bracket_hulls(design: Design, parts: RigidParts) -> dict[int, Hull]:
    """Return the bracket of every joint by its child; none if the task states no brackets, or digits are lost."""
    if design.task.module.bracket is None or not parts.in_range:
        return {}
    return {
        i: hull(np.concatenate([_flange(design, parts, h, a), _flange(design, parts, i, b)]))
        for h, i, a, b in design.topology.edges()
    }


def beside_brackets(brackets: dict[int, Hull], envelopes: Sequence[Solid]) -> Iterator[Requirement]:
    """Yield every bracket against every airflow."""
    for a, bracket in brackets.items():
        for b, envelope in enumerate(envelopes):
            yield Requirement("bracket-airflow", a, b, envelope, bracket)


def rotors_beside_brackets(brackets: dict[int, Hull], parts: RigidParts) -> Iterator[RigidRequirement]:
    """Yield every bracket against the rotors of every module."""
    solids = {a: Polyhedron("bracket", one.mesh.vertices, one.mesh.triangles) for a, one in brackets.items()}
    rotors = [module.parts[module.frame :] for module in parts.modules]
    for a, bracket in solids.items():
        for b, module in enumerate(parts.modules):
            turning = Compound(rotors[b], module.bounds)
            yield RigidRequirement("bracket-rotor", a, b, turning, Compound((bracket,), bracket))


def _flange(design: Design, parts: RigidParts, i: int, port: int) -> Array:
    """Return the corners of a flange that is bolted to module i, shape (8, 3)."""
    module, sizes = design.task.module, design.task.module.bracket_sizes
    l_c, r, d, t = (
        x / module.arm_length
        for x in (module.connector_distance, sizes.half_width, sizes.set_back, sizes.thickness)
    )
    x = PORT_DIRECTIONS[port]
    corners = [(l_c + u) * x + v * np.cross(UP, x) + w * UP for u, v, w in product((-d, t - d), (-r, r), (-r, r))]
    return np.asarray(np.array(corners) @ parts.R[i].T + parts.centres[i])
