"""A task and a tree as arrays for the check of a proof, derived from the model alone.

Lengths are in l_arm, forces in the greatest thrust F of a rotor, inputs in the greatest input u_max, efforts in
lambda_max u_max^2.

| symbol | meaning | shape |
|---|---|---|
| n, K | modules, load cases | |
| A | number of angles, n + 2: psi, alpha_0, alpha_1, then the hinge of every module but the root | |
| f_k | total force of load case k, f_E + f_C | (K, 3) |
| t_k, h_k, g_k | its torque about the origin of W is t_k + sum_i c_i x h_k + p'_E x g_k | (K, 3) each |
| n_r | outward normal of wall r, a half-space that contains an end of an airflow envelope | (W, 3) |
| c_i | moment of module i and half of each of its joints, over their mean mass: p_i if joints have no mass | (3,) |
| C | centre of mass of all modules and joints, the mean of the c_i | (3,) |
| kappa | m_E / (m_t - m_E) | |

With p'_E free, p_COM = (C + kappa p'_E) / (1 + kappa), so g_k = f_E + (m_E / m_t) f_C, h_k = f_C / (n (1 + kappa)).
With p_E fixed from the COM, p_COM = C + kappa p_E and p'_E = C + (1 + kappa) p_E, so g_k = 0 and h_k = f_k / n.

**Tolerances of a clear audit** (`topo_search.model.search`). The force has an error of at most e = TOLERANCE m_t g,
and so do, in l_arm, the torques about the COM and about p_E. Torque is linear in the point that it is taken about,
and C is on the line through both: the error is (1 + 2 kappa) e about C, and |C| e more about the origin. Inputs are
between `min_input` - TOLERANCE and 1 + TOLERANCE, those of a dead rotor within TOLERANCE of 0, hinges within pi/2 +
TOLERANCE, a fixed p_E within TOLERANCE l_arm.

In wrenches for which the audit itself finds inputs, such as hover and other centres of reserves, each component has
an error of at most e; the torque is taken about the COM, or about the COM with its error. That is sqrt(3) e in the
force, and sqrt(3) (1 + kappa |p_E| + sqrt(3) com_error) e in the torque about C, which is kappa p_E from the COM.

With a rod that has mass, the COM is at most as far from the origin as the farthest p'_E, which the reach limits.
The torque about the origin is that about the COM, or the COM with its error, and a lever times the force: its error
is at most sqrt(3) (1 + max |p'_E| + sqrt(3) com_error) e, without the roots if the task has no reserves.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from topo_search.compiled_code import njit
from topo_search.model import PORT_DIRECTIONS, Array, CorneredTask, Flags, Indices, LoadCase, ResolvedTask, Topology
from topo_search.model.proof import Problem, cases_with_heaviest_rod, proof_task
from topo_search.model.proven import TOLERANCE
from topo_search.model.rotors import x_quadrotor
from verify.proof.rod import RodInterval, rod_interval
from verify.requirements import half_spaces

ROTORS = x_quadrotor().count
"""r, the number of rotors of the modules for which the checker is compiled."""
PI_ROUNDED_UP = math.nextafter(math.pi, 4.0)
"""Least double above pi."""


class CheckProblem(NamedTuple):
    """A task and a tree as arrays."""

    parent: Indices
    """-1 for the root; parents precede children; shape (n,)."""
    port: Indices
    """Parent's port, shape (n,)."""
    quarter_turns: Indices
    """Quarter turns between the parent's frame behind the hinge and the module's."""
    depth: Indices
    """Number of hinges between the root and a module, shape (n,)."""
    bolted: Flags
    """True if two modules share a joint, shape (n, n)."""
    bodies: Array
    """Mass of each module with its joints over the mean, and moments along the module's x and y, shape (n, 3)."""
    rotor_torques: Array
    """Torque of each rotor about its module's centre at unit input, in the module's frame, shape (r, 3)."""
    f: Array
    t: Array
    h: Array
    g: Array
    weight: Array
    """lambda_k over the largest weight, shape (K,)."""
    dead_rotor: Indices
    """Dead rotor of each load case, r i + q, or -1, shape (K,)."""
    rod: RodInterval
    u_min: float
    """Least input of a rotor that is not dead."""
    wall_normal: Array
    wall_module: Indices
    wall_distance: Array
    """Distance of the end of the envelope from the module's centre, shape (W,)."""
    wall_offset: Array
    """d_r, radius of the end less the offset of the half-space from p'_E, shape (W,)."""
    force_error: float
    """Largest error of a force in a clear audit."""
    torque_error: Array
    """Largest error of the torque about the origin in a clear audit, shape (K,)."""
    max_tip_distance: float
    """Greatest |p'_E| in a clear audit."""
    l_c: float
    has_airflow: bool
    """True if airflow envelopes must not overlap."""
    length: float
    start_radius: float
    growth: float
    centre_distance: float
    """Least distance between module centres; 0 if there is no limit."""
    exempts_bolted: bool
    """True if `centre_distance` does not apply to modules that share a joint."""
    margin: float
    """Required clearance of envelopes or parts, to first order."""
    balls: Array
    """Balls that must be out of the airflow of modules that share no joint: x, y, z, radius, shape (b, 4)."""
    hinge_angles: Array
    """Set of hinge angles; empty if the task has none [rad]."""


