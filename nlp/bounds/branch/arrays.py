"""A task and a tree as arrays for branch and bound.

Lengths are in l_arm, forces in m g, inputs in the hover input of a module, efforts in the square of that. With a
`free` root orientation the tree is rooted at its centre, which keeps the paths from the root short.

| symbol | meaning | shape |
|---|---|---|
| n, K, A | modules, load cases, angles: psi, alpha_0, alpha_1, then the hinges; A = n + 2 | |
| f_k | force f_E + f_C of load case k | (K, 3) |
| t_k, h_k | its torque about the origin of W is t_k + sum_i p_i x h_k + p'_E x g_k | (K, 3) each |
| g_k | force with the lever p'_E; 0 if the task fixes the end-effector relative to the COM | (K, 3) |
| lambda_k | weight over the largest weight | (K,) |
| n_r | outward normal of wall r, a half-space that contains an end of an airflow envelope | (W, 3) |

Load cases are followed by the corners of wrench sets, reserves and rotor failures, which have no weight.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from nlp.bounds.branch.rod import RodChange, rod_change, wrenches
from nlp.numbers.masses import Masses, masses
from nlp.units import Units
from topo_search.model import PORT_DIRECTIONS, Array, Flags, Indices, LoadCase, ResolvedTask, Topology
from topo_search.model.corners import CorneredTask
from topo_search.model.exposure import half_spaces
from topo_search.model.kinds import Vector
from topo_search.model.proof import Problem, cases_with_heaviest_rod, proof_task
from topo_search.model.proven import TOLERANCE
from topo_search.model.rotors import x_quadrotor
from topo_search.model.shape import NOWHERE
from topo_search.model.topology import ROOT, Joint

ROTORS = x_quadrotor().count
"""r, the number of rotors of the modules for which the search is compiled."""
SHARE = 1 / ROTORS
"""Weight that a rotor at input 1 carries [m g]."""
HALF_TURN = math.pi * (1 + 1e-12)
"""Limit of the root's angles: slightly above pi, which is not a float [rad]."""
SUM_ROUNDING = 1e-11
"""Allowance for rounding of a sum, over its largest terms, up to n K = 10,000 (`nlp.bounds.branch.box`)."""


class TreePaths(NamedTuple):
    """Parents, ports and paths of the modules."""

    parent: Indices
    """-1 for the root; parents precede children."""
    port: Indices
    kappa: Indices
    depth: Indices
    """Number of hinges between the root and a module, shape (n,)."""
    path: Indices
    """Angles that move module i, outermost first: psi, alpha_0, alpha_1, then hinges; shape (n, A), -1 beyond."""
    first: Indices
    """Index of the first of the 2^depth[i] frames of module i, then the number of frames, shape (n + 1,)."""
    bolted: Flags
    """True if two modules share a joint, shape (n, n)."""


class LargestLevers(NamedTuple):
    """Greatest distances from the axes over all angles [l_arm]."""

    rotor: Array
    """Distance of the rotors of module i from the axis of angle a, plus the lever of drag, shape (n, A)."""
    centre: Array
    """Distance of the module's centre, shape (n, A)."""
    body: Array
    """Moment of the module's body (`BranchProblem.bodies`) about the axis, shape (n, A)."""
    between: Array
    """Distance between the axes of two angles, shape (A, A)."""
    centroid: float
    """Distance of the COM of modules and joints from the origin."""


class Loads(NamedTuple):
    """The load cases."""

    f: Array
    t: Array
    h: Array
    g: Array
    weight: Array
    dead_rotor: Indices
    """Dead rotor of each load case, r i + q, or -1, shape (K,)."""
    condition_inverse: Array
    """Pseudo-inverse of sum_k [g_k]x [g_k]x^T, shape (3, 3)."""


class Walls(NamedTuple):
    """Half-spaces relative to a free end-effector: n_r . (e_r - p'_E) + d_r <= 0 for an end e_r of an envelope."""

    normal: Array
    module: Indices
    end: Indices
    """End of the envelope: 0 at the module, 1 at the far end, shape (W,)."""
    offset: Array
    """d_r, radius of the end less the offset of the half-space, shape (W,) [l_arm]."""
    length: float
    """Distance between the two ends [l_arm]."""


class Slack(NamedTuple):
    """Allowances of a dual value for the audit's tolerance and for rounding."""

    force: Array
    """Loss per unit of |nu_k|, shape (K,)."""
    torque: Array
    """Loss per unit of |mu_k|, shape (K,)."""
    wall: float
    """Loss per unit of a wall's multiplier."""
    tip: float
    """Loss per unit of the condition's residual: the greatest |p'_E| [l_arm]."""


