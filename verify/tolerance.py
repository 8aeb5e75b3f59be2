r"""Proven bounds of a design's clearances as functions of the errors with which it is built.

| symbol | meaning | unit |
|---|---|---|
| delta | largest error of every hinge angle | rad |
| delta_p | largest error of every module's centre and of p_E, from where the hinges put them | l_arm |
| delta_e | how far the airflow may reach beyond its envelope | l_arm |
| A, B | the sides of a requirement; B may be a target volume, which goes with p_E | |
| X, r | centres and radii of balls whose hull a side is: the end balls of a cone-sphere, corners | l_arm |
| n | unit vector from A to B where they are nearest; any would do | |
| v, e | p_E from the COM, and its largest error | l_arm |
| kappa | largest change of v / \|v\|, where a requirement takes its direction from it | |

One module, the holder, carries the end-effector: the one that its rod is bolted to. Seen from there, p_E and its
target volumes stay where they are. Whatever the errors, both sides are hulls of balls again, and no clearance is
less than the gap of a plane across n:

    clearance >= min over ends of n . (X_B - X_A) - r_A - r_B - (moves of X_A along n, and of X_B against it)

`verify.tolerance` bounds the moves, seen from the last module that the paths to both sides share: errors that both
have in common cancel. By Dunkl and Williams, kappa <= 2 e / (\|v\| + \|v'\|). For the allowed cone of an exterior
requirement, q = X - apex, w its part across the axis, m the inward normal and u a move of q,

    s(q + u) >= s(q) - \|u\|,    s(q + u) >= s(q) + m . u - \|u\|^2 cos(theta) / (2 \|w\|),

and a turn of the axis by a chord kappa changes s(q) by \|q\| kappa at most. Nothing is linearised.

Errors of hinge angles move what the modules carry:

| symbol | meaning | shape |
|---|---|---|
| a_h, c_h | axis of hinge h and a point on it, where the design puts them | (H, 3) |
| x | a point that a module carries | (3,) |
| n | unit vector | (3,) |
| m | a hinge's place on the path from the module that holds the target to the one that carries x, 1 the nearest | |
| rho_h | \|a_h x (x - c_h)\|, the distance of x from the hinge's axis: its arm | |
| t_h | n . (a_h x (x - c_h)), the part of the arm that counts along n | |
| delta | largest error of an angle | |

Let hinge m turn by theta_m, \|theta_m\| <= delta, and R_m be that turn about the axis where the design puts it. The
point goes to R_1 R_2 ... R_k x, so that it moves by the sum over m of Q_m (R_m x - x), where Q_m is the rotation of
R_1 ... R_(m-1), by an angle of (m - 1) delta at most. Nothing is linearised:

.. math::

    |R_m x - x| &\le \delta \rho_m \\
    |n \cdot Q_m (R_m x - x)| &\le |n \cdot (R_m x - x)| + (m - 1)\, \delta\, |R_m x - x|
                               \le \delta |t_m| + \tfrac12 \delta^2 \rho_m + (m - 1)\, \delta^2 \rho_m

So along n the point moves by delta L at most, with L = sum rho_m, and by delta S + delta^2 C at most, with
S = sum |t_m| and C = sum (m - 1/2) rho_m. Hinges that turn both sides of a pair are not on the path.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from topo_search.model import Topology, needs_offset
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.audit import Kind
from topo_search.model.exposure import EXPOSURE_KINDS
from verify.bodies import Array, Cone, ConeSpheres
from verify.certificate import BOUND_ROUNDING, Solid, witnesses
from verify.hulls import Hull
from verify.meshes import Indices
from verify.requirements import Requirement, Scene


class Levers:
    """The hinges of a platform, and the arms of two points that each module carries."""

    def __init__(self, topology: Topology, R: Array, points: Array, half_step: float, holder: int) -> None:
        """Find the hinges.

        Args:
            topology: the tree.
            R: orientations of the modules, shape (n, 3, 3).
            points: two points that each module carries, its centre first, shape (n, 2, 3).
            half_step: from a module's centre to the hinge at its port, in the unit of the points.
            holder: the module that all others are seen from.
        """
        n = topology.n
        self.moves = np.zeros((n - 1, n), dtype=bool)
        """[h, i]: hinge h, that of module h + 1, lies between the holder and module i."""
        axes, on_axes = np.zeros((n - 1, 3)), np.zeros((n - 1, 3))
        for h, i, a, _ in topology.edges():
            self.moves[:, i] = self.moves[:, h]
            self.moves[i - 1, i] = True
            axes[i - 1] = R[h] @ np.eye(3)[1 if a % 2 == 0 else 0]
            on_axes[i - 1] = points[h, 0] + half_step * R[h] @ PORT_DIRECTIONS[a]
        # Seen from beyond a hinge, what is before it moves, and the other way round.
        beyond = self.moves[:, holder].copy()
        self.moves ^= beyond[:, None]
        axes[beyond] *= -1
        arms = np.cross(axes[:, None, None], points[None] - on_axes[:, None, None])
        self._arms = arms.transpose(1, 0, 2, 3)  # (n, H, 2, 3)
        self._rho = np.linalg.norm(self._arms, axis=-1)
        on_path = self.moves.sum(axis=0, dtype=float)
        self._depth = np.array([max(on_path[h], on_path[i]) for h, i, _, _ in topology.edges()])

    def motion(self, carrier: Indices, held: Indices, points: Indices, n: Array) -> Array:
        """Return L, S and C of points seen from the last module that two paths share, shape (N, 3, 2).

        Args:
            carrier: the module that carries the point, shape (N,).
            held: the module at the other end of the path, shape (N,).
            points: which two of the carrier's points, shape (2,).
            n: unit vectors, shape (N, 2, 3).
        """
        motion = np.zeros((len(carrier), 3, 2))
        step = max(1, 500_000 // max(1, len(self.moves)))  # arms that are held at a time
        for start in range(0, len(carrier), step):
            rows = slice(start, start + step)
            i, j = carrier[rows], held[rows]
            shared = (self.moves[:, i] & self.moves[:, j]).sum(axis=0)
            k, h = np.nonzero((self.moves[:, i] & ~self.moves[:, j]).T)  # hinge h is on the path of row k
            rho = self._rho[i[k], h][:, points]
            t = np.sum(self._arms[i[k], h][:, points] * n[rows][k], axis=-1)
            order = (self._depth[h] - shared[k])[:, None]
            terms = np.hstack([rho, np.abs(t), (order - 0.5) * rho])
            sums = np.stack([np.bincount(k, term, len(i)) for term in terms.T], axis=1)
            motion[rows] = sums.reshape(-1, 3, 2)
        return motion

    def arms_towards(self, carrier: int, held: int, end: int) -> Array:
        """Return by how much a point moves as each hinge turns, and 0 off its path, shape (H, 3)."""
        on_path = self.moves[:, carrier] & ~self.moves[:, held]
        return np.where(on_path[:, None], self._arms[carrier][:, end], 0.0)

    def drift(self, g: Array) -> Array:
        """Return by how much the sum over all modules' centres moves along g as each hinge turns, shape (H,)."""
        return np.asarray(np.einsum("hi,ihx,x->h", self.moves.astype(float), self._arms[:, :, 0], g))


