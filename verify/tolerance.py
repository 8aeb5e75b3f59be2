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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from topo_search.model import Topology, needs_offset
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.audit import Kind
from topo_search.model.exposure import EXPOSURE_KINDS
from verify.bodies import Array, Cone, Rows
from verify.certificate import ROUNDING, Solid, witnesses
from verify.hulls import Hull, witness
from verify.meshes import Indices
from verify.requirements import Requirement, Scene


@dataclass(frozen=True, eq=False)
class Motion:
    """Largest motion along n of N points with two positions each: at most `along(delta)`, delta in radians."""

    L: Array
    """Shape (N, 2)."""
    S: Array
    """Shape (N, 2)."""
    C: Array
    """Shape (N, 2)."""

    def bound_along(self, delta: float) -> Array:
        """Return the bound, shape (N, 2)."""
        return np.asarray(np.minimum(delta * self.L, delta * self.S + delta * delta * self.C))


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

    def motion(self, carrier: Indices, held: Indices, points: Indices, n: Array) -> Motion:
        """Return how far points can move along n, seen from the last module that two paths from the holder share.

        Args:
            carrier: the module that carries the point, shape (N,).
            held: the module at the other end of the path, shape (N,).
            points: which two of the carrier's points, shape (2,).
            n: unit vectors, shape (N, 2, 3).
        """
        L, S, C = (np.zeros((len(carrier), 2)) for _ in range(3))
        step = max(1, 500_000 // max(1, len(self.moves)))  # arms that are held at a time
        for start in range(0, len(carrier), step):
            rows = slice(start, start + step)
            i, j = carrier[rows], held[rows]
            shared = (self.moves[:, i] & self.moves[:, j]).sum(axis=0)
            k, h = np.nonzero((self.moves[:, i] & ~self.moves[:, j]).T)  # hinge h is on the path of row k
            rho = self._rho[i[k], h][:, points]
            t = np.sum(self._arms[i[k], h][:, points] * n[rows][k], axis=-1)
            order = (self._depth[h] - shared[k])[:, None]
            for total, terms in ((L, rho), (S, np.abs(t)), (C, (order - 0.5) * rho)):
                total[rows] = np.stack([np.bincount(k, term, len(i)) for term in terms.T], axis=1)
        return Motion(L, S, C)

    def arms_towards(self, carrier: int, held: int, end: int) -> Array:
        """Return by how much a point moves as each hinge turns, and 0 off its path, shape (H, 3)."""
        on_path = self.moves[:, carrier] & ~self.moves[:, held]
        return np.where(on_path[:, None], self._arms[carrier][:, end], 0.0)

    def drift(self, g: Array) -> Array:
        """Return by how much the sum over all modules' centres moves along g as each hinge turns, shape (H,)."""
        return np.asarray(np.einsum("hi,ihx,x->h", self.moves.astype(float), self._arms[:, :, 0], g))


KINDS: tuple[Kind, ...] = ("airflow", *EXPOSURE_KINDS, "exclusion", "separation")
"""The kinds of requirements that have a bound."""
BOTH, CENTRE = np.array([0, 1]), np.array([0, 0])
"""Indices of the two end balls of a module's envelope whose hull a side is."""


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


@dataclass(frozen=True, eq=False)
class _Group:
    """The N requirements of one kind."""

    requirements: Sequence[Requirement]
    points: Array
    """BOTH or CENTRE."""
    gaps: Array
    """Without errors, for each end of A and of B, shape (N, 2, 2)."""
    n: Array
    """From A to B, or out of the cone, for each end of A, shape (N, 2, 3)."""
    of_A: Motion
    of_B: Motion | None
    """None if B goes with p_E."""
    envelopes: int
    """Number of sides that are airflow."""
    swing: Array
    """Distance over which an end of B (of A, in a cone) feels a change of p_E's direction, shape (N, 2)."""
    bend: Array | None = None
    """cos(theta) / (2 |w|) for each end of A, shape (N, 2); None unless B is a cone."""

    def bounds(self, errors: Errors, kappa: float) -> Array:
        """Return the least gaps with errors, shape (N, 2, 2)."""
        lost = self.of_A.bound_along(errors.delta) + 2 * errors.delta_p
        if self.bend is not None:
            u = errors.delta * self.of_A.L + 2 * errors.delta_p
            lost = np.minimum(u, lost + self.bend * u * u) + kappa * np.where(self.swing > 0, self.swing + u, 0.0)
            gaps = self.gaps - lost[:, :, None]
        else:
            gaps = self.gaps - lost[:, :, None] - kappa * self.swing[:, None, :]
            if self.of_B is not None:
                gaps -= self.of_B.bound_along(errors.delta)[:, None, :]
        return np.asarray(gaps - self.envelopes * errors.delta_e)


class Tolerance:
    """Clearances of a design that remain under errors."""

    def __init__(self, scene: Scene, requirements: Sequence[Requirement], holder: int) -> None:
        """Measure every requirement of KINDS once; there must be one. The holder is a module."""
        self._task, self._scene, self._holder, design = scene.design.task, scene, holder, scene.design
        l_c = design.task.module.connector_distance / scene.l_arm

        def levers(envelopes: Sequence[Solid]) -> Levers:
            endpoints = np.array([(solid.body.o, solid.body.o + solid.body.d) for solid in envelopes])
            return Levers(design.topology, scene.R, endpoints, l_c, holder)

        self._levers, self._region_levers = levers(scene.envelopes), levers(scene.region_envelopes)
        of_kind = [[r for r in requirements if r.kind == kind] for kind in KINDS]
        self._groups = [self._group(group) for group in of_kind if group]
        n, module = design.topology.n, design.task.module
        arms = self._levers.motion(np.arange(n), np.full(n, holder), CENTRE, np.zeros((n, 2, 3))).L[:, 0]
        # a connector is l_c from its module's centre, and turns with it by as many errors as there are hinges to it
        parents = [h for h, _, _, _ in design.topology.edges()]
        joints = (arms + l_c * self._levers.moves.sum(axis=0))[parents]
        self._arms, masses = np.append(arms, joints), np.repeat([module.mass, module.joint_mass], [n, n - 1])
        self._shares = masses / design.task.total_mass(n)
        self._share = float(self._shares[0])
        self._offset = float(np.linalg.norm(scene.offset))

    def _group(self, group: list[Requirement]) -> _Group:
        return self._of_regions(group) if isinstance(group[0].against, Cone) else self._of_pairs(group)

    def _of_pairs(self, group: list[Requirement]) -> _Group:
        """Return requirements of pairs of bodies."""
        kind, a = group[0].kind, np.array([r.a for r in group])
        of_solids = witnesses([(r.body, r.against) for r in group if isinstance(r.against, Solid)])
        at = [witness(r.body.body, r.against) if isinstance(r.against, Hull) else next(of_solids) for r in group]
        n = np.array([nearest.n for nearest in at])
        most_of_A = Rows.of([r.body.body for r in group]).extents(n, 1)
        least_of_B = _starts([r.against for r in group], n)
        gaps = least_of_B[:, None, :] - most_of_A[:, :, None]
        n = np.repeat(n[:, None], 2, axis=1)
        swing = np.zeros((len(group), 2))
        for row, r in enumerate(group):
            if isinstance(r.against, Solid) and self._turns(r):
                swing[row, 1] = np.linalg.norm(r.against.body.d)
        between = kind in ("airflow", "separation")
        b = np.array([r.b for r in group]) if between else np.full_like(a, self._holder)
        points = CENTRE if kind in ("exclusion", "separation") else BOTH
        levers = self._levers_of(group[0])
        return _Group(
            group,
            points,
            gaps,
            n,
            levers.motion(a, b, points, n),
            levers.motion(b, a, points, n) if between else None,
            2 if kind == "airflow" else int(kind in EXPOSURE_KINDS),
            swing,
        )

    def _of_regions(self, group: list[Requirement]) -> _Group:
        """Return requirements of allowed cones and half-spaces."""
        a = np.array([r.a for r in group])
        inside = [(r.body.body, r.against) for r in group if isinstance(r.against, Cone)]
        X = np.array([(body.o, body.o + body.d) for body, _ in inside])
        m = np.array([cone.inward_normal(points) for (_, cone), points in zip(inside, X, strict=True)])
        gaps = np.array(
            [cone.s(points) - (body.r, body.r + body.dr) for (body, cone), points in zip(inside, X, strict=True)]
        )
        q = X - np.array([cone.apex for _, cone in inside])[:, None]
        axes = np.array([cone.axis for _, cone in inside])[:, None]
        w = np.linalg.norm(q - np.sum(q * axes, axis=-1, keepdims=True) * axes, axis=-1)
        cos = np.array([cone.sin_cos[1] for _, cone in inside])
        turns = np.array([self._turns(r) for r in group])
        return _Group(
            group,
            BOTH,
            np.repeat(gaps[:, :, None], 2, axis=2),
            -m,
            self._region_levers.motion(a, np.full_like(a, self._holder), BOTH, m),
            None,
            1,
            turns[:, None] * np.linalg.norm(q, axis=-1),
            cos[:, None] / (2 * np.maximum(w, 1e-9)),
        )

    def _levers_of(self, requirement: Requirement) -> Levers:
        return self._region_levers if requirement.kind in EXPOSURE_KINDS else self._levers

    def _turns(self, requirement: Requirement) -> bool:
        """True if a requirement takes its direction from p_E."""
        exposed = requirement.kind in EXPOSURE_KINDS
        return exposed and needs_offset(self._task.exposure[requirement.b])

    def _kappa(self, errors: Errors) -> float:
        e = float(self._shares @ (errors.delta * self._arms + 2 * errors.delta_p))
        return min(2.0, 2 * e / (2 * self._offset - e)) if e < self._offset else 2.0

    def keeps(self, errors: Errors) -> bool:
        """Return whether every pair's bound stays above rounding."""
        kappa = self._kappa(errors)
        return all(group.bounds(errors, kappa).min() > ROUNDING for group in self._groups)

    def weakest(self, errors: Errors) -> Weakest:
        """Return the pair with the least bound of all."""
        kappa, least = self._kappa(errors), []
        for number, group in enumerate(self._groups):
            bounds = group.bounds(errors, kappa).min(axis=(1, 2))
            row = int(np.argmin(bounds))
            least.append((float(bounds[row]), number, row))
        bound, number, row = min(least)
        return self._example(self._groups[number], row, bound)

    def pairs_up_to(self, errors: Errors, bound: float) -> list[Weakest]:
        """Return all pairs whose bound is no more than that, the weakest first."""
        kappa, pairs = self._kappa(errors), []
        for number, group in enumerate(self._groups):
            bounds = group.bounds(errors, kappa).min(axis=(1, 2))
            pairs += [(float(bounds[row]), number, row) for row in np.flatnonzero(bounds <= bound).tolist()]
        return [self._example(self._groups[number], row, least) for least, number, row in sorted(pairs)]

    def _example(self, group: _Group, row: int, bound: float) -> Weakest:
        requirement = group.requirements[row]
        a, b = requirement.a, requirement.b
        held = self._holder if group.of_B is None else b
        examples = []
        for end_A, end in enumerate(group.points):
            n = group.n[row, end_A]
            drift = self._drift(requirement, group.points[end_A], n)
            turns = np.sum(self._levers_of(requirement).arms_towards(a, held, end) * n, axis=-1)
            turns -= self._levers.drift(self._share * drift)
            shifts = np.tile(-self._share * drift, (len(self._scene.centres), 1))
            shifts[a] += n
            tip = np.zeros(3) if group.of_B is not None else len(shifts) * self._share * drift - n
            if group.of_B is None:
                examples.append(Example(np.sign(turns), _units(shifts), _units(tip)))
                continue
            shifts[b] -= n
            for other in group.points:
                against = np.sum(self._levers.arms_towards(b, a, other) * n, axis=-1)
                examples.append(Example(np.sign(turns - against), _units(shifts), tip))
        different = {b"".join(errors.tobytes() for errors in example): example for example in examples}
        return Weakest(bound, requirement, tuple(different.values()))

    def _drift(self, requirement: Requirement, end: int, n: Array) -> Array:
        """Return how much a clearance grows, to first order, with a shift of the COM alone, shape (3,).

        That turns v, and with it an axis along v by minus the part of the shift across v, over |v|.
        """
        if not self._turns(requirement):
            return np.zeros(3)
        v = self._scene.offset
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


def _starts(against: Sequence[Solid | Cone | Hull], n: Array) -> Array:
    """Return where both ends of every second side begin along n, shape (N, 2); a region has but one."""
    solid = np.array([isinstance(each, Solid) for each in against])
    starts = np.empty((len(against), 2))
    starts[solid] = Rows.of([each.body for each in against if isinstance(each, Solid)]).extents(n[solid], -1)
    for row, each in enumerate(against):
        if isinstance(each, Hull):
            starts[row] = (each.mesh.vertices @ n[row]).min()
    return starts


def _units(v: Array) -> Array:
    """Return vectors, shape (..., 3), as unit vectors; zero stays zero."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(v / np.where(length > 0, length, 1.0))
