"""A task and a tree as plain numbers for the check of a proof, derived from the model alone.

Lengths in l_arm, forces in the greatest thrust F of a rotor, inputs in the greatest input u_max, efforts in
lambda_max u_max^2.

| symbol | meaning | shape |
|---|---|---|
| n, K | modules, load cases | |
| A | angles, n + 2: psi, alpha_0, alpha_1, then the hinge of every module but the root | |
| f_k | total force of load case k, f_E + f_C | (K, 3) |
| t_k, h_k, g_k | its torque about the origin of W is t_k + sum_i c_i x h_k + p'_E x g_k | (K, 3) each |
| n_r | outward normal of the half-space that row r keeps an end of an envelope in | (W, 3) |
| c_i | moment of module i and half of each of its joints, over their mean mass: p_i without joint mass | (3,) |
| C | centre of mass of all modules and joints, the mean of the c_i | (3,) |
| kappa | m_E / (m_t - m_E) | |

With p'_E free, p_COM = (C + kappa p'_E) / (1 + kappa), so g_k = f_E + (m_E / m_t) f_C, h_k = f_C / (n (1 + kappa)).
With p_E fixed from the COM, p_COM = C + kappa p_E and p'_E = C + (1 + kappa) p_E, so g_k = 0 and h_k = f_k / n.

**What a clear audit lets pass** (`topo_search.model.search`): the force is off by e = TOLERANCE m_t g; so are, in
l_arm, the torques about the COM and about p_E. Torque changes linearly with the point that it is about, and C is on
the line through both: off by (1 + 2 kappa) e about C, and by |C| e more about the origin. Inputs are
between `min_input` - TOLERANCE and 1 + TOLERANCE, of a dead rotor within TOLERANCE of 0, hinges within pi/2 +
TOLERANCE, a fixed p_E within TOLERANCE l_arm.

Of a wrench that an audit finds inputs for by itself, as for hover and other centres of reserves, each component is
off by e, of the torque about the COM alone, or where that may be in error. That is sqrt(3) e of the force, and
sqrt(3) (1 + kappa |p_E| + sqrt(3) com_error) e of the torque about C, which is kappa p_E from the COM.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from topo_search.model import Allowed, Exterior, ResolvedTask, Topology
from topo_search.model.arrays import PORT_DIRECTIONS, ROTOR_DIRECTIONS, ROTOR_SPINS
from topo_search.model.compiled_code import njit
from topo_search.model.corners import CorneredTask
from topo_search.model.proof import Problem, proof_task
from topo_search.model.proven import TOLERANCE
from verify.bodies import Array

Indices = NDArray[np.int64]

PI_ABOVE = math.nextafter(math.pi, 4.0)
"""The least double above pi."""


class Numbers(NamedTuple):
    """Data of the compiled functions."""

    parent: Indices
    """Shape (n,); -1 for the root."""
    port: Indices
    """The parent's."""
    turns: Indices
    """Quarter turns between the parent's frame behind the hinge and the module's."""
    depth: Indices
    """Hinges between a module and the root."""
    bolted: NDArray[np.bool_]
    """Shape (n, n)."""
    bodies: Array
    """c_i as p_i times the first, and the axes x and y of the module times the others, shape (n, 3)."""
    torques: Array
    """Torque of each rotor about its module's centre at the input 1, in the module's frame, shape (4, 3)."""
    f: Array
    t: Array
    h: Array
    g: Array
    weight: Array
    """lambda_k, in the greatest, shape (K,)."""
    dead: Indices
    """Rotor at rest, 4 i + q, or -1, shape (K,)."""
    u_min: float
    """Least input of rotors that run."""
    normal: Array
    module: Indices
    down: Array
    """Distance of that end of the envelope from the module's centre, shape (W,)."""
    beyond: Array
    """Its radius less how far the half-space reaches from p'_E, shape (W,)."""
    force_off: float
    """Largest error of the force in a clear audit."""
    torque_off: Array
    """Likewise the torque about the origin, shape (K,)."""
    reach: float
    """No p'_E of a clear audit is farther from the origin."""
    l_c: float
    airflow: bool
    """True if airflow envelopes must not overlap."""
    length: float
    start_radius: float
    growth: float
    apart: float
    """Least distance of centres; 0 without a limit."""
    exempt: bool
    """True if modules that are bolted together may have centres nearer than that."""
    margin: float
    """Required distance between envelopes, or of parts from them, to first order."""
    parts: Array
    """Balls that must keep out of the airflow of modules that are not bolted to theirs: x, y, z, radius; (b, 4)."""
    angles: Array
    """Set that hinge angles are to be of, empty if any will do [rad]."""


