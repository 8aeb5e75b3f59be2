"""The kinds of rows that the compiled search knows, and what a row of each is made of."""

from __future__ import annotations

from typing import NamedTuple

from topo_search.model.shape import Hull

AIR, APART, EXCLUSION, BALL, CAPSULE, ALONG, HULL, CONE, CONE_COM, OFFSET, PARTS = range(11)
"""Kinds of rows: two envelopes; two centres; p'_E and a centre; an envelope and a ball about p'_E, a capsule from
near there, one along p_E, the hull of points near there; an end ball of an envelope in a cone, its axis fixed or to
the COM; the length of p_E; the parts of one module and the envelope of another."""
PARTS_CONE, PARTS_CONE_COM, PARTS_CAPSULE, PARTS_ALONG, PARTS_HULL, REACH = range(11, 17)
"""The parts of a module in a cone, its axis fixed or to the COM; off a capsule near p'_E, one along p_E, a hull;
p'_E and a free connector. This and the rows of regions may be about rods: those of the best rod alone count."""

OF_PARTS = {
    BALL: PARTS_CAPSULE, CAPSULE: PARTS_CAPSULE, ALONG: PARTS_ALONG,
    HULL: PARTS_HULL, CONE: PARTS_CONE, CONE_COM: PARTS_CONE_COM,
}  # fmt: skip
"""From the kind of a row of an envelope and a region to that of a module's parts and the region."""

WIDTH = 15
"""Numbers of a row."""


class Kernel(NamedTuple):
    """A row of a clearance, dimensionless."""

    kind: int
    vector: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """A path or an axis; a path along p_E has its length first."""
    size: float = 0.0
    """A radius or distance; of a cone, the end of the envelope that is to be inside: eta, 0 or 1."""
    sine: float = 0.0
    """Sine of a half-angle."""
    cosine: float = 0.0
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Start of a path or apex of a cone, from p'_E."""
    hull: Hull | None = None
    """Its corners from p'_E; in the row stand its places in the tables of planes and edges (`Hulls`)."""
    of: int = 0
    """Index in the subject of the module it is about."""
    connector: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Start of a rod, in its module's frame; or length, start radius and growth of an envelope and a region."""
    radius: float = 0.0
    """Radius of the rod."""
    tip: float = 0.0
    """Length at its end that does not count."""
    number: int = -1
    """Index of the candidate rod (one that may carry the end-effector) it is about; -1: none."""

    @property
    def data(self) -> tuple[float, ...]:
        """Its numbers in a row, WIDTH of them."""
        shape = (*self.vector, self.size, self.sine, self.cosine, *self.start)
        return (*shape, *self.connector, self.radius, self.tip, self.number)
