r"""Proven bounds on a design's clearances as functions of its build errors.

| symbol | meaning | unit |
|---|---|---|
| delta | largest error of a hinge angle | rad |
| delta_p | largest error of a module's centre and of p_E in addition to that of the hinges | l_arm |
| delta_e | largest reach of the airflow beyond its envelope | l_arm |
| A, B | the sides of a check, or one convex part of each; B may be a region, which moves with p_E | |
| X, r | points and radii of balls whose hull contains a side: end balls of a cone-sphere, or vertices | l_arm |
| n | unit vector from A to B at their nearest points; any unit vector is valid | |
| v, e | p_E from the COM, and its largest error | l_arm |
| kappa | largest change of v / \|v\|, if a region takes its direction from v | |

One module, the holder, carries the end-effector; the rod is bolted to it. Errors are relative to its frame, in
which p_E and its regions do not move. With any errors, both sides are still within hulls of balls, and no clearance
is less than the gap between planes normal to n:

    clearance >= min over balls of n . (X_B - X_A) - r_A - r_B - (displacements of X_A along n and of X_B against n)

Displacements are relative to the last module that the paths to both sides share, so common errors cancel. A rod is
bolted to the holder and ends at p_E; a bracket to both modules of its joint. By Dunkl and Williams, kappa <= 2 e /
(\|v\| + \|v'\|). For the allowed cone of a requirement, with q = X - apex, w its part perpendicular to the axis, m
the inward normal and u a displacement of q,

    s(q + u) >= s(q) - \|u\|,    s(q + u) >= s(q) + m . u - \|u\|^2 cos(theta) / (2 \|w\|),

and a turn of the axis by a chord kappa changes s(q) by at most \|q\| kappa. Nothing is linearised.

A rigid body has a bound without n first: its certified clearance, less the lengths of all displacements. Where that
is too weak, every two parts that must not touch get their own n, and so does every piece of the airflow.

The error of v is that of p_E less that of the COM. A counted rod moves by half of what its ends do. Its mass
follows its length, which moves the COM along the line to the rod's midpoint:

| symbol | meaning | unit |
|---|---|---|
| M, s_k | mass of the platform, share of a part | kg, - |
| d_k | displacement of a part's centre relative to p_E | l_arm |
| rho, h | mass of the rod per length, distance of its midpoint from the COM | kg / l_arm, l_arm |

    e = f + 2 rho delta_p (h + delta_p + f) / (M - 2 rho delta_p),    f = sum of s_k \|d_k\|

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
from itertools import product
from typing import NamedTuple

import numpy as np

from topo_search.model import PORT_DIRECTIONS, Array, Flags, Indices, Mount, needs_offset
from topo_search.model.exposure import EXPOSURE_KINDS
from verify.beside_airflow import normals, parts_of
from verify.bodies import AllowedCone, norms
from verify.certificate import BOUND_ROUNDING, Certificate, RoundBody, witnesses
from verify.compounds import Compound, proximities
from verify.cones import lowest_point
from verify.contacts import AnyCheck
from verify.convex import Convex, Cylinder
from verify.hulls import HullBody
from verify.requirements import Scene


class _Side(NamedTuple):
    """Points of a side of a row, or of many; the first axis of every array has one entry a point or is left out."""

    x: Array
    """Shape (P, 3)."""
    n: Array
    """Unit vectors towards the other side, or out of the cone, shape (P, 3)."""
    height: Array
    """Extents along n, of the ball around a point; minus the gap, in a cone."""
    carrier: Array
    """Module that carries a point; n for p_E."""
    shift: Array | float = 0.0
    """Largest displacement relative to the other side by errors of positions [delta_p]."""
    swing: Array | float = 0.0
    """Lever arm when p_E's direction changes."""
    bend: Array | float = 0.0
    """cos(theta) / (2 |w|) in a cone."""
    radius: Array | float = 0.0
    """Distance from the point within which all of a body lies that turns with it."""


