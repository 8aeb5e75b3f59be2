"""Numeric poses and exact clearances, for random starts and for checking designs; lengths in metres.

| symbol | meaning | shape | unit |
|---|---|---|---|
| R, p | orientations and positions of all modules in W | (n,3,3), (n,3) | -, m |
| P(eta) = o + eta d, r_0 + eta dr | axis and radius of a swept ball | (...,3), scalars | m |

Hinge ranges are the clear folds of a task. A fold is a hinge angle with a sign that depends on the parent's port
(`topo_search.model.folds`).

| symbol | meaning | shape | unit |
|---|---|---|---|
| alpha | hinge angles of the modules 1..n-1 | (n-1,) | rad |
| phi | folds, SPLAY alpha | (n-1,) | rad |

If a task has a set of angles, each one in a clear fold is a fold of zero width. A set has both signs of each angle,
so it is the same for hinges and folds.

Force and torque of a module's rotors (`topo_search.model.rotors`):

| symbol | meaning | shape | unit |
|---|---|---|---|
| delta_q, a_q | position and axis of rotor q in the module's frame | (3,) each | l_arm, - |
| s_q | its spin: 1 if it turns counter-clockwise seen against its thrust, else -1 | scalar | |
| m_i | torque of module i about its centre, in its own frame | (3,) | l_arm m g |

m_i = sum_q (u_iq / r) (delta_q x a_q - s_q k_tau / (k_f l_arm) a_q), with r rotors and u_iq in u_hover.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from topo_search.model import PORT_DIRECTIONS, AirflowEnvelope, Array, Indices, ResolvedTask, Topology
from topo_search.model.folds import FOLD, Folds, nearest_fold
from topo_search.model.shape import Hull

QUARTER_TURNS = np.array(
    [[[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]] for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
)
"""Rz(kappa pi/2) for kappa = 0..3."""
YZX, ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])
"""Indices that move the components of a vector."""


def cross(a: Array, b: Array) -> Array:
    """Return a x b of vectors (..., 3), several times faster than NumPy."""
    return np.asarray(a.take(YZX, -1) * b.take(ZXY, -1) - a.take(ZXY, -1) * b.take(YZX, -1))


def rotation(axis: ArrayLike, angle: float) -> Array:
    """Return the rotation about a unit axis (Rodrigues' formula)."""
    x, y, z = np.asarray(axis, dtype=float)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K))


def root_rotation(root: ArrayLike) -> Array:
    """Return Rz(psi) Rx(alpha_0) Ry(alpha_1)."""
    psi, alpha_0, alpha_1 = np.asarray(root, dtype=float)
    return np.asarray(rotation([0, 0, 1], psi) @ rotation([1, 0, 0], alpha_0) @ rotation([0, 1, 0], alpha_1))


def root_angles(R: Array) -> Array:
    """Return psi in +-pi, alpha_0 in +-pi/2 and alpha_1 in +-pi of a rotation."""
    psi = np.arctan2(-R[0, 1], R[1, 1])
    alpha_0 = np.arctan2(R[2, 1], np.hypot(R[0, 1], R[1, 1]))
    x, _, z = np.array([np.cos(psi), np.sin(psi)]) @ R[:2]  # first row of Rx(alpha_0) Ry(alpha_1)
    return np.array([psi, alpha_0, np.arctan2(z, x)])


def poses(topology: Topology, R_root: Array, alpha: Array, l_c: Array | float) -> tuple[Array, Array]:
    """Return R and p of all modules for hinge angles alpha (n-1,) [rad], and l_c, one or (n,)."""
    n, edges = topology.n, list(topology.edges())
    l_c = np.broadcast_to(l_c, n)
    ports = np.array([a for _, _, a, _ in edges], dtype=int)
    hinges = _hinge_rotations(ports, np.asarray(alpha, dtype=float))
    rotations = hinges @ QUARTER_TURNS[np.array(topology.kappas[1:], dtype=int)]
    outwards, own, parents = PORT_DIRECTIONS[ports], l_c[1:, None], l_c[list(topology.parents[1:])][:, None]
    arms = own * (outwards + np.einsum("iab,ib->ia", hinges, outwards)) + (parents - own) * outwards
    R, p = np.empty((n, 3, 3)), np.zeros((n, 3))
    R[0] = R_root
    for (h, i, _, _), turn, arm in zip(edges, rotations, arms, strict=True):
        p[i] = p[h] + R[h] @ arm
        R[i] = R[h] @ turn
    return R, p


