r"""Proven bounds on a design's clearances as functions of its build errors.

| symbol | meaning | unit |
|---|---|---|
| delta | largest error of a hinge angle | rad |
| delta_p | largest error of a module's centre and of p_E in addition to that of the hinges | l_arm |
| delta_e | largest reach of the airflow beyond its envelope | l_arm |
| A, B | the sides of a requirement; B may be a target volume, which moves with p_E | |
| X, r | centres and radii of the balls whose hull is a side: end balls of a cone-sphere, or vertices | l_arm |
| n | unit vector from A to B at their nearest points; any unit vector is valid | |
| v, e | p_E from the COM, and its largest error | l_arm |
| kappa | largest change of v / \|v\|, if a requirement takes its direction from v | |

One module, the holder, carries the end-effector; the rod is bolted to it. In its frame, p_E and its target volumes
do not move. With any errors, both sides are still hulls of balls, and no clearance is less than the gap between
planes normal to n:

    clearance >= min over ends of n . (X_B - X_A) - r_A - r_B - (displacements of X_A along n and of X_B against n)

`Levers` bounds the displacements relative to the last module that the paths to both sides share, so common errors
cancel. By Dunkl and Williams, kappa <= 2 e / (\|v\| + \|v'\|). For the allowed cone of an exterior requirement,
with q = X - apex, w its part perpendicular to the axis, m the inward normal and u a displacement of q,

    s(q + u) >= s(q) - \|u\|,    s(q + u) >= s(q) + m . u - \|u\|^2 cos(theta) / (2 \|w\|),

and a turn of the axis by a chord kappa changes s(q) by at most \|q\| kappa. Nothing is linearised.

Hinge errors move the points that modules carry:

| symbol | meaning | shape |
|---|---|---|
| a_h, c_h | nominal axis of hinge h and a point on it | (H, 3) |
| x | a point that a module carries | (3,) |
| n | unit vector | (3,) |
| m | position of a hinge on the path from the module at the other end to the one that carries x, counted from 1 | |
| rho_h | \|a_h x (x - c_h)\|, lever arm: the distance of x from the hinge's axis | |
| t_h | n . (a_h x (x - c_h)), component of the arm along n | |
| delta | largest error of an angle | |

Let hinge m turn by theta_m, \|theta_m\| <= delta, and let R_m be that rotation about its nominal axis. The point
moves to R_1 R_2 ... R_k x, so its displacement is the sum over m of Q_m (R_m x - x), where Q_m is the rotation of
R_1 ... R_(m-1), by an angle of at most (m - 1) delta. Nothing is linearised:

.. math::

    |R_m x - x| &\le \delta \rho_m \\
    |n \cdot Q_m (R_m x - x)| &\le |n \cdot (R_m x - x)| + (m - 1)\, \delta\, |R_m x - x|
                               \le \delta |t_m| + \tfrac12 \delta^2 \rho_m + (m - 1)\, \delta^2 \rho_m

So along n the point moves by at most delta L, with L = sum rho_m, and by at most delta S + delta^2 C, with
S = sum |t_m| and C = sum (m - 1/2) rho_m. Hinges that move both sides of a pair are not on the path.
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
    """The hinges of a platform, and their lever arms to two points on each module."""

    def __init__(self, topology: Topology, R: Array, points: Array, l_c: float, holder: int) -> None:
        """Compute the hinge axes and the lever arms.

        Args:
            topology: the tree.
            R: orientations of the modules, shape (n, 3, 3).
            points: two points on each module, its centre first, shape (n, 2, 3).
            l_c: distance from a module's centre to the hinge at its port, in the unit of the points.
            holder: the module whose frame is fixed.
        """
        n = topology.n
        self.moves = np.zeros((n - 1, n), dtype=bool)
        """[h, i]: hinge h, between module h + 1 and its parent, moves module i relative to the holder."""
        axes, on_axes = np.zeros((n - 1, 3)), np.zeros((n - 1, 3))
        for h, i, a, _ in topology.edges():
            self.moves[:, i] = self.moves[:, h]
            self.moves[i - 1, i] = True
            axes[i - 1] = R[h] @ np.eye(3)[1 if a % 2 == 0 else 0]
            on_axes[i - 1] = points[h, 0] + l_c * R[h] @ PORT_DIRECTIONS[a]
        # A hinge between the root and the holder moves the root's side instead, in the opposite sense.
        reversed_hinges = self.moves[:, holder].copy()
        self.moves ^= reversed_hinges[:, None]
        axes[reversed_hinges] *= -1
        arms = np.cross(axes[:, None, None], points[None] - on_axes[:, None, None])
        self._arms = arms.transpose(1, 0, 2, 3)  # (n, H, 2, 3)
        self._rho = np.linalg.norm(self._arms, axis=-1)
        on_path = self.moves.sum(axis=0, dtype=float)
        self._depth = np.array([max(on_path[h], on_path[i]) for h, i, _, _ in topology.edges()])

    def motion(self, carrier: Indices, opposite: Indices, points: Indices, n: Array) -> Array:
        """Return L, S and C of points relative to the last module that two paths share, shape (N, 3, 2).

        Args:
            carrier: the module that carries the point, shape (N,).
            opposite: the module at the other end of the path, shape (N,).
            points: indices of two of the carrier's points, shape (2,).
            n: unit vectors, shape (N, 2, 3).
        """
        motion = np.zeros((len(carrier), 3, 2))
        step = max(1, 500_000 // max(1, len(self.moves)))  # lever arms in memory at a time
        for start in range(0, len(carrier), step):
            rows = slice(start, start + step)
            i, j = carrier[rows], opposite[rows]
            shared = (self.moves[:, i] & self.moves[:, j]).sum(axis=0)
            k, h = np.nonzero((self.moves[:, i] & ~self.moves[:, j]).T)  # hinge h is on the path of row k
            rho = self._rho[i[k], h][:, points]
            t = np.sum(self._arms[i[k], h][:, points] * n[rows][k], axis=-1)
            order = (self._depth[h] - shared[k])[:, None]
            terms = np.hstack([rho, np.abs(t), (order - 0.5) * rho])
            sums = np.stack([np.bincount(k, term, len(i)) for term in terms.T], axis=1)
            motion[rows] = sums.reshape(-1, 3, 2)
        return motion

    def point_rates(self, carrier: int, opposite: int, end: int) -> Array:
        """Return a point's displacement per angle of each hinge, 0 for hinges off the path, shape (H, 3)."""
        on_path = self.moves[:, carrier] & ~self.moves[:, opposite]
        return np.where(on_path[:, None], self._arms[carrier][:, end], 0.0)

    def centre_sum_rates(self, g: Array) -> Array:
        """Return the displacement along g of the sum of all module centres per angle of each hinge, shape (H,)."""
        return np.asarray(np.einsum("hi,ihx,x->h", self.moves.astype(float), self._arms[:, :, 0], g))