class Levers:
    """The hinges of a platform, and the motion of points that its modules carry."""

    def __init__(self, scene: Scene, holder: int) -> None:
        """Compute the hinge axes; `holder` is the module whose frame is fixed."""
        topology = scene.design.topology
        n, l_c = topology.n, scene.design.task.connector_distances / scene.l_arm
        self.moves = np.zeros((n - 1, n + 1), dtype=bool)
        """[h, i]: hinge h, between module h + 1 and its parent, moves module i relative to the holder; none moves
        p_E, which is last."""
        self.axes, self.origins = np.zeros((n - 1, 3)), np.zeros((n - 1, 3))
        for h, i, a, _ in topology.edges():
            self.moves[:, i] = self.moves[:, h]
            self.moves[i - 1, i] = True
            self.axes[i - 1] = scene.R[h] @ np.eye(3)[1 if a % 2 == 0 else 0]
            self.origins[i - 1] = scene.centres[h] + l_c[h] * scene.R[h] @ PORT_DIRECTIONS[a]
        # A hinge between the root and the holder moves the root's side instead, in the opposite sense.
        reversed_hinges = self.moves[:, holder].copy()
        self.moves[:, :n] ^= reversed_hinges[:, None]
        self.axes[reversed_hinges] *= -1
        on_path = self.moves.sum(axis=0, dtype=float)
        self._depth = np.array([max(on_path[h], on_path[i]) for h, i, _, _ in topology.edges()])

    def motion(self, side: _Side, shared: Flags) -> Array:
        """Return L, S and C of points relative to the last module that two paths share, shape (P, 3).

        `shared` has the hinges on both paths, shape (P, H).
        """
        x, n, carrier, radius = side.x, side.n, side.carrier, np.broadcast_to(side.radius, len(side.x))
        motion = np.zeros((len(x), 3))
        step = max(1, 500_000 // max(1, len(self.moves)))  # lever arms in memory at a time
        for start in range(0, len(x), step):
            rows = slice(start, start + step)
            k, h = np.nonzero(self.moves[:, carrier[rows]].T & ~shared[rows])  # hinge h is on the path of point k
            arms = np.cross(self.axes[h], x[rows][k] - self.origins[h])
            rho = norms(arms) + radius[rows][k]
            t = np.abs(np.sum(arms * n[rows][k], axis=-1)) + radius[rows][k]
            order = self._depth[h] - shared[rows].sum(axis=1)[k]
            sums = [np.bincount(k, term, len(x[rows])) for term in (rho, t, (order - 0.5) * rho)]
            motion[rows] = np.stack(sums, axis=1)
        return motion

    def rates(self, x: Array, carrier: int, shared: Flags) -> Array:
        """Return a point's displacement per angle of each hinge, 0 for hinges off the path, shape (H, 3)."""
        on_path = self.moves[:, carrier] & ~shared
        return np.where(on_path[:, None], np.cross(self.axes, x - self.origins), 0.0)

    def centre_rates(self, centres: Array, weights: Array) -> Array:
        """Return the displacement of the weighted sum of module centres per angle of each hinge, shape (H, 3)."""
        moves = self.moves[:, :-1] * weights
        return np.cross(self.axes, moves @ centres - moves.sum(axis=1, keepdims=True) * self.origins)


PIECES = (0.0, 1 / 8, 1 / 4, 1 / 2, 1.0)
"""Ends, along the axis, of the pieces of airflow with normals of their own beside rigid parts."""


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
    """Shifts of the modules' centres, then of p_E, shape (n + 1, 3)."""


class Weakest(NamedTuple):
    """A check, its bound, and the errors that bring its sides closest together to first order."""

    bound: float
    """Bound on the clearance [l_arm]."""
    check: AnyCheck
    examples: tuple[Example, ...]
    """One or more, for the points of each side that errors bring closest."""


Sides = tuple[_Side, _Side]


class _Points(NamedTuple):
    """Coefficients of one side of N rows."""

    side: _Side
    first: Indices
    """Index of the first point of each row, shape (N,)."""
    motion: Array
    """L, S, C, shape (P, 3)."""

    @classmethod
    def of(cls, sides: Sequence[_Side], shared: Flags, levers: Levers) -> _Points:
        """Join the sides of rows, of which `shared` has the hinges on both paths, shape (N, H)."""
        counts = [len(side.x) for side in sides]

        def column(name: str) -> Array:
            parts = [getattr(side, name) for side in sides]
            # numbers hold for all points of a side
            return np.concatenate(
                [part if np.ndim(part) else np.full(k, part) for k, part in zip(counts, parts, strict=True)]
            )

        joined = _Side(*(column(name) for name in _Side._fields))
        first = np.concatenate([[0], np.cumsum(counts[:-1], dtype=np.intp)])
        on_both = np.repeat(shared, counts, axis=0)
        return cls(joined, first, levers.motion(joined, on_both))

    def without_direction(self) -> _Points:
        """Return the same points with bounds for any n."""
        L = self.motion[:, 0]
        return self._replace(motion=np.stack([L, L, 0.0 * L], axis=1))

    def reach(self, errors: Errors, kappa: float) -> Array:
        """Return the largest extents along n with errors, shape (P,)."""
        (L, S, C), (*_, shift, swing, bend, _) = self.motion.T, self.side
        far = errors.delta * L + errors.delta_p * shift
        along = errors.delta * S + errors.delta**2 * C + errors.delta_p * shift + bend * far * far
        turned = kappa * np.where(swing > 0, swing + far, 0.0)
        return np.asarray(self.side.height + np.minimum(far, along) + turned)

    def largest(self, errors: Errors, kappa: float) -> Array:
        """Return the largest extent of each row, shape (N,)."""
        return np.asarray(np.maximum.reduceat(self.reach(errors, kappa), self.first))

    def farthest(self, row: int, errors: Errors, kappa: float) -> set[int]:
        """Return the points of a row that reach farthest without errors and with them."""
        end = self.first[row + 1] if row + 1 < len(self.first) else len(self.motion)
        points = slice(self.first[row], end)
        reaches = self.reach(Errors(), 0.0)[points], self.reach(errors, kappa)[points]
        return {int(self.first[row] + np.argmax(reach)) for reach in reaches}


class _Table(NamedTuple):
    """Coefficients of the bounds of N rows."""

    A: _Points
    B: _Points
    airflows: Array
    """Number of sides that are airflow, shape (N,)."""
    shared: Flags
    """Hinges on the paths to both sides, shape (N, H)."""

    def bounds(self, errors: Errors, kappa: float) -> Array:
        """Return the smallest gap of each row with errors, shape (N,)."""
        reach = self.A.largest(errors, kappa) + self.B.largest(errors, kappa)
        return np.asarray(-reach - self.airflows * errors.delta_e)


class Tolerance:
    """Bounds on a design's clearances under build errors."""

    def __init__(self, scene: Scene, checks: Sequence[tuple[AnyCheck, Certificate]], mount: Mount | None) -> None:
        """Tabulate certified checks, of which there must be one; without a mount the root holds p_E."""
        self.scene, self.mount, n = scene, mount, scene.design.topology.n
        self._holder, self._tip = 0 if mount is None else mount.module, n
        self._levers = Levers(scene, self._holder)
        self._v = float(np.linalg.norm(scene.offset))
        simple = [check for check, _ in checks if not isinstance(check.body, Compound)]
        rigid = [pair for pair in checks if isinstance(pair[0].body, Compound)]
        self._checks, self._rigid = [*simple, *(check for check, _ in rigid)], len(simple)
        self._tables = [self._table(simple, self._simple_rows(simple))] if simple else []
        if rigid:
            self._tables.append(self._plain_table(rigid))
        self._by_parts = dict[int, _Table]()
        self._set_masses()
        self._nominal = self._first_bounds(Errors())

    def _set_masses(self) -> None:
        """Set what moves the centre of mass relative to p_E, as shares of the platform's mass."""
        scene, task, n, levers = self.scene, self.scene.design.task, self._tip, self._levers
        M, end_effector = task.total_mass(n), task.end_effector
        holders = [h for h, _, _, _ in scene.design.topology.bolts]
        of_modules = np.array([module.mass for module in task.modules_of_nodes])
        masses = np.concatenate([of_modules, np.full(len(holders), task.module.joint_mass)]) / M
        joints = scene.centres[holders] + (scene.platform.joints - scene.platform.o[holders]) / scene.l_arm
        points = np.concatenate([scene.centres, joints])
        side = _Side(points, np.zeros_like(points), np.zeros(len(points)), np.array([*range(n), *holders]))
        self._share, self._weights = task.module.mass / M, of_modules / task.module.mass
        self._turning = float(masses @ levers.motion(side, np.zeros((len(points), n - 1), dtype=bool))[:, 0])
        rod, counted = scene.platform.rod, end_effector.counted_rod
        self._rod_share = 0.0 if counted is None else counted.mass / M
        self._density = 0.0 if counted is None else end_effector.rod_linear_density * scene.l_arm / M
        self._shifting = 2 * float(masses.sum()) + self._rod_share
        self._rod_middle = rod[0, 0] / scene.l_arm if len(rod) else np.zeros(3)
        self._rod_direction = _units(rod[0, 1]) if len(rod) else np.zeros(3)
        self._tip_share = 1.0 - end_effector.mass / M - self._rod_share / 2

    def _carriers(self, check: AnyCheck) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return the modules that carry the sides of a check; n stands for p_E."""
        kind, a, b, rod = check.kind, check.a, check.b, (self._holder, self._tip)
        if kind in ("bracket-airflow", "bracket-rotor"):
            return (b,), (self.scene.design.topology.parents[a], a)
        beside = b if kind in ("airflow", "separation", "body", "rotor-airflow", "rod-airflow") else self._tip
        return rod if kind in ("rod-airflow", "rod-region") else (a,), rod if kind == "rod" else (beside,)

    def _table(self, checks: Sequence[AnyCheck], rows: Sequence[Sides]) -> _Table:
        """Return the table of rows and their checks."""
        carriers = [(*A, *B) for A, B in map(self._carriers, checks)]
        shared = np.array([self._levers.moves[:, modules].all(axis=1) for modules in carriers])
        A, B = (_Points.of(sides, shared, self._levers) for sides in zip(*rows, strict=True))
        kinds = [check.kind for check in checks]
        airflows = [(kind == "airflow") + kind.endswith("airflow") + (kind in EXPOSURE_KINDS) for kind in kinds]
        return _Table(A, B, np.array(airflows), shared)

    def _plain_table(self, checks: Sequence[tuple[AnyCheck, Certificate]]) -> _Table:
        """Return the table of bounds without n: the clearance less the lengths of all displacements."""
        places, rows = np.concatenate([self.scene.centres, self.scene.tip[None]]), list[Sides]()
        for check, certificate in checks:
            gap = min(certificate.analytic, 0.0) if certificate.lower is None else certificate.lower
            sides = []
            for body, carriers, height in zip(
                (check.body, check.against), self._carriers(check), (-gap, 0.0), strict=True
            ):
                x = places[list(carriers)]
                radius = np.array([_farthest(body, centre) for centre in x])
                zeros = np.zeros(len(x))
                sides.append(_Side(x, np.zeros_like(x), zeros + height, np.array(carriers), radius=radius))
            if self._follows_offset(check):
                turning = _farthest(
                    check.body if isinstance(check.against, AllowedCone) else check.against, self.scene.tip
                )
                sides[0] = sides[0]._replace(swing=turning)
            rows.append((sides[0]._replace(shift=2.0), sides[1]))
        table = self._table([check for check, _ in checks], rows)
        return table._replace(A=table.A.without_direction(), B=table.B.without_direction())

    def _simple_rows(self, checks: Sequence[AnyCheck]) -> list[Sides]:
        """Return one row per check of a cone-sphere."""
        pairs = [(check.body, check.against) for check in checks if not isinstance(check.against, AllowedCone)]
        found = witnesses(pairs)
        return [
            self._cone_row(check, check.body)
            if isinstance(check.against, AllowedCone)
            else self._row(check, check.body, check.against, next(found).n)
            for check in checks
        ]

    def _rows_by_parts(self, check: AnyCheck) -> list[Sides]:
        """Return one row for every two parts that must not touch."""
        A, B = check.body, check.against
        if isinstance(B, AllowedCone):
            return [self._cone_row(check, part) for part in A.parts]
        if isinstance(B, RoundBody):
            pieces = [RoundBody(piece) for piece in B.body.cut(PIECES)]
            facing = zip(parts_of(check), normals(check, pieces), strict=True)
            return [
                self._row(check, part, piece, n)
                for part, n_of in facing
                for piece, n in zip(pieces, n_of, strict=True)
            ]
        (proximity,) = proximities([(A, B)], [check.bolted])
        indices = np.argwhere(proximity.relevant).tolist()
        return [self._row(check, A.parts[i], B.parts[j], proximity.normals[i, j]) for i, j in indices]

    def _row(self, check: AnyCheck, A: AnyConvex, B: AnyConvex, n: Array) -> Sides:
        """Return the row of two convex sides or parts."""
        carriers_A, carriers_B = self._carriers(check)
        side_A, side_B = _side(A, n, carriers_A)._replace(shift=2.0), _side(B, -n, carriers_B)
        if self._follows_offset(check):  # all of the region turns about p_E
            side_B = side_B._replace(swing=norms(side_B.x - self.scene.tip))
        # a rod's far end moves less, relative to p_E, or to its own module, the nearer it is
        if check.kind == "rod-region":
            side_A = side_A._replace(shift=np.tile([2.0, self._near_end(side_A.x)], len(carriers_A)))
        elif check.kind == "rod" and check.a == self._holder:
            side_A = side_A._replace(shift=0.0)
            side_B = side_B._replace(shift=np.tile([self._near_end(side_B.x), 2.0], len(carriers_B)))
        return side_A, side_B

    def _near_end(self, x: Array) -> float:
        """Return the largest displacement of a rod's end beside its tip or fitting, of length F: F |u' - u|."""
        assert self.mount is not None
        length = self.scene.straight_rod(self.mount).length
        return min(2.0, 4 * (length - float(np.linalg.norm(x[1] - x[0]))) / length)

    def _cone_row(self, check: AnyCheck, A: AnyConvex) -> Sides:
        """Return the row of a convex side or part in a cone."""
        cone, (carriers, _) = check.against, self._carriers(check)
        towards = -cone.inward_normal(lowest_point(A, cone)) if isinstance(A, Cylinder) else cone.axis
        side = _side(A, towards, carriers)
        q, radius = side.x - cone.apex, side.height - side.x @ towards
        w = norms(q - (q @ cone.axis)[:, None] * cone.axis)
        shift = np.tile([2.0, self._near_end(side.x)], len(carriers)) if check.kind == "rod-region" else 2.0
        side = side._replace(
            n=-cone.inward_normal(side.x),
            height=radius - cone.s(side.x),
            shift=shift,
            swing=norms(q) if self._follows_offset(check) else 0.0,
            bend=cone.sin_cos[1] / (2 * np.maximum(w, 1e-9)),
        )
        return side, _Side(cone.apex[None], np.zeros((1, 3)), np.zeros(1), np.array([self._tip]))

    def _follows_offset(self, check: AnyCheck) -> bool:
        """True if a check is about a region that takes its direction from v."""
        is_region = check.kind in (*EXPOSURE_KINDS, "part-region", "rod-region")
        return is_region and needs_offset(self.scene.design.task.exposure[check.b])

    def _kappa(self, errors: Errors) -> float:
        f = errors.delta * self._turning + errors.delta_p * self._shifting
        mass = 2 * self._density * errors.delta_p
        e = f + mass * (float(np.linalg.norm(self._rod_middle)) + errors.delta_p + f) / (
            1 - min(mass, self._rod_share)
        )
        return min(2.0, 2 * e / (2 * self._v - e)) if e < self._v else 2.0

    def _first_bounds(self, errors: Errors) -> Array:
        """Return bounds of all checks, those of rigid bodies without n."""
        return np.concatenate([table.bounds(errors, self._kappa(errors)) for table in self._tables])

    def _table_of(self, k: int) -> tuple[_Table, slice]:
        """Return the table of a check and its rows; a rigid body that is clear has rows by parts."""
        if k < self._rigid:
            return self._tables[0], slice(k, k + 1)
        if not self._nominal[k] > 0:
            return self._tables[-1], slice(k - self._rigid, k - self._rigid + 1)
        if k not in self._by_parts:
            rows = self._rows_by_parts(self._checks[k])
            self._by_parts[k] = self._table([self._checks[k]] * len(rows), rows)
        return self._by_parts[k], slice(None)

    def _bound(self, k: int, first: float, errors: Errors) -> float:
        """Return the bound of check k, whose first bound is given."""
        if k < self._rigid:
            return first
        table, rows = self._table_of(k)
        return max(first, float(table.bounds(errors, self._kappa(errors))[rows].min()))

    def is_clear(self, errors: Errors) -> bool:
        """Return whether every check is proven clear."""
        first = self._first_bounds(errors)
        if not np.all(first[: self._rigid] > BOUND_ROUNDING):
            return False
        return all(self._bound(k, first[k], errors) > BOUND_ROUNDING for k in self._up_to(first, BOUND_ROUNDING))

    @staticmethod
    def _up_to(bounds: Array, largest: float) -> list[int]:
        """Return the indices of bounds that do not exceed `largest`, the smallest first."""
        order = np.argsort(bounds, kind="stable")
        return [int(k) for k in order if not bounds[k] > largest]

    def weakest(self, errors: Errors) -> Weakest:
        """Return the check with the smallest bound."""
        first = self._first_bounds(errors)
        weakest, bound = 0, np.inf
        for k in self._up_to(first, np.inf):
            if first[k] >= bound:
                break
            if (own := self._bound(k, first[k], errors)) < bound:
                weakest, bound = k, own
        return self._example(weakest, float(bound), errors)

    def checks_up_to(self, errors: Errors, largest: float) -> Iterator[Weakest]:
        """Yield all checks whose bound is at most `largest`, the weakest first."""
        first = self._first_bounds(errors)
        bounds = {k: self._bound(k, first[k], errors) for k in self._up_to(first, largest)}
        for k in sorted(bounds, key=bounds.__getitem__):
            if bounds[k] <= largest:
                yield self._example(k, float(bounds[k]), errors)

    def _example(self, k: int, bound: float, errors: Errors) -> Weakest:
        check, kappa, (table, rows) = self._checks[k], self._kappa(errors), self._table_of(k)
        row = int(np.arange(len(table.shared))[rows][np.argmin(table.bounds(errors, kappa)[rows])])
        A, B, shared = table.A.side, table.B.side, table.shared[row]
        carriers_A, carriers_B = self._carriers(check)
        sides = sorted([(carriers_A, 1.0), (carriers_B, -1.0)], key=lambda side: -len(side[0]))
        examples = []
        for a, b in product(*(points.farthest(row, errors, kappa) for points in (table.A, table.B))):
            n, gradient = A.n[a], self._com_gradient(check, A.x[a], B.x[b], A.n[a])
            turns = self._levers.rates(A.x[a], int(A.carrier[a]), shared) @ n
            turns -= self._levers.rates(B.x[b], int(B.carrier[b]), shared) @ n
            turns -= self._share * self._levers.centre_rates(self.scene.centres, self._weights) @ gradient
            shifts = np.outer(np.append(self._weights, 0.0), -self._share * gradient)
            along_rod = self._density * (self._rod_middle @ gradient) * self._rod_direction
            shifts[self._tip] = self._tip_share * gradient - along_rod
            shifts[self._holder] += along_rod - self._rod_share / 2 * gradient
            # a module that carries one side and part of the other moves with the former
            moved = {carrier: sign for carriers, sign in sides for carrier in carriers}
            for carrier, sign in moved.items():
                shifts[carrier] += sign * n
            examples.append(Example(np.sign(turns), _units(shifts)))
        unique = {b"".join(errors.tobytes() for errors in example): example for example in examples}
        return Weakest(bound, check, tuple(unique.values()))

    def _com_gradient(self, check: AnyCheck, x_A: Array, x_B: Array, n: Array) -> Array:
        """Return the gradient of a clearance with respect to a shift of the COM only, shape (3,).

        The shift turns v, and an axis along v changes by minus the shift's part perpendicular to v, over |v|.
        """
        if not self._follows_offset(check):
            return np.zeros(3)
        along = self.scene.offset / self._v
        if isinstance(check.against, AllowedCone):
            cone = check.against
            sin, cos = cone.sin_cos
            q = x_A - cone.apex
            w = q - (q @ cone.axis) * cone.axis
            rho = float(np.linalg.norm(w))
            gradient = (sin + cos * float(q @ cone.axis) / rho if rho > 0 else sin) * w  # ds / d(axis), across it
        else:
            gradient = -float(np.linalg.norm(x_B - self.scene.tip)) * n
        return np.asarray(gradient - (gradient @ along) * along) / self._v


AnyConvex = RoundBody | HullBody | Convex


def _balls(body: AnyConvex, n: Array) -> tuple[Array, Array | float]:
    """Return points and radii of balls whose hull contains a body and reaches as far along n."""
    if isinstance(body, RoundBody):
        solid = body.body
        return np.stack([solid.o, solid.o + solid.d]), np.array([solid.r, solid.r + solid.dr])
    if isinstance(body, HullBody):
        return body.mesh.vertices, 0.0
    return (body.outer(n).vertices, 0.0) if isinstance(body, Cylinder) else (body.vertices, body.ball)


def _side(body: AnyConvex, n: Array, carriers: Sequence[int]) -> _Side:
    x, r = _balls(body, n)
    k, P = len(carriers), len(x)
    return _Side(np.tile(x, (k, 1)), np.broadcast_to(n, (k * P, 3)), np.tile(x @ n + r, k), np.repeat(carriers, P))


def _farthest(body: Compound | AnyConvex | AllowedCone, x: Array) -> float:
    """Return an upper bound on the distance of a body's points from x; 0 for a cone, which nothing turns."""
    if isinstance(body, AllowedCone):
        return 0.0
    if isinstance(body, Compound):
        return float(np.linalg.norm(body.bounds.centre - x)) + body.bounds.radius
    if isinstance(body, RoundBody):
        return float(np.linalg.norm(body.body.o - x)) + body.body.extent
    assert isinstance(body, HullBody)
    return float(norms(body.mesh.vertices - x).max())


def _units(v: Array) -> Array:
    """Return vectors, shape (..., 3), as unit vectors; zero stays zero."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(v / np.where(length > 0, length, 1.0))
