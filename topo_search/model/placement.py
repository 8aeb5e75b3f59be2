"""Placement of a design at its target, which no clearance judges; `placement` of `audit.json`."""

from collections.abc import Iterable, Iterator

import numpy as np

from topo_search.limits import length, quantity
from topo_search.model.arrays import Array
from topo_search.model.exposure import AnyExposure
from topo_search.model.kinds import Index, Size
from topo_search.model.proven import lower_text
from topo_search.model.value import Value

NEAR_RADII = 3.0
"""Distance of a rotor from a solid half-space from which answers warn [rotor radii]."""


class Pulling(Value):
    """Load case in which the rod pulls, although its task does not have it pull."""

    name: str
    """Name of the load case."""
    angle_deg: Size
    """Angle between the rod, from its connector to the end-effector, and the force at the end-effector [deg]."""


class NearSolid(Value):
    """Solid half-space with the centres of rotors within NEAR_RADII of its surface."""

    name: str
    """Name of the solid region."""
    rotors: Index
    """Number of rotors that near."""
    module: Index
    """Module of the nearest rotor."""
    rotor: Index
    distance_m: Size
    """Distance of its centre from the surface [m]."""
    radii: Size
    """The same in rotor radii."""


class Placement(Value):
    """Load cases in which the rod pulls, and solid half-spaces near rotors."""

    pulling: tuple[Pulling, ...] = ()
    near: tuple[NearSolid, ...] = ()

    def sentences(self) -> Iterator[str]:
        """Yield a sentence about all load cases in which the rod pulls, and one per solid half-space."""
        if self.pulling:
            angles = ", ".join(f"{lower_text(case.angle_deg, 3)} deg in {case.name}" for case in self.pulling)
            yield f"the rod pulls where the task pushes: between rod, from connector to tip, and force are {angles}"
        for wall in self.near:
            nearest = f"{lower_text(wall.radii, 3)} radii, {length(wall.distance_m)}"
            yield (
                f"{quantity(wall.rotors, 'rotor')} within {NEAR_RADII:g} radii of {wall.name}, the nearest at "
                f"{nearest} (rotor {wall.rotor} of module {wall.module}): ceiling and wall effect are in no model"
            )


def blocks(regions: Iterable[AnyExposure], direction: Array) -> bool:
    """Return whether an object lies beyond the end-effector in a direction, so that no tool comes from there.

    Args:
        regions: solid ones count, unless they take their direction from the design; bounded ones must be beyond
            the plane through p_E with the direction as its normal.
        direction: any length, (3,).
    """
    return any(
        any(inwards @ direction < 0 for _, inwards in half_spaces)
        if (half_spaces := shape.half_spaces())
        else bool((shape.mesh(np.inf).vertices @ direction).min() >= 0)
        for region in regions
        for shape in (region.shapes if region.solid else ())
        if not shape.takes_direction_from_com
    )


def must_pull(regions: Iterable[AnyExposure], force: Array) -> bool:
    """Return whether an object lies behind the end-effector, seen along a force, (3,), and none before it."""
    regions = tuple(regions)
    return blocks(regions, -force) and not blocks(regions, force)