KINDS: tuple[Kind, ...] = ("airflow", *EXPOSURE_KINDS, "exclusion", "separation")
"""The kinds of requirements that have a bound."""
BETWEEN: tuple[Kind, ...] = ("airflow", "separation")
"""Those between two modules; of all others B goes with p_E."""


class Errors(NamedTuple):
    """Largest errors, in radians and l_arm."""

    delta: float = 0.0
    delta_p: float = 0.0
    delta_e: float = 0.0

    def times(self, factor: float) -> Errors:
        """Return all of them, larger by a factor."""
        return Errors(*(factor * error for error in self))


class Example(NamedTuple):
    """Errors of a platform, at most 1 each; errors of some size are these times their largest."""

    turns: Array
    """Turns of the hinges, shape (n-1,)."""
    shifts: Array
    """Shifts of the modules' centres, shape (n, 3)."""
    tip: Array
    """Shift of p_E, shape (3,)."""


class Weakest(NamedTuple):
    """A pair, its bound, and errors that bring its ends nearest to each other to first order."""

    bound: float
    """Bound on its clearance [l_arm]."""
    requirement: Requirement
    examples: tuple[Example, ...]
    """One or more for each two ends."""


class _Table(NamedTuple):
    """N requirements."""

    gaps: Array
    """Without errors, for each end of A and of B, shape (N, 2, 2)."""
    n: Array
    """From A to B, or out of the cone, for each end of A, shape (N, 2, 3)."""
    of_A: Array
    """L, S, C of both ends of A, shape (N, 3, 2)."""
    of_B: Array
    """The same of B; zero if B goes with p_E."""
    envelopes: Array
    """Number of sides that are airflow, shape (N, 1, 1)."""
    swing: Array
    """Distance over which an end of B (of A, in a cone) feels a change of p_E's direction, shape (N, 2)."""
    bend: Array
    """cos(theta) / (2 |w|) for each end of A, shape (N, 2); NaN unless B is a cone."""

    def bounds(self, errors: Errors, kappa: float) -> Array:
        """Return the least gaps with errors, shape (N,)."""
        lost = _displacement(self.of_A, errors.delta) + 2 * errors.delta_p
        u = errors.delta * self.of_A[:, 0] + 2 * errors.delta_p
        curved = np.minimum(u, lost + self.bend * u * u) + kappa * np.where(self.swing > 0, self.swing + u, 0.0)
        in_cone = ~np.isnan(self.bend)
        gaps = self.gaps - np.where(in_cone, curved, lost)[:, :, None]
        gaps = gaps - kappa * np.where(in_cone, 0.0, self.swing)[:, None, :]
        gaps -= _displacement(self.of_B, errors.delta)[:, None, :]
        return np.asarray((gaps - self.envelopes * errors.delta_e).min(axis=(1, 2)))