KINDS: tuple[Kind, ...] = ("airflow", *EXPOSURE_KINDS, "exclusion", "separation")
"""Kinds of requirements that have a bound."""
BETWEEN_MODULES: tuple[Kind, ...] = ("airflow", "separation")
"""Kinds between two modules; in all others B moves with p_E."""


class Errors(NamedTuple):
    """Largest errors, in radians and l_arm."""

    delta: float = 0.0
    delta_p: float = 0.0
    delta_e: float = 0.0

    def times(self, factor: float) -> Errors:
        """Return the errors times a factor."""
        return Errors(*(factor * error for error in self))


class Example(NamedTuple):
    """Normalised errors of a platform, each at most 1, to be multiplied by `Errors`."""

    turns: Array
    """Hinge errors, shape (n-1,)."""
    shifts: Array
    """Shifts of the modules' centres, shape (n, 3)."""
    tip: Array
    """Shift of p_E, shape (3,)."""


class Weakest(NamedTuple):
    """A pair, its bound, and the errors that bring its ends closest together to first order."""

    bound: float
    """Bound on the clearance [l_arm]."""
    requirement: Requirement
    examples: tuple[Example, ...]
    """One or more for each combination of ends."""


class _Table(NamedTuple):
    """Coefficients of the bounds of N requirements."""

    gaps: Array
    """Nominal gaps for each end of A and of B, shape (N, 2, 2)."""
    n: Array
    """Unit vectors from A to B, or out of the cone, for each end of A, shape (N, 2, 3)."""
    motion_A: Array
    """L, S, C of both ends of A, shape (N, 3, 2)."""
    motion_B: Array
    """L, S, C of both ends of B, shape (N, 3, 2); zero if B moves with p_E."""
    envelopes: Array
    """Number of sides that are airflow, shape (N, 1, 1)."""
    swing: Array
    """Lever arm of an end of B (of A, in a cone) when p_E's direction changes, shape (N, 2)."""
    bend: Array
    """cos(theta) / (2 |w|) for each end of A, shape (N, 2); NaN unless B is a cone."""

    def bounds(self, errors: Errors, kappa: float) -> Array:
        """Return the smallest gap of each requirement with errors, shape (N,)."""
        linear = _displacement(self.motion_A, errors.delta) + 2 * errors.delta_p
        u = errors.delta * self.motion_A[:, 0] + 2 * errors.delta_p
        curved = np.minimum(u, linear + self.bend * u * u) + kappa * np.where(self.swing > 0, self.swing + u, 0.0)
        in_cone = ~np.isnan(self.bend)
        gaps = self.gaps - np.where(in_cone, curved, linear)[:, :, None]
        gaps = gaps - kappa * np.where(in_cone, 0.0, self.swing)[:, None, :]
        gaps -= _displacement(self.motion_B, errors.delta)[:, None, :]
        return np.asarray((gaps - self.envelopes * errors.delta_e).min(axis=(1, 2)))


