r"""Bounds on how far hinge angle errors can move what the modules carry.

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

from dataclasses import dataclass

import numpy as np

from topo_search.model import Topology
from topo_search.model.layout import PORT_DIRECTIONS
from verify.bodies import Array
from verify.kinematics import Poses
from verify.meshes import Indices

CHUNK = 500_000
"""Arms that are held at a time."""


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

    def __init__(self, topology: Topology, poses: Poses, points: Array, half_step: float, holder: int) -> None:
        """Find the hinges.

        Args:
            topology: the tree.
            poses: where the design puts the modules; only their orientations are used.
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
            axes[i - 1] = poses.R[h] @ np.eye(3)[1 if a % 2 == 0 else 0]
            on_axes[i - 1] = points[h, 0] + half_step * poses.R[h] @ PORT_DIRECTIONS[a]
        # Seen from beyond a hinge, what is before it moves, and the other way round.
        beyond = self.moves[:, holder].copy()
        self.moves ^= beyond[:, None]
        axes[beyond] *= -1
        arms = np.cross(axes[:, None, None], points[None] - on_axes[:, None, None])
        self._arms = arms.transpose(1, 0, 2, 3)  # (n, H, 2, 3)
        self._rho = np.linalg.norm(self._arms, axis=-1)
        on_path = self.moves.sum(axis=0, dtype=float)
        self._depth = np.array([max(on_path[h], on_path[i]) for h, i, _, _ in topology.edges()])

    def motion(self, carrier: Indices, held: Indices, ends: Indices, n: Array) -> Motion:
        """Return how far points can move along n, seen from the last module that two paths from the holder share.

        Args:
            carrier: the module that carries the point, shape (N,).
            held: the module at the other end of the path, shape (N,).
            ends: which two of the carrier's points, shape (2,).
            n: unit vectors, shape (N, 2, 3).
        """
        L, S, C = (np.zeros((len(carrier), 2)) for _ in range(3))
        step = max(1, CHUNK // max(1, len(self.moves)))
        for start in range(0, len(carrier), step):
            rows = slice(start, start + step)
            i, j = carrier[rows], held[rows]
            shared = (self.moves[:, i] & self.moves[:, j]).sum(axis=0)
            k, h = np.nonzero((self.moves[:, i] & ~self.moves[:, j]).T)  # hinge h is on the path of row k
            rho = self._rho[i[k], h][:, ends]
            t = np.sum(self._arms[i[k], h][:, ends] * n[rows][k], axis=-1)
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