def _hinge_rotations(ports: Indices, alpha: Array) -> Array:
    """Return the rotations about the hinges in their parents' frames: about y on the ports +-x, else about x."""
    cosine, sine, about_y = np.cos(alpha), np.sin(alpha), ports % 2 == 0
    R = np.zeros((len(alpha), 3, 3))
    R[:, 0, 0], R[:, 1, 1], R[:, 2, 2] = np.where(about_y, cosine, 1.0), np.where(about_y, 1.0, cosine), cosine
    R[:, 0, 2], R[:, 2, 0] = np.where(about_y, (sine, -sine), 0.0)
    R[:, 2, 1], R[:, 1, 2] = np.where(about_y, 0.0, (sine, -sine))
    return R


@dataclass(frozen=True)
class Swept:
    """Balls swept along segments with linearly growing radius: symbolic, or arrays whose shapes broadcast."""

    o: Any
    d: Any
    r_0: float
    dr: float = 0.0

    @property
    def end_radius(self) -> float:
        """Radius at eta = 1."""
        return self.r_0 + self.dr


class Ball(Swept):
    """A single ball."""

    def __init__(self, o: Any, radius: float) -> None:
        super().__init__(o, 0.0 * o, radius)


def envelopes(airs: Sequence[Sequence[AirflowEnvelope]], R: Array, p: Array) -> Swept:
    """Return the airflow envelopes of modules with orientations R (n,3,3) and centres p (n,3) [m].

    Args:
        airs: envelopes of each module, in its frame.
        R: orientations.
        p: centres.
    """
    of = [(i, air) for i, own in enumerate(airs) for air in own]
    nodes = [i for i, _ in of]
    sizes: Any = np.array([(air.length, air.start_radius, air.growth) for _, air in of]).reshape(-1, 3).T
    places = np.array([(air.origin, air.upstream) for _, air in of]).reshape(-1, 2, 3)
    o, upstream = np.einsum("kij,kpj->pki", R[nodes], places)
    return Swept(p[nodes] + o, -sizes[0][:, None] * upstream, sizes[1], sizes[2])


def clearance(first: Swept, second: Swept) -> Array:
    """Return a clearance with the exact sign of min ||P_i - P_j|| - r_i - r_j [m].

    It is the gap at the minimiser of f = ||P_i - P_j||^2 - (r_i + r_j)^2 over [0, 1]^2, which is among f's
    stationary point, the stationary points of its edges, and its corners. f and the gap have the same sign
    everywhere, so the gap there is negative exactly if the smallest gap is, and it is never below the smallest gap.
    """
    w = first.o - second.o
    r = first.r_0 + second.r_0
    A = _dot(first.d, first.d) - first.dr**2
    B = _dot(second.d, second.d) - second.dr**2
    C = -2 * (_dot(first.d, second.d) + first.dr * second.dr)
    D = 2 * _dot(first.d, w) - 2 * r * first.dr
    E = -2 * _dot(second.d, w) - 2 * r * second.dr
    det = 4 * A * B - C**2
    candidates: list[tuple[Array | float, Array | float]]
    candidates = [(_ratio(C * E - 2 * B * D, det), _ratio(C * D - 2 * A * E, det))]
    candidates += [(_ratio(-(C * gamma + D), 2 * A), gamma) for gamma in (0.0, 1.0)]
    candidates += [(eta, _ratio(-(C * eta + E), 2 * B)) for eta in (0.0, 1.0)]
    candidates += [(eta, gamma) for eta in (0.0, 1.0) for gamma in (0.0, 1.0)]
    f_min, reach = np.full(w.shape[:-1], np.inf), np.zeros(w.shape[:-1])
    for eta, gamma in candidates:
        f = (A * eta + C * gamma + D) * eta + (B * gamma + E) * gamma
        smaller = f < f_min
        f_min = np.where(smaller, f, f_min)
        reach = np.where(smaller, r + eta * first.dr + gamma * second.dr, reach)
    distance_squared = np.maximum(0.0, f_min + _dot(w, w) - r**2 + reach**2)
    return np.asarray(np.sqrt(distance_squared) - reach)