def numbers(
    task: ResolvedTask, tree: Topology, problem: Problem = "task", corners: tuple[int, ...] = ()
) -> Numbers:
    """Return the numbers of a task and a tree rooted at the module that angles are counted from.

    Args:
        task: the task.
        tree: rooted there.
        problem: which designs a proof is about (`topo_search.model.proof`).
        corners: which of those of `proof_task` are taken in; what is left out only makes bounds lower.
    """
    bounded = proof_task(task, problem)
    if isinstance(bounded, CorneredTask):
        bounded = bounded.with_corners(corners)
    n, module, cases = tree.n, task.module, bounded.load_cases
    l_arm, F = module.arm_length, module.thrust_coefficient * task.max_input
    l_c = module.connector_distance / l_arm
    depth = np.zeros(n, np.int64)
    for above, i, _, _ in tree.edges():
        depth[i] = depth[above] + 1
    bolted = np.zeros((n, n), np.bool_)
    for i, j in tree.bolted:
        bolted[i, j] = bolted[j, i] = True
    drag = module.torque_coefficient / (module.thrust_coefficient * l_arm)
    torques = np.cross(ROTOR_DIRECTIONS, [0.0, 0.0, 1.0])
    torques[:, 2] += drag * ROTOR_SPINS
    bodies = _bodies(task, tree)
    kappa = task.end_effector.mass / (n * module.mass + (n - 1) * module.joint_mass)
    tip, com = [case.at_end_effector for case in cases], [case.at_com for case in cases]
    f_E, f_C = (np.array([w.force for w in at]) / F for at in (tip, com))
    t_E, t_C = (np.array([w.torque for w in at]) / (F * l_arm) for at in (tip, com))
    t = t_E + t_C
    fixed, off = task.end_effector.fixed_position, np.zeros(len(cases))
    if fixed is None:
        share = 1 / (n * (1 + kappa))
        g, h = f_E + share * n * kappa * f_C, share * f_C
    else:
        p_E = np.array(fixed) / l_arm
        t = t + np.cross((1 + kappa) * p_E, f_E) + np.cross(kappa * p_E, f_C)
        g, h = np.zeros_like(f_E), (f_E + f_C) / n
        off = TOLERANCE * ((1 + kappa) * np.linalg.norm(f_E, axis=1) + kappa * np.linalg.norm(f_C, axis=1))
    farthest = bodies[:, 0] * 2 * l_c * depth + np.linalg.norm(bodies[:, 1:], axis=1)
    centroid, e = float(farthest.mean()), TOLERANCE * task.total_mass(n) * task.gravity / F
    about_C = (1 + 2 * kappa) * e
    if isinstance(bounded, CorneredTask):
        e *= math.sqrt(3)
        moved = kappa * task.longest_lever(n) + math.sqrt(3) * task.flight.com_error
        about_C = max(about_C, (1 + moved / l_arm) * e)
    weight = np.array([case.weight for case in cases])
    normal, module_of, down, beyond = _walls(task)
    air = module.envelope
    margin, exempt = task.search.margin if problem == "solver" else 0.0, task.search.interference != "separation"
    apart = task.separation
    if exempt:
        apart = (task.centre_distance if problem == "solver" else task.body_clearance) or 0.0
    return Numbers(
        parent=np.array(tree.parents, np.int64),
        port=np.array([a for _, a, _ in tree.joints], np.int64),
        turns=np.array([0, *((a + 2 - b) % 4 for _, _, a, b in tree.edges())], np.int64),
        depth=depth,
        bolted=bolted,
        bodies=bodies,
        torques=torques,
        f=f_E + f_C,
        t=t,
        h=h,
        g=g,
        weight=weight / weight.max(),
        dead=np.array([-1 if rotor is None else rotor for rotor in bounded.dead_rotors], np.int64),
        u_min=task.min_input / task.max_input,
        normal=normal,
        module=module_of,
        down=down,
        beyond=beyond,
        force_off=e,
        torque_off=about_C + e * centroid + off,
        reach=centroid + (1 + kappa) * (task.farthest_end_effector(n) / l_arm + TOLERANCE),
        l_c=l_c,
        airflow=task.search.interference == "airflow",
        length=air.length / l_arm,
        start_radius=air.start_radius / l_arm,
        growth=air.growth / l_arm,
        apart=math.sqrt(apart**2 + 2 * apart * margin) / l_arm,
        exempt=exempt,
        margin=margin / l_arm,
        parts=_parts(task, problem),
        angles=angles_of_hinges(task),
    )


def _parts(task: ResolvedTask, problem: Problem) -> Array:
    """Return balls that must be out of other modules' airflow, where those may merge [l_arm].

    The solver keeps balls around all parts. Of the task's designs the parts themselves are out of it: here eight
    points of each rim, a ball in each rotor, and one in the hub.
    """
    if task.search.interference != "parts":
        return np.zeros((0, 4))
    body, l_arm = task.module.body, task.module.arm_length
    if problem == "solver":
        cover = task.part_cover
        return np.concatenate([cover.centres, cover.radii[:, None]], axis=1) / l_arm
    turns = np.arange(8) * math.pi / 4
    rim = body.rotor_radius / l_arm * (1 - 1e-12) * np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    balls = np.zeros((4 * 9 + 1, 4))
    balls[:32, :3] = (ROTOR_DIRECTIONS[:, None] + rim).reshape(32, 3)
    balls[32:36, :3] = ROTOR_DIRECTIONS
    balls[32:36, 3] = min(body.rotor_radius, body.rotor_height / 2) / l_arm
    balls[36, 3] = min(body.hub) / 2 / l_arm
    return balls if body.frame is None else balls[:36]