class Separation(NamedTuple):
    """Required separation of modules and airflow [l_arm]."""

    has_airflow: bool
    """True if airflow envelopes must not overlap."""
    length: float
    start_radius: float
    growth: float
    centre_distance: float
    """Least distance between module centres; 0 if there is no limit."""
    includes_bolted: bool
    """True if `centre_distance` applies to modules that share a joint, too."""
    margin: float
    """Required clearance of envelopes or parts, to first order."""
    balls: Array
    """Balls that must be out of the airflow of modules that share no joint: x, y, z, radius, shape (b, 4)."""


class BranchProblem(NamedTuple):
    """A task and a tree as arrays."""

    tree: TreePaths
    levers: LargestLevers
    loads: Loads
    rod: RodChange
    walls: Walls
    slack: Slack
    separation: Separation
    bodies: Array
    """Mass of each module with its joints over the mean, and moments along the module's x and y, shape (n, 3)."""
    rotor_torques: Array
    """Torque of each rotor about its module's centre at unit thrust, in the module's frame, shape (r, 3)."""
    l_c: float
    u_min: float
    u_max: float
    """Both input limits include the audit's tolerance."""
    hinge_angles: Array
    """Set of hinge angles in ascending order; empty if the task has none [rad]."""


def to_arrays(
    task: ResolvedTask, topology: Topology, problem: Problem = "task", *, weighted: bool = True
) -> BranchProblem:
    """Return the arrays of a task and a tree, which must be rooted at its `centre`.

    Args:
        task: task.
        topology: tree.
        problem: designs that the proof covers (`topo_search.model.proof`).
        weighted: False if no load case adds effort, for proofs that there is no design at all.
    """
    heaviest, task = cases_with_heaviest_rod(task, problem), task.lightest
    n, unit, module = topology.n, Units.of(task), task.module
    l_c = module.connector_distance / unit.length
    drag = module.torque_coefficient / (module.thrust_coefficient * module.arm_length)
    tree, mass = _tree(topology), masses(task, topology)
    bodies = np.column_stack([mass.modules, mass.modules[:, None] * mass.centres]) * n / mass.bodies
    rotors = module.rotor_table
    levers = _levers(tree, l_c, float(rotors.distances.max()) + drag, bodies)
    cornered = proof_task(task, problem)
    loads, walls, U = _loads(cornered, mass, unit), _walls(task, unit), task.max_thrust_to_weight
    loads = loads if weighted else loads._replace(weight=0.0 * loads.weight)
    air, interference = module.envelope, task.search.interference
    cases = [heaviest[label] for label in cornered.case_labels]
    rod = rod_change(cornered, cases, mass, l_c * (2 * int(tree.depth.max()) + 1), levers.centroid)
    margin, body_distance = 0.0, task.body_clearance
    if problem == "solver":
        margin, body_distance = task.search.least_margin, task.centre_distance
    centre_distance = task.separation if interference == "separation" else body_distance or 0.0
    centre_distance = math.sqrt(centre_distance * (centre_distance + 2 * margin))
    length, start_radius, growth = (x / unit.length for x in (air.length, air.start_radius, air.growth))
    return BranchProblem(
        tree,
        levers,
        loads,
        rod,
        walls,
        _slack(cornered, cases, levers, loads, rod, walls, mass),
        Separation(
            has_airflow=interference == "airflow",
            length=length,
            start_radius=start_radius,
            growth=growth,
            centre_distance=centre_distance / unit.length,
            includes_bolted=interference == "separation",
            margin=margin / unit.length,
            balls=_balls(task, problem) / unit.length,
        ),
        bodies,
        rotors.torques(drag),
        l_c,
        max(0.0, task.min_thrust_to_weight - U * TOLERANCE),
        U * (1 + TOLERANCE),
        hinge_angles(task),
    )


def _balls(task: ResolvedTask, problem: Problem) -> Array:
    """Return balls that must be out of other modules' airflow: the solver's cover, or balls inside the parts [m].

    Inside the parts are points of the rotor rims, towards the arm and the two ports beside it, balls between the
    faces of rotors, and one in the hub.
    """
    module, body = task.module, task.module.body
    if task.search.interference != "parts":
        return np.empty((0, 4))
    if problem == "solver":
        return np.column_stack(task.part_cover(task.module))
    rotors, ports = module.rotor_table.positions, PORT_DIRECTIONS
    rims = [(a, out) for a in rotors for out in (a, *(e for e in ports if e @ a > 0))]
    balls = [(*(module.arm_length * a), min(body.rotor_radius, body.rotor_height / 2)) for a in rotors]
    balls += [(*(module.arm_length * a + body.rotor_radius * out), 0.0) for a, out in rims]
    if body.frame is None:
        balls.append((0.0, 0.0, 0.0, min(body.hub) / 2))
    return np.array(balls)


def effort_unit(task: ResolvedTask) -> float:
    """Return the unit of effort [rad^4/s^4]."""
    return Units.of(task).input ** 2 * max(case.weight for case in task.load_cases)