def cone_clearance(envelope: Swept, apex: Array, axis: Array, half_angle: float) -> Array:
    """Return the smaller s - r of both end balls: positive inside the cone, a negative violation outside [m]."""
    gaps = []
    for eta in (0.0, 1.0):
        q = envelope.o + eta * envelope.d - apex
        along = _dot(q, axis)
        across = np.linalg.norm(q - along[..., None] * axis, axis=-1)
        gaps.append(along * np.sin(half_angle) - across * np.cos(half_angle) - envelope.r_0 - eta * envelope.dr)
    return np.asarray(np.minimum(*gaps))


def cone_reach(envelopes: Swept, centre: Array, upstream: Array, half_angle: float) -> float:
    """Return the distance upstream of a centre at which an apex's cone just contains all envelopes [m].

    There `cone_clearance` vanishes: (reach - h) sin(theta) - rho cos(theta) = r for the critical end ball, with h
    its height upstream of the centre and rho its distance from the axis.
    """
    reaches = []
    for eta in (0.0, 1.0):
        q = envelopes.o + eta * envelopes.d - centre
        h = q @ upstream
        rho = np.linalg.norm(q - h[:, None] * upstream, axis=1)
        r = envelopes.r_0 + eta * envelopes.dr
        reaches.append(np.max(h + (rho * np.cos(half_angle) + r) / np.sin(half_angle)))
    return float(max(reaches))


def hull_clearance(envelope: Swept, corner: Array, hull: Hull) -> Array:
    """Return the clearance of n envelopes from a hull, with its exact sign [m].

    Outside the hull the nearest point is on an edge, or inside a face and then nearest to an end of the axis, since
    the distance from a plane is linear. If the axis enters the hull, the largest radius inside counts, too; balls
    further along may reach deeper into the hull.

    Args:
        envelope: the envelopes, `o` and `d` of shape (n, 3).
        corner: position of the hull's origin, shape (3,).
        hull: the hull.
    """
    a, b = hull.corners[hull.edges].transpose(1, 0, 2)
    local = Swept((envelope.o - corner)[:, None], envelope.d[:, None], envelope.r_0, envelope.dr)
    smallest = clearance(local, Swept(a, b - a, 0.0)).min(axis=1)
    heights = [(local.o[:, 0] + eta * envelope.d) @ hull.normals.T - hull.offsets for eta in (0.0, 1.0)]  # (n, f)
    for eta, height in enumerate(heights):
        face = height.argmax(axis=1)
        gap = height.max(axis=1)
        foot = local.o[:, 0] + eta * envelope.d - gap[:, None] * hull.normals[face]
        on_face = (gap > 0) & np.all(foot @ hull.normals.T <= hull.offsets + 1e-12, axis=1)
        smallest = np.where(on_face, np.minimum(smallest, gap - envelope.r_0 - eta * envelope.dr), smallest)
    slope = heights[1] - heights[0]
    crossing = -heights[0] / np.where(slope == 0, 1.0, slope)
    enters = np.max(np.where(slope < 0, crossing, 0.0), axis=1, initial=0.0)
    leaves = np.min(np.where(slope > 0, crossing, 1.0), axis=1, initial=1.0)
    pierced = (enters <= leaves) & ~np.any((slope == 0) & (heights[0] > 0), axis=1)
    deepest = np.where(pierced, -envelope.r_0 - leaves * envelope.dr, np.inf)
    return np.asarray(np.minimum(smallest, deepest))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _ratio(numerator: Array, denominator: Array) -> Array:
    """Return numerator / denominator clipped to [0, 1]; 0 if the denominator is 0."""
    safe = np.where(denominator == 0, 1.0, denominator)
    return np.asarray(np.clip(np.where(denominator == 0, 0.0, numerator / safe), 0.0, 1.0))