def _displacement(motion: Array, delta: float) -> Array:
    """Return bounds on the displacements along n, shape (N, 2)."""
    L, S, C = motion.transpose(1, 0, 2)
    return np.asarray(np.minimum(delta * L, delta * S + delta * delta * C))


class Tolerance:
    """Bounds on a design's clearances under build errors."""

    def __init__(self, scene: Scene, requirements: Sequence[Requirement], holder: int) -> None:
        """Tabulate the requirements of KINDS, of which there must be one; `holder` carries the end-effector."""
        self.scene, self.holder, design = scene, holder, scene.design
        l_c = design.task.module.connector_distance / scene.l_arm

        def levers(envelopes: Sequence[Solid]) -> Levers:
            endpoints = np.array([(solid.body.o, solid.body.o + solid.body.d) for solid in envelopes])
            return Levers(design.topology, scene.R, endpoints, l_c, holder)

        self._levers, self._region_levers = levers(scene.envelopes), levers(scene.region_envelopes)
        groups = [[r for r in requirements if r.kind == kind] for kind in KINDS]
        self._requirements = [r for group in groups for r in group]
        self._table = _Table(*map(np.concatenate, zip(*map(self._tabulate, filter(None, groups)), strict=True)))
        n, module = design.topology.n, design.task.module
        centre, no_direction = _points("separation"), np.zeros((n, 2, 3))
        arms = self._levers.motion(np.arange(n), np.full(n, holder), centre, no_direction)[:, 0, 0]
        # a joint is l_c from its parent's centre, so each hinge on the path adds at most l_c to the arm
        parents = [h for h, _, _, _ in design.topology.edges()]
        joints = (arms + l_c * self._levers.moves.sum(axis=0))[parents]
        self._arms, masses = np.append(arms, joints), np.repeat([module.mass, module.joint_mass], [n, n - 1])
        self._shares = masses / design.task.total_mass(n)
        self._share = float(self._shares[0])
        self._offset = float(np.linalg.norm(scene.offset))

    def _tabulate(self, group: list[Requirement]) -> _Table:
        """Return the table of requirements of one kind."""
        kind, a, N = group[0].kind, np.array([r.a for r in group]), len(group)
        b = np.array([r.b if kind in BETWEEN_MODULES else self.holder for r in group])
        levers, points = self._levers_of(kind), _points(kind)
        follows = np.array([self._follows_offset(r) for r in group])[:, None]
        geometry = _cone_geometry if isinstance(group[0].against, Cone) else _pair_geometry
        gaps, n, swing, bend = geometry(group)
        motion_B = levers.motion(b, a, points, n) if kind in BETWEEN_MODULES else np.zeros((N, 3, 2))
        envelopes = np.full((N, 1, 1), 2 if kind == "airflow" else int(kind in EXPOSURE_KINDS))
        return _Table(gaps, n, levers.motion(a, b, points, n), motion_B, envelopes, follows * swing, bend)

    def _levers_of(self, kind: Kind) -> Levers:
        return self._region_levers if kind in EXPOSURE_KINDS else self._levers

    def _follows_offset(self, requirement: Requirement) -> bool:
        """True if a requirement takes its direction from v."""
        is_exposure = requirement.kind in EXPOSURE_KINDS
        return is_exposure and needs_offset(self.scene.design.task.exposure[requirement.b])

    def _bounds(self, errors: Errors) -> Array:
        e = float(self._shares @ (errors.delta * self._arms + 2 * errors.delta_p))
        kappa = min(2.0, 2 * e / (2 * self._offset - e)) if e < self._offset else 2.0
        return self._table.bounds(errors, kappa)

    def is_clear(self, errors: Errors) -> bool:
        """Return whether every pair is proven clear."""
        return bool(self._bounds(errors).min() > BOUND_ROUNDING)

    def weakest(self, errors: Errors) -> Weakest:
        """Return the pair with the smallest bound."""
        bounds = self._bounds(errors)
        return self._example(int(np.argmin(bounds)), float(bounds.min()))

    def pairs_up_to(self, errors: Errors, bound: float) -> Iterator[Weakest]:
        """Yield all pairs whose bound is at most `bound`, the weakest first."""
        bounds = self._bounds(errors)
        order = np.argsort(bounds, kind="stable")
        return (self._example(int(row), float(bounds[row])) for row in order if bounds[row] <= bound)

    def _example(self, row: int, bound: float) -> Weakest:
        requirement = self._requirements[row]
        a, b, between_modules = requirement.a, requirement.b, requirement.kind in BETWEEN_MODULES
        levers, points = self._levers_of(requirement.kind), _points(requirement.kind)
        examples = []
        for n, end in zip(self._table.n[row], points, strict=True):
            gradient = self._com_gradient(requirement, end, n)
            turns = np.sum(levers.point_rates(a, b if between_modules else self.holder, end) * n, axis=-1)
            turns -= self._levers.centre_sum_rates(self._share * gradient)
            shifts = np.tile(-self._share * gradient, (len(self.scene.centres), 1))
            shifts[a] += n
            if not between_modules:
                tip = len(shifts) * self._share * gradient - n
                examples.append(Example(np.sign(turns), _units(shifts), _units(tip)))
                continue
            shifts[b] -= n
            for end_B in points:
                turns_B = np.sum(levers.point_rates(b, a, end_B) * n, axis=-1)
                examples.append(Example(np.sign(turns - turns_B), _units(shifts), np.zeros(3)))
        unique = {b"".join(errors.tobytes() for errors in example): example for example in examples}
        return Weakest(bound, requirement, tuple(unique.values()))

    def _com_gradient(self, requirement: Requirement, end: int, n: Array) -> Array:
        """Return the gradient of a clearance with respect to a shift of the COM only, shape (3,).

        The shift turns v, and an axis along v changes by minus the shift's part perpendicular to v, over |v|.
        """
        if not self._follows_offset(requirement):
            return np.zeros(3)
        v = self.scene.offset
        along = v / self._offset
        if isinstance(requirement.against, Cone):
            cone, body = requirement.against, requirement.body.body
            sin, cos = cone.sin_cos
            q = body.centre(float(end)) - cone.apex
            w = q - (q @ cone.axis) * cone.axis
            rho = float(np.linalg.norm(w))
            gradient = (
                sin + cos * float(q @ cone.axis) / rho if rho > 0 else sin
            ) * w  # perpendicular ds / d(axis)
        elif isinstance(requirement.against, Solid):
            gradient = -float(np.linalg.norm(requirement.against.body.d)) * n  # at the far end of the path
        return np.asarray(gradient - (gradient @ along) * along) / self._offset