def hinge_angles(task: ResolvedTask) -> Array:
    """Return the task's set of hinge angles in ascending order; empty if it has none [rad].

    The set has both signs of each angle, so it is the same seen from either end of a hinge.
    """
    return np.array([math.radians(angle) for angle in task.search.hinge_set_deg or ()])


def whole_box(task: ResolvedTask, n: int) -> tuple[Array, Array]:
    """Return the least and greatest angles of a design, with the audit's tolerance, shape (A,) each [rad]."""
    angles = hinge_angles(task)
    hinge_limit = np.full(n - 1, math.pi / 2 + TOLERANCE)
    largest = np.concatenate([[HALF_TURN, math.pi / 2 * (1 + 1e-12), HALF_TURN], hinge_limit])
    lower, upper = -largest, largest.copy()
    for axis, (low, high) in enumerate(task.search.root_ranges.values()):
        lower[axis], upper[axis] = low - TOLERANCE, high + TOLERANCE
    if len(angles):
        lower[3:], upper[3:] = angles[0], angles[-1]
    return lower, upper


def is_symmetric(task: ResolvedTask, problem: Problem) -> bool:
    """Return whether a design that meets what the bound takes into account does so turned about the vertical.

    Forces and torques of the load cases must be vertical, and so must a fixed end-effector. Balls, horizontal discs
    and caps of reserves around them are symmetric as a whole: every clear design produces all of their points. The
    corners around them (`solver`), errors of the centre of mass along the axes of W, and walls are not.
    """
    wrenches = [w for case in task.load_cases for c in (case, *case.corners) for w in (c.at_end_effector, c.at_com)]
    vectors = [task.end_effector.fixed_position or NOWHERE, *(v for w in wrenches for v in (w.force, w.torque))]
    vertical = not any(x or y for x, y, _ in vectors)
    is_free = not task.search.root_ranges and not len(_walls(task, Units.of(task)).normal)
    return problem == "task" and task.flight.com_error == 0 and vertical and is_free


def centre(task: ResolvedTask, topology: Topology) -> int:
    """Return the root module of a tree in a proof: its centre, the first of two."""
    import networkx as nx

    return 0 if task.search.root_ranges else min(nx.center(topology.graph()))


def reroot(topology: Topology, root: int) -> Topology:
    """Return the tree rooted at another module, numbered breadth first, ports in order."""
    graph, joints, queue = topology.graph(), list[Joint](), [(root, -1, ROOT)]
    for i, previous, joint in queue:
        number = len(joints)
        joints.append(joint)
        neighbours = [(graph[i][j]["ports"][i], j) for j in graph[i] if j != previous]
        queue += [(j, i, (number, port, graph[i][j]["ports"][j])) for port, j in sorted(neighbours)]
    return Topology(tuple(joints))


def _tree(topology: Topology) -> TreePaths:
    n = topology.n
    parent, port = (np.array([joint[k] for joint in topology.joints]) for k in (0, 1))
    depth, path = np.zeros(n, np.int64), np.full((n, n + 2), -1)
    path[:, :3] = range(3)
    bolted = np.zeros((n, n), np.bool_)
    for h, i, _, _ in topology.edges():
        depth[i] = depth[h] + 1
        path[i] = path[h]
        path[i, 2 + depth[i]] = i + 2
        bolted[h, i] = bolted[i, h] = True
    first = np.concatenate([[0], np.cumsum(2**depth)])
    return TreePaths(parent, port, np.array(topology.kappas), depth, path, first, bolted)


def _levers(tree: TreePaths, l_c: float, rotor: float, bodies: Array) -> LargestLevers:
    """Return the distances in the stretched-out tree; hinges are l_c before their modules, the root's axes at 0.

    `rotor`: distance of a module's rotors from its centre, plus the lever of drag.
    """
    n = len(tree.parent)
    axis_offset = np.concatenate([np.zeros(3), l_c * (2 * tree.depth[1:] - 1)])
    centre = np.abs(2 * l_c * tree.depth[:, None] - axis_offset)
    body = bodies[:, :1] * centre + np.linalg.norm(bodies[:, 1:], axis=1)[:, None]
    between = np.abs(axis_offset[:, None] - axis_offset[None, :])[: n + 2]
    centroid = float(body[:, 0].mean())  # the first axis is through the origin
    return LargestLevers(centre + rotor, centre, body, between, centroid)