SPLAY = np.array(FOLD)
"""Sign of the hinge angle that turns the airflow of a child on port +x, +y, -x, -y away from its parent's."""


def signs(topology: Topology) -> Array:
    """Return the sign of every hinge's fold at a positive angle, shape (n-1,)."""
    return np.asarray(SPLAY[[a for _, _, a, _ in topology.edges()]])


def allowed_folds(task: ResolvedTask, margin: float = 0.0) -> Folds:
    """Return the allowed folds of hinges: the clear ones, or the angles of the task's set in them [rad].

    Args:
        task: the task.
        margin: smallest clearance of rotors from a neighbour's parts and airflow [m].
    """
    clear, angles = task.folds(margin), task.search.hinge_set_deg
    if angles is None:
        return clear
    single = map(math.radians, angles)
    return tuple((angle, angle) for angle in single if any(low <= angle <= high for low, high in clear))


def nearest_angles(task: ResolvedTask, topology: Topology, alpha: Array) -> Array:
    """Return the nearest allowed angle of each hinge; 0 if none is allowed."""
    sign = signs(topology)
    return sign * nearest_fold(allowed_folds(task, task.search.margin), sign * alpha)


def ranges(task: ResolvedTask, topology: Topology, alpha: Array | None = None) -> tuple[list[float], list[float]]:
    """Return the range of every hinge angle, for the allowed fold nearest to alpha or over all folds [rad].

    Without an allowed fold both limits are 0, and the check of the result reports a violation.
    """
    sign, folds = signs(topology), allowed_folds(task, task.search.margin) or ((0.0, 0.0),)
    low, high = np.full_like(sign, folds[0][0]), np.full_like(sign, folds[-1][1])
    if alpha is not None:
        phi = sign * nearest_angles(task, topology, alpha)
        for fold_low, fold_high in folds:
            inside = (fold_low <= phi) & (phi <= fold_high)
            low[inside], high[inside] = fold_low, fold_high
    return np.minimum(sign * low, sign * high).tolist(), np.maximum(sign * low, sign * high).tolist()


def largest_turn(task: ResolvedTask) -> float:
    """Return the largest allowed hinge angle of either sign [rad]; 0 if none is allowed."""
    turns = (max(-low, high) for low, high in allowed_folds(task, task.search.margin))
    return max(turns, default=0.0) + 0.0  # not -0.0, which NumPy's generators refuse as a range


def fold_excess(task: ResolvedTask, topology: Topology, alpha: Array) -> Array:
    """Return the excess of every hinge angle over its allowed folds, without margin: negative inside [rad]."""
    phi, folds = signs(topology) * alpha, allowed_folds(task)
    if not folds:
        return np.full_like(phi, np.pi)
    low, high = np.array(folds).T[:, :, None]
    return np.asarray(np.min(np.maximum(low - phi, phi - high), axis=0))


def rotor_maps(task: ResolvedTask) -> tuple[Array, Array]:
    """Return the matrices from the inputs of each module to its force in its own frame and to m_i, (n, 3, r) each.

    Rotors that a module lacks have columns of zeros.
    """
    unit, maps = task.module, np.zeros((2, task.n, 3, task.rotors_per_module))
    for module, nodes in task.placed_types:
        rotors, r = module.rotor_table, module.rotor_table.count
        gains = (module.thrust_coefficient / unit.thrust_coefficient * rotors.gains)[:, None]
        levers = module.arm_length / unit.arm_length * rotors.positions
        drags = module.torque_coefficient / (unit.thrust_coefficient * unit.arm_length) * rotors.drags[:, None]
        forces, torques = gains * rotors.axes, gains * np.cross(levers, rotors.axes) + drags * rotors.axes
        maps[0, nodes, :, :r], maps[1, nodes, :, :r] = (x.T / unit.rotor_table.count for x in (forces, torques))
    return maps[0], maps[1]