def to_arrays(
    task: ResolvedTask,
    tree: Topology,
    problem: Problem = "task",
    corners: tuple[int, ...] = (),
    *,
    weighted: bool = True,
) -> CheckProblem:
    """Return the arrays of a task and a tree.

    Args:
        task: task.
        tree: tree, rooted at the root module of the proof.
        problem: designs that the proof covers (`topo_search.model.proof`).
        corners: numbers of the corners of `proof_task` to include; fewer corners only make bounds lower.
        weighted: False to count no effort: a positive bound then shows that there is no design.
    """
    heaviest, task = cases_with_heaviest_rod(task, problem), task.lightest
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
    rotor_torques = np.cross(module.rotor_table.positions, module.rotor_table.axes)
    rotor_torques += drag * module.rotor_table.drags[:, None] * module.rotor_table.axes
    bodies = _bodies(task, tree)
    kappa = task.end_effector.mass / (n * module.mass + (n - 1) * module.joint_mass)
    heavy_cases = [heaviest[label] for label in bounded.case_labels]
    light, heavy = (_wrenches(each, F, l_arm) for each in (cases, heavy_cases))
    f_E, f_C, t = light
    fixed, position_error = task.end_effector.fixed_position, np.zeros(len(cases))
    if fixed is None:
        share = 1 / (n * (1 + kappa))
        g, h = f_E + share * n * kappa * f_C, share * f_C
    else:
        p_E = np.array(fixed) / l_arm
        t = t + np.cross((1 + kappa) * p_E, f_E) + np.cross(kappa * p_E, f_C)
        g, h = np.zeros_like(f_E), (f_E + f_C) / n
        for tip_forces, com_forces, _ in (light, heavy):
            forces = (1 + kappa) * np.linalg.norm(tip_forces, axis=1) + kappa * np.linalg.norm(com_forces, axis=1)
            position_error = np.maximum(position_error, TOLERANCE * forces)
    farthest = bodies[:, 0] * 2 * l_c * depth + np.linalg.norm(bodies[:, 1:], axis=1)
    centroid = float(farthest.mean())
    rod = rod_interval(task, light, heavy, int(depth.max()), centroid)
    e = TOLERANCE * (task.total_mass(n) + rod.max_mass) * task.gravity / F
    about_C = (1 + 2 * kappa) * e
    if isinstance(bounded, CorneredTask):
        e *= math.sqrt(3)
        com_shift = kappa * task.longest_lever(n) + math.sqrt(3) * task.flight.com_error
        about_C = max(about_C, (1 + com_shift / l_arm) * e)
    torque_error = about_C + e * centroid
    max_tip_distance = centroid + (1 + kappa) * (task.farthest_end_effector(n) / l_arm + TOLERANCE)
    if rod.max_mass > 0.0:
        max_tip_distance = rod.max_tip_distance
        torque_error = (1 + max_tip_distance + math.sqrt(3) * task.flight.com_error / l_arm) * e
    weight = np.array([case.weight for case in cases])
    wall_normal, wall_module, wall_distance, wall_offset = _walls(task)
    air = module.envelope
    exempts_bolted, margin = task.search.interference != "separation", 0.0
    if problem == "solver":
        margin = task.search.least_margin
    centre_distance = task.separation
    if exempts_bolted:
        centre_distance = (task.centre_distance if problem == "solver" else task.body_clearance) or 0.0
    return CheckProblem(
        parent=np.array(tree.parents, np.int64),
        port=np.array([a for _, a, _ in tree.joints], np.int64),
        quarter_turns=np.array([0, *((a + 2 - b) % 4 for _, _, a, b in tree.edges())], np.int64),
        depth=depth,
        bolted=bolted,
        bodies=bodies,
        rotor_torques=rotor_torques,
        f=f_E + f_C,
        t=t,
        h=h,
        g=g,
        weight=weight / weight.max() if weighted else np.zeros(len(weight)),
        dead_rotor=np.array([-1 if rotor is None else rotor for rotor in bounded.dead_rotors], np.int64),
        rod=rod,
        u_min=task.min_input / task.max_input,
        wall_normal=wall_normal,
        wall_module=wall_module,
        wall_distance=wall_distance,
        wall_offset=wall_offset,
        force_error=e,
        torque_error=torque_error + position_error,
        max_tip_distance=max_tip_distance,
        l_c=l_c,
        has_airflow=task.search.interference == "airflow",
        length=air.length / l_arm,
        start_radius=air.start_radius / l_arm,
        growth=air.growth / l_arm,
        centre_distance=math.sqrt(centre_distance**2 + 2 * centre_distance * margin) / l_arm,
        exempts_bolted=exempts_bolted,
        margin=margin / l_arm,
        balls=_balls(task, problem),
        hinge_angles=hinge_angles(task),
    )