def _displacement(motion: Array, delta: float) -> Array:
    """Return the largest motion along n, shape (N, 2)."""
    L, S, C = motion.transpose(1, 0, 2)
    return np.asarray(np.minimum(delta * L, delta * S + delta * delta * C))


class Tolerance:
    """Clearances of a design that remain under errors."""

    def __init__(self, scene: Scene, requirements: Sequence[Requirement], holder: int) -> None:
        """Measure every requirement of KINDS once; there must be one. The holder is a module."""
        self.scene, self.holder, design = scene, holder, scene.design
        l_c = design.task.module.connector_distance / scene.l_arm

        def levers(envelopes: Sequence[Solid]) -> Levers:
            endpoints = np.array([(solid.body.o, solid.body.o + solid.body.d) for solid in envelopes])
            return Levers(design.topology, scene.R, endpoints, l_c, holder)

        self._levers, self._region_levers = levers(scene.envelopes), levers(scene.region_envelopes)
        of_kind = [[r for r in requirements if r.kind == kind] for kind in KINDS]
        self._requirements = [r for group in of_kind for r in group]
        self._table = _Table(*map(np.concatenate, zip(*map(self._measure, filter(None, of_kind)), strict=True)))
        n, module = design.topology.n, design.task.module
        centre, still = _points("separation"), np.zeros((n, 2, 3))
        arms = self._levers.motion(np.arange(n), np.full(n, holder), centre, still)[:, 0, 0]
        # a connector is l_c from its module's centre, and turns with it by as many errors as there are hinges to it
        parents = [h for h, _, _, _ in design.topology.edges()]
        joints = (arms + l_c * self._levers.moves.sum(axis=0))[parents]
        self._arms, masses = np.append(arms, joints), np.repeat([module.mass, module.joint_mass], [n, n - 1])
        self._shares = masses / design.task.total_mass(n)
        self._share = float(self._shares[0])
        self._offset = float(np.linalg.norm(scene.offset))

    def _measure(self, group: list[Requirement]) -> _Table:
        """Return the table of requirements of one kind."""
        kind, a, N = group[0].kind, np.array([r.a for r in group]), len(group)
        b = np.array([r.b if kind in BETWEEN else self.holder for r in group])
        levers, points = self._levers_of(kind), _points(kind)
        turns = np.array([self._turns(r) for r in group])[:, None]
        measure = _in_cones if isinstance(group[0].against, Cone) else _of_pairs
        gaps, n, swing, bend = measure(group)
        of_B = levers.motion(b, a, points, n) if kind in BETWEEN else np.zeros((N, 3, 2))
        airflow = np.full((N, 1, 1), 2 if kind == "airflow" else int(kind in EXPOSURE_KINDS))
        return _Table(gaps, n, levers.motion(a, b, points, n), of_B, airflow, turns * swing, bend)

    def _levers_of(self, kind: Kind) -> Levers:
        return self._region_levers if kind in EXPOSURE_KINDS else self._levers

    def _turns(self, requirement: Requirement) -> bool:
        """True if a requirement takes its direction from p_E."""
        exposed = requirement.kind in EXPOSURE_KINDS
        return exposed and needs_offset(self.scene.design.task.exposure[requirement.b])

    def _bounds(self, errors: Errors) -> Array:
        """Return every pair's bound, shape (N,)."""
        e = float(self._shares @ (errors.delta * self._arms + 2 * errors.delta_p))
        kappa = min(2.0, 2 * e / (2 * self._offset - e)) if e < self._offset else 2.0
        return self._table.bounds(errors, kappa)

    def keeps(self, errors: Errors) -> bool:
        """Return whether every pair's bound stays above rounding."""
        return bool(self._bounds(errors).min() > BOUND_ROUNDING)

    def weakest(self, errors: Errors) -> Weakest:
        """Return the pair with the least bound of all."""
        bounds = self._bounds(errors)
        return self._example(int(np.argmin(bounds)), float(bounds.min()))

    def pairs_up_to(self, errors: Errors, bound: float) -> Iterator[Weakest]:
        """Yield all pairs whose bound is no more than that, the weakest first."""
        bounds = self._bounds(errors)
        order = np.argsort(bounds, kind="stable")
        return (self._example(int(row), float(bounds[row])) for row in order if bounds[row] <= bound)

    def _example(self, row: int, bound: float) -> Weakest:
        requirement = self._requirements[row]
        a, b, between = requirement.a, requirement.b, requirement.kind in BETWEEN
        levers, points = self._levers_of(requirement.kind), _points(requirement.kind)
        examples = []
        for n, end in zip(self._table.n[row], points, strict=True):
            drift = self._drift(requirement, end, n)
            turns = np.sum(levers.arms_towards(a, b if between else self.holder, end) * n, axis=-1)
            turns -= self._levers.drift(self._share * drift)
            shifts = np.tile(-self._share * drift, (len(self.scene.centres), 1))
            shifts[a] += n
            if not between:
                tip = len(shifts) * self._share * drift - n
                examples.append(Example(np.sign(turns), _units(shifts), _units(tip)))
                continue
            shifts[b] -= n
            for other in points:
                against = np.sum(levers.arms_towards(b, a, other) * n, axis=-1)
                examples.append(Example(np.sign(turns - against), _units(shifts), np.zeros(3)))
        different = {b"".join(errors.tobytes() for errors in example): example for example in examples}
        return Weakest(bound, requirement, tuple(different.values()))

    def _drift(self, requirement: Requirement, end: int, n: Array) -> Array:
        """Return how much a clearance grows, to first order, with a shift of the COM alone, shape (3,).

        That turns v, and with it an axis along v by minus the part of the shift across v, over |v|.
        """
        if not self._turns(requirement):
            return np.zeros(3)
        v = self.scene.offset
        along = v / self._offset
        if isinstance(requirement.against, Cone):
            cone, body = requirement.against, requirement.body.body
            sin, cos = cone.sin_cos
            q = body.centre(float(end)) - cone.apex
            w = q - (q @ cone.axis) * cone.axis
            wide = float(np.linalg.norm(w))
            grows = (sin + cos * float(q @ cone.axis) / wide if wide > 0 else sin) * w  # ds / d(axis), across it
        elif isinstance(requirement.against, Solid):
            grows = -float(np.linalg.norm(requirement.against.body.d)) * n  # the far end of the path
        return np.asarray(grows - (grows @ along) * along) / self._offset