def effort_unit(task: ResolvedTask) -> float:
    """Return the unit of efforts [rad^4/s^4]."""
    return task.max_input**2 * max(case.weight for case in task.load_cases)


def reroot(topology: Topology, root: int) -> Topology:
    """Return the same platform as a tree that hangs from another module, breadth first, ports in order.

    A hinge seen from its other end turns about the same axis by the same angle, up to its sign.
    """
    neighbours: list[dict[int, tuple[int, int]]] = [{} for _ in range(topology.n)]
    for h, i, a, b in topology.edges():
        neighbours[h][a], neighbours[i][b] = (i, b), (h, a)
    number, joints, waiting = {root: 0}, [(-1, -1, -1)], deque([root])
    while waiting:
        h = waiting.popleft()
        for a in sorted(neighbours[h]):
            i, b = neighbours[h][a]
            if i not in number:
                number[i] = len(joints)
                joints.append((number[h], a, b))
                waiting.append(i)
    return Topology(tuple(joints))


def all_angles(task: ResolvedTask, n: int) -> tuple[Array, Array]:
    """Return the box of all angles of designs that an audit can call clear, from and to, shape (n + 2,) [rad]."""
    quarter = math.pi / 2 + 2 * TOLERANCE
    root = [PI_ABOVE, PI_ABOVE / 2, PI_ABOVE]
    if task.search.root == "paper":
        root = [2 * TOLERANCE, quarter, quarter]
    most = np.array([*root, *(quarter for _ in range(n - 1))])
    lower, upper, angles = -most, most, angles_of_hinges(task)
    if len(angles):
        lower, upper = (
            np.append(lower[:3], [angles.min()] * (n - 1)),
            np.append(upper[:3], [angles.max()] * (n - 1)),
        )
    return lower, upper


def angles_of_hinges(task: ResolvedTask) -> Array:
    """Return the set that hinge angles are to be of, shape (angles,) [rad]; empty where the task has none.

    An audit lets no other angle pass, not by a bit. The set has both signs of every angle, so that it is the same
    from either end of a hinge.
    """
    degrees = task.search.hinge_set_deg
    return np.zeros(0) if degrees is None else np.array([math.radians(angle) for angle in degrees])


@njit(cache=True)
def angles_around(angles: Array, middle: float) -> tuple[float, float]:
    """Return the greatest hinge angle up to `middle` and the least one beyond; without a set, `middle` twice."""
    if len(angles) == 0:
        return middle, middle
    below, beyond = -math.inf, math.inf
    for angle in angles:
        if angle <= middle:
            below = max(below, angle)
        else:
            beyond = min(beyond, angle)
    return below, beyond


def _bodies(task: ResolvedTask, tree: Topology) -> Array:
    """Return what the c_i are made of."""
    module, bodies = task.module, np.zeros((tree.n, 3))
    bodies[:, 0] = module.mass
    for h, i, a, b in tree.edges():
        for one, port in ((h, a), (i, b)):
            step = module.connector_distance / module.arm_length * PORT_DIRECTIONS[port]
            bodies[one] += module.joint_mass / 2 * np.array([1.0, step[0], step[1]])
    return np.asarray(bodies * (tree.n / bodies[:, 0].sum()))


def _walls(task: ResolvedTask) -> tuple[Array, Indices, Array, Array]:
    """Return the rows of half-spaces with a direction of their own; a fixed end-effector has none."""
    planes = list[tuple[Array, float]]()
    for region in task.exposure:
        if not region.geometry or task.end_effector.fixed_position is not None:
            continue
        if isinstance(region, Allowed):
            planes += [(np.array(plane.normal), plane.offset) for plane in region.planes]
        elif isinstance(region, Exterior) and region.half_angle_deg == 90 and region.axis != "com":
            planes.append((-np.array(region.axis), 0.0))
    air, n, l_arm = task.module.region_envelope, task.n, task.module.arm_length
    end_balls = (0.0, air.start_radius), (air.length, air.end_radius)
    rows = [(out, i, down, r - offset) for out, offset in planes for i in range(n) for down, r in end_balls]
    return (
        np.array([out / np.linalg.norm(out) for out, *_ in rows]).reshape(-1, 3),
        np.array([i for _, i, _, _ in rows], np.int64),
        np.array([down for _, _, down, _ in rows]) / l_arm,
        np.array([beyond for *_, beyond in rows]) / l_arm,
    )