def _wrenches(cases: Sequence[LoadCase], F: float, l_arm: float) -> tuple[Array, Array, Array]:
    """Return f_E, f_C and the torque of load cases, shape (K, 3) each."""
    tip, com = [case.at_end_effector for case in cases], [case.at_com for case in cases]
    f_E, f_C = (np.array([w.force for w in wrenches]) / F for wrenches in (tip, com))
    t_E, t_C = (np.array([w.torque for w in wrenches]) / (F * l_arm) for wrenches in (tip, com))
    return f_E, f_C, t_E + t_C


def _balls(task: ResolvedTask, problem: Problem) -> Array:
    """Return balls that must be out of other modules' airflow if airflows may merge [l_arm].

    For the solver these cover all parts. For the task they are inside the parts: eight points of each rim, a ball
    in each rotor, and one in the hub.
    """
    if task.search.interference != "parts":
        return np.zeros((0, 4))
    body, l_arm = task.module.body, task.module.arm_length
    if problem == "solver":
        cover = task.part_cover(task.module)
        return np.concatenate([cover.centres, cover.radii[:, None]], axis=1) / l_arm
    turns = np.arange(8) * math.pi / 4
    rim = body.rotor_radius / l_arm * (1 - 1e-12) * np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    rotors = task.module.rotor_table.positions
    rims, inner = (rotors[:, None] + rim).reshape(-1, 3), min(body.rotor_radius, body.rotor_height / 2) / l_arm
    centres = np.concatenate([rims, rotors, np.zeros((1 if body.frame is None else 0, 3))])
    radii = [*([0.0] * len(rims)), *([inner] * len(rotors)), min(body.hub) / 2 / l_arm]
    return np.concatenate([centres, np.array(radii)[: len(centres), None]], axis=1)


def effort_unit(task: ResolvedTask) -> float:
    """Return the unit of effort [rad^4/s^4]."""
    return task.max_input**2 * max(case.weight for case in task.load_cases)


def reroot(topology: Topology, root: int) -> Topology:
    """Return the tree rooted at another module, numbered breadth first, ports in order.

    Seen from its other end, a hinge turns about the same axis by the same angle, up to its sign.
    """
    neighbours: list[dict[int, tuple[int, int]]] = [{} for _ in range(topology.n)]
    for h, i, a, b in topology.edges():
        neighbours[h][a], neighbours[i][b] = (i, b), (h, a)
    number, joints, queue = {root: 0}, [(-1, -1, -1)], deque([root])
    while queue:
        h = queue.popleft()
        for a in sorted(neighbours[h]):
            i, b = neighbours[h][a]
            if i not in number:
                number[i] = len(joints)
                joints.append((number[h], a, b))
                queue.append(i)
    return Topology(tuple(joints))