def _points(kind: Kind) -> Indices:
    """Return the two end balls of a module's envelope whose hull a side is: of a ball, the first one twice."""
    return np.array([0, 0] if kind in ("exclusion", "separation") else [0, 1])


def _of_pairs(group: list[Requirement]) -> tuple[Array, Array, Array, Array]:
    """Return gaps, n, and swing, if any, of pairs of bodies."""
    pairs = [(r.body, r.against) for r in group if not isinstance(r.against, Cone)]
    n = np.array([nearest.n for nearest in witnesses(pairs)])
    most_of_A = ConeSpheres.of([r.body.body for r in group]).extents(n, 1)
    gaps = _starts([r.against for r in group], n)[:, None, :] - most_of_A[:, :, None]
    lengths = [float(np.linalg.norm(r.against.body.d)) if isinstance(r.against, Solid) else 0.0 for r in group]
    return gaps, np.repeat(n[:, None], 2, axis=1), np.outer(lengths, [0.0, 1.0]), np.full((len(group), 2), np.nan)


def _in_cones(group: list[Requirement]) -> tuple[Array, Array, Array, Array]:
    """Return gaps, n, swing, if any, and bend of bodies in cones and half-spaces."""
    inside = [(r.body.body, r.against) for r in group if isinstance(r.against, Cone)]
    X = np.array([(body.o, body.o + body.d) for body, _ in inside])
    m = np.array([cone.inward_normal(points) for (_, cone), points in zip(inside, X, strict=True)])
    gaps = [cone.s(points) - (body.r, body.r + body.dr) for (body, cone), points in zip(inside, X, strict=True)]
    q = X - np.array([cone.apex for _, cone in inside])[:, None]
    axes = np.array([cone.axis for _, cone in inside])[:, None]
    w = np.linalg.norm(q - np.sum(q * axes, axis=-1, keepdims=True) * axes, axis=-1)
    cos = np.array([cone.sin_cos[1] for _, cone in inside])[:, None]
    both = np.repeat(np.array(gaps)[:, :, None], 2, axis=2)
    return both, -m, np.linalg.norm(q, axis=-1), cos / (2 * np.maximum(w, 1e-9))


def _starts(against: Sequence[Solid | Cone | Hull], n: Array) -> Array:
    """Return where both ends of every second side begin along n, shape (N, 2); a region has but one."""
    solid = np.array([isinstance(each, Solid) for each in against])
    starts = np.empty((len(against), 2))
    starts[solid] = ConeSpheres.of([each.body for each in against if isinstance(each, Solid)]).extents(n[solid], -1)
    for row, each in enumerate(against):
        if isinstance(each, Hull):
            starts[row] = (each.mesh.vertices @ n[row]).min()
    return starts


def _units(v: Array) -> Array:
    """Return vectors, shape (..., 3), as unit vectors; zero stays zero."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(v / np.where(length > 0, length, 1.0))