def _loads(task: ResolvedTask, mass: Masses, unit: Units) -> Loads:
    cases, position = task.load_cases, task.end_effector.fixed_position
    f_E, f_C, t = wrenches(cases, unit)
    n, share = task.n, mass.tip / mass.total
    weight = np.array([case.weight for case in cases])
    dead_rotor = np.array([-1 if rotor is None else rotor for rotor in task.dead_rotors])
    if position is None:
        g, h = f_E + share * f_C, f_C / (mass.total * (n / mass.bodies))
    else:  # p'_E and the COM from B (`nlp.numbers.masses`)
        p_E = np.array(position) / unit.length
        t = t + mass.lever * np.cross(p_E, f_E) + mass.tip / mass.bodies * np.cross(p_E, f_C)
        g, h = np.zeros_like(f_E), (f_E + f_C) / n
    crosses = sum(((g_k @ g_k) * np.eye(3) - np.outer(g_k, g_k) for g_k in g), np.zeros((3, 3)))
    condition_inverse = np.linalg.pinv(crosses, rcond=1e-9, hermitian=True)
    return Loads(f_E + f_C, t, h, g, weight / weight.max(), dead_rotor, condition_inverse)


def _walls(task: ResolvedTask, unit: Units) -> Walls:
    """Return the half-spaces of the exposure; none for a fixed end-effector, which follows the centre of mass."""
    air, rows = task.module.region_envelope, list[tuple[Vector, int, int, float]]()
    for cone in half_spaces(task.exposure) if task.end_effector.fixed_position is None else ():
        x, y, z = cone.axis or NOWHERE
        offset = -float(np.dot((x, y, z), cone.apex))
        for end, radius in enumerate((air.start_radius, air.end_radius)):
            rows += [((-x, -y, -z), i, end, (radius - offset) / unit.length) for i in range(task.n)]
    return Walls(
        np.array([row[0] for row in rows]).reshape(-1, 3),
        np.array([row[1] for row in rows], np.int64),
        np.array([row[2] for row in rows], np.int64),
        np.array([row[3] for row in rows]),
        air.length / unit.length,
    )


def _slack(
    task: ResolvedTask,
    heaviest: Sequence[LoadCase],
    levers: LargestLevers,
    loads: Loads,
    rod: RodChange,
    walls: Walls,
    mass: Masses,
) -> Slack:
    """Return the losses of a dual value to the audit's tolerance and to rounding.

    With e = TOLERANCE m_t g the audit allows an error of e in a force, of l_arm e in a torque about the COM and
    about the end-effector, hence of (1 + 2 m_E / (m_t - m_E)) l_arm e about B (`nlp.bounds.wrenches`), and of the
    distance of B times e more about the origin of W. If a rod has mass, the COM is nowhere farther from the origin
    than the farthest p'_E, and the error about the origin is that distance times e more than about the COM. Every
    input may exceed its limits by d = TOLERANCE U; inputs below zero raise a rotor's psi by at most d |a_j . y|. A
    fixed end-effector may be off by TOLERANCE l_arm. Hover and other centres of reserves may be off by e along each
    axis, their torques about the COM only, wherever its error puts it: B is m_E / (m_t - m_E) p_E from the COM.
    """
    n, unit, U = task.n, task.module.arm_length, task.max_thrust_to_weight
    e, d = TOLERANCE * (mass.total + rod.mass), TOLERANCE * U
    lever, B = float(levers.rotor.max()), levers.centroid
    torque_error, com_shift = (2 * mass.lever - 1 + B) * e, (mass.lever - 1) * task.longest_lever(n) / unit + B
    if rod.mass > 0.0:
        torque_error, com_shift = (1 + rod.farthest) * e, rod.farthest
    if isinstance(task, CorneredTask):
        e *= math.sqrt(3)
        com_shift += math.sqrt(3) * task.declared.flight.com_error / unit
        torque_error = max(torque_error, (1 + com_shift) * e)
    position_error = 0.0 if task.end_effector.fixed_position is None else TOLERANCE * mass.lever
    f_E, f_C = (
        np.maximum(*(np.linalg.norm(part, axis=1) for part in parts))
        for parts in zip(
            *(wrenches(cases, Units.of(task))[:2] for cases in (task.load_cases, heaviest)), strict=True
        )
    )
    f, t, h, g = (np.linalg.norm(x, axis=1) for x in (loads.f, loads.t, loads.h, loads.g))
    f, t = f + np.linalg.norm(rod.force, axis=1), t + np.linalg.norm(rod.torque, axis=1)
    t += np.linalg.norm(rod.levered, axis=2).sum(axis=0)
    rounding = SUM_ROUNDING * max(1.0, n * len(f) / 10_000)
    force = e + n * d + rounding * (f + n * U)
    torque = torque_error + n * d * lever + position_error * (f_E + f_C)
    torque += rounding * (t + n * lever * (f + h + g + U))
    tip = rod.farthest or B + mass.lever * (task.farthest_end_effector(n) / unit + TOLERANCE)
    wall = rounding * (float(levers.centre.max()) + walls.length + float(np.abs(walls.offset).max(initial=0.0)))
    return Slack(force, torque, wall, tip)