def _points(kind: Kind) -> Indices:
    """Return the indices of the two end balls whose hull is a side; for a ball, the first one twice."""
    return np.array([0, 0] if kind in ("exclusion", "separation") else [0, 1])


def _pair_geometry(group: list[Requirement]) -> tuple[Array, Array, Array, Array]:
    """Return gaps, n, swing and bend (NaN) of pairs of bodies."""
    pairs = [(r.body, r.against) for r in group if not isinstance(r.against, Cone)]
    n = np.array([witness.n for witness in witnesses(pairs)])
    upper_A = ConeSpheres.of([r.body.body for r in group]).extents(n, 1)
    gaps = _lower_extents([r.against for r in group], n)[:, None, :] - upper_A[:, :, None]
    lengths = [float(np.linalg.norm(r.against.body.d)) if isinstance(r.against, Solid) else 0.0 for r in group]
    return gaps, np.repeat(n[:, None], 2, axis=1), np.outer(lengths, [0.0, 1.0]), np.full((len(group), 2), np.nan)


def _cone_geometry(group: list[Requirement]) -> tuple[Array, Array, Array, Array]:
    """Return gaps, n, swing and bend of bodies in cones and half-spaces."""
    pairs = [(r.body.body, r.against) for r in group if isinstance(r.against, Cone)]
    X = np.array([(body.o, body.o + body.d) for body, _ in pairs])
    m = np.array([cone.inward_normal(points) for (_, cone), points in zip(pairs, X, strict=True)])
    gaps = [cone.s(points) - (body.r, body.r + body.dr) for (body, cone), points in zip(pairs, X, strict=True)]
    q = X - np.array([cone.apex for _, cone in pairs])[:, None]
    axes = np.array([cone.axis for _, cone in pairs])[:, None]
    w = np.linalg.norm(q - np.sum(q * axes, axis=-1, keepdims=True) * axes, axis=-1)
    cos = np.array([cone.sin_cos[1] for _, cone in pairs])[:, None]
    repeated = np.repeat(np.array(gaps)[:, :, None], 2, axis=2)
    return repeated, -m, np.linalg.norm(q, axis=-1), cos / (2 * np.maximum(w, 1e-9))


def _lower_extents(against: Sequence[Solid | Cone | Hull], n: Array) -> Array:
    """Return the smallest n.x of both ends of every side B, shape (N, 2); a region has only one value."""
    is_solid = np.array([isinstance(side, Solid) for side in against])
    extents = np.empty((len(against), 2))
    solids = ConeSpheres.of([side.body for side in against if isinstance(side, Solid)])
    extents[is_solid] = solids.extents(n[is_solid], -1)
    for row, side in enumerate(against):
        if isinstance(side, Hull):
            extents[row] = (side.mesh.vertices @ n[row]).min()
    return extents


def _units(v: Array) -> Array:
    """Return vectors, shape (..., 3), as unit vectors; zero stays zero."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(v / np.where(length > 0, length, 1.0))
