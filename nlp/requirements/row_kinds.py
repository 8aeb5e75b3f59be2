"""Kinds of rows in the compiled search: a body keeps out of an obstacle; lengths in l_arm."""

from typing import NamedTuple, get_args

from topo_search.model.kinds import Vector
from topo_search.model.shape import Hull

ORIGIN: Vector = (0.0, 0.0, 0.0)


class CentreBody(NamedTuple):
    """The centre of module i."""


class EnvelopeBody(NamedTuple):
    """The airflow envelope of module i [l_arm]."""

    length: float
    radius: float
    """Start radius."""
    growth: float


class JetBody(NamedTuple):
    """The airflow envelope of a rotor of module i [l_arm]."""

    length: float
    radius: float
    """Start radius."""
    growth: float
    origin: Vector
    """Start of its axis, in the module's frame."""
    upstream: Vector
    """Unit vector along the axis, against the flow."""


class RodBody(NamedTuple):
    """Candidate rod from a connector of module i to the end-effector [l_arm]: only the best rod's rows apply."""

    number: int = -1
    """Index among the free connectors."""
    connector: Vector = ORIGIN
    """Start of the rod, in the frame of its module."""
    radius: float = 0.0
    tip: float = 0.0
    """Length of its tip, which may touch regions."""


class PartsBody(NamedTuple):
    """The balls around the parts of module i."""

    first: int
    """Number of the first ball."""
    end: int
    """One past the last."""
    reach: float
    """Largest distance of a point of a ball from the module's centre [l_arm]."""


class ModuleObstacle(NamedTuple):
    """The centre of module j."""

    distance: float
    """Smallest distance [l_arm]."""


class AirflowObstacle(NamedTuple):
    """The airflow envelope of module j [l_arm]."""

    length: float
    radius: float
    """Start radius."""
    growth: float


class TipObstacle(NamedTuple):
    """The end-effector."""

    distance: float
    """Smallest distance [l_arm]."""


class CapsuleObstacle(NamedTuple):
    """All points near a path, which starts at p'_E plus an origin [l_arm]; a ball if the path has no length."""

    origin: Vector
    along: Vector
    """Vector from start to end."""
    radius: float
    length: float = 0.0
    """Length of a path along p_E, which then replaces `along`."""


class HullObstacle(NamedTuple):
    """A hull with its corners from p'_E; arrays have its ranges of planes and edges."""

    hull: Hull


class FacesObstacle(NamedTuple):
    """The same hull, but a ball is outside if it is beyond a face."""

    hull: Hull


class ConeObstacle(NamedTuple):
    """The outside of an infinite cone; a row has one end ball of a body, or all balls around parts."""

    apex: Vector
    """From p'_E [l_arm]."""
    axis: Vector
    """Unit vector; unused if the axis points to the COM."""
    sine: float
    """Sine of the half-angle."""
    cosine: float
    end: float
    """eta of the end ball, 0 or 1."""
    to_com: float
    """1 if the axis points to the COM, else 0."""


class ReachObstacle(NamedTuple):
    """All points too far from the end-effector."""

    distance: float
    """Largest reach of a rod [l_arm]."""


class OffsetObstacle(NamedTuple):
    """The centre of mass, near which the end-effector has no direction."""

    distance: float
    """Smallest length of p_E [l_arm]."""


SearchBody = CentreBody | EnvelopeBody | RodBody | PartsBody | JetBody
SearchObstacle = (
    ModuleObstacle | AirflowObstacle | TipObstacle | CapsuleObstacle | HullObstacle | FacesObstacle
    | ConeObstacle | ReachObstacle | OffsetObstacle
)  # fmt: skip
BODIES, OBSTACLES = get_args(SearchBody), get_args(SearchObstacle)
CENTRE, ENVELOPE, ROD, PARTS, JET = range(len(BODIES))
MODULE, AIRFLOW, TIP_POINT, CAPSULE, HULL, FACES, CONE, REACH, OFFSET = range(len(OBSTACLES))
"""Kinds of bodies and obstacles in the compiled search; `nlp.reduced.clearance` has a function for each."""


class SearchRow(NamedTuple):
    """A row of the compiled search: a body of module i keeps out of an obstacle."""

    body: SearchBody
    obstacle: SearchObstacle
    subject: int = 0
    """Index of module i in the requirement's subject."""