def whole_box(task: ResolvedTask, n: int) -> tuple[Array, Array]:
    """Return the least and greatest angles of a design with a clear audit, shape (n + 2,) [rad]."""
    hinge_limit = math.pi / 2 + 2 * TOLERANCE
    largest = np.array([PI_ROUNDED_UP, PI_ROUNDED_UP / 2, PI_ROUNDED_UP, *(hinge_limit for _ in range(n - 1))])
    lower, upper, angles = -largest, largest.copy(), hinge_angles(task)
    for axis, (low, high) in enumerate(task.search.root_ranges.values()):
        lower[axis], upper[axis] = low - 2 * TOLERANCE, high + 2 * TOLERANCE
    if len(angles):
        lower[3:], upper[3:] = angles.min(), angles.max()
    return lower, upper


def turns_about_vertical(task: ResolvedTask, problem: Problem) -> bool:
    """Return whether all that a bound requires of a design is met by it at any psi, if at one.

    Without reserves and tilts all wrenches are along z; with them the audit measures balls, discs in the xy plane
    and cones about z, whose points the bound requires. Turned about z, a design holds them all the same.
    """
    bare = task.with_fields("flight", force_reserve=0.0, torque_reserve=0.0, tilt_deg=0.0)
    sides = [task.end_effector.fixed_position or (0.0, 0.0, 0.0)]
    for case in proof_task(bare, problem).load_cases:
        for wrench in (case.at_end_effector, case.at_com):
            sides += [wrench.force, wrench.torque]
    is_free = not task.search.root_ranges and problem == "task" and len(_walls(task)[0]) == 0
    return is_free and all(x == 0.0 == y for x, y, _ in sides)


def hinge_angles(task: ResolvedTask) -> Array:
    """Return the task's set of hinge angles; empty if it has none [rad].

    The audit has no tolerance for other angles. The set has both signs of every angle, so it is the same seen from
    either end of a hinge.
    """
    degrees = task.search.hinge_set_deg
    return np.zeros(0) if degrees is None else np.array([math.radians(angle) for angle in degrees])


@njit(cache=True)
def angles_around(angles: Array, middle: float) -> tuple[float, float]:
    """Return the greatest hinge angle up to `middle` and the least one above it; without a set, `middle` twice."""
    if len(angles) == 0:
        return middle, middle
    below, above = -math.inf, math.inf
    for angle in angles:
        if angle <= middle:
            below = max(below, angle)
        else:
            above = min(above, angle)
    return below, above


def _bodies(task: ResolvedTask, tree: Topology) -> Array:
    """Return `CheckProblem.bodies`."""
    module, bodies = task.module, np.zeros((tree.n, 3))
    bodies[:, 0] = module.mass
    for h, i, a, b in tree.edges():
        for module_of_joint, port in ((h, a), (i, b)):
            step = module.connector_distance / module.arm_length * PORT_DIRECTIONS[port]
            bodies[module_of_joint] += module.joint_mass / 2 * np.array([1.0, step[0], step[1]])
    return np.asarray(bodies * (tree.n / bodies[:, 0].sum()))


def _walls(task: ResolvedTask) -> tuple[Array, Indices, Array, Array]:
    """Return normals, modules, distances and offsets of the walls; none for a fixed end-effector."""
    regions = [] if task.end_effector.fixed_position is not None else task.exposure
    planes = [plane for region in regions if region.geometry for plane in half_spaces(region)]
    air, n, l_arm = task.module.region_envelope, task.n, task.module.arm_length
    end_balls = (0.0, air.start_radius), (air.length, air.end_radius)
    rows = [(normal, i, end, r - offset) for normal, offset in planes for i in range(n) for end, r in end_balls]
    return (
        np.array([normal for normal, *_ in rows]).reshape(-1, 3),
        np.array([i for _, i, _, _ in rows], np.int64),
        np.array([end for _, _, end, _ in rows]) / l_arm,
        np.array([offset for *_, offset in rows]) / l_arm,
    )
