"""Which rigid parts must keep apart, and which may touch because they are bolted together.

Two modules that share a joint may touch with hub and arms, where the joint is, but a rotor must turn freely: it may
touch nothing. The rod may touch the module that carries it with its fitting alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

from topo_search.model import AllowedContact, Design, Mount
from topo_search.model.audit import Kind
from verify.compounds import Compound
from verify.parts import RigidParts
from verify.rod import FITTING, straight_rod


@dataclass(frozen=True, eq=False)
class RigidRequirement:
    """Two rigid bodies that must not touch."""

    kind: Kind
    a: int
    """A module."""
    b: int
    """The other module; -1 for the end-effector's rod."""
    body: Compound
    against: Compound
    counts: bool
    """Whether it sets the verdict; what does not is measured all the same."""
    bolted: bool = False
    """Whether the frames may touch."""
    segment: None = None


def keep_apart(design: Design, parts: RigidParts, mount: Mount | None) -> Iterator[RigidRequirement]:
    """Yield every pair of modules as `body`, and every module against the rod from the mount as `rod`.

    Both set the verdict unless the task gives body clearance up.
    """
    counts = design.task.body_clearance is not None
    modules, bolted = parts.modules, design.topology.bolted
    for a, b in combinations(range(len(modules)), 2):
        yield RigidRequirement("body", a, b, modules[a], modules[b], counts, bolted=(a, b) in bolted)
    if mount is None:
        return
    rod = straight_rod(design, parts, mount)
    for a, module in enumerate(modules):
        beside = rod.beside(a)
        if beside is not None:
            yield RigidRequirement("rod", a, -1, module, beside, counts)


def allowed_contacts(design: Design, mount: Mount | None) -> tuple[AllowedContact, ...]:
    """Return the pairs that may touch, and with which parts."""
    joints = [
        AllowedContact(kind="body", a=h, b=i, parts=f"hub and arms, by ports {a} and {b}")
        for h, i, a, b in design.topology.edges()
    ]
    if mount is None:
        return tuple(joints)
    reach = 1e3 * FITTING * design.task.end_effector.rod_radius
    fitting = AllowedContact(
        kind="rod", a=mount.module, b=-1, parts=f"the first {reach:g} mm of the rod, at port {mount.port}"
    )
    return (*joints, fitting)
