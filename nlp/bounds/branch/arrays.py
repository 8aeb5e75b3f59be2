"""A task and a tree as the numbers that the branch and bound works on.

Lengths in l_arm, forces in m g, inputs in the hover input of a module, efforts in the square of that. With `free`
root orientation the tree is rooted at its centre, which makes the paths from the root short.

| symbol | meaning | shape |
|---|---|---|
| n, K, A | modules, load cases, angles: psi, alpha_0, alpha_1, then the hinges; A = n + 2 | |
| f_k | force f_E + f_C of load case k | (K, 3) |
| t_k, h_k | its torque about the origin of W is t_k + sum_i p_i x h_k + p'_E x g_k | (K, 3) each |
| g_k | what p'_E is the lever of; 0 where the task fixes the end-effector from the COM | (K, 3) |
| lambda_k | weight, in the largest | (K,) |
| n_r | outward normal of the half-space that row r keeps an end of an envelope in | (W, 3) |

Load cases are followed by the corners of sets of wrenches, of reserves and of rotor failures, which weigh nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlp.numbers.geometry import torque_map
from nlp.numbers.masses import Masses, masses
from nlp.units import Units
from topo_search.model import ResolvedTask, Topology
from topo_search.model.arrays import PORT_DIRECTIONS, ROTOR_DIRECTIONS, Array
from topo_search.model.corners import CorneredTask
from topo_search.model.exposure import half_spaces
from topo_search.model.proof import Problem, proof_task
from topo_search.model.proven import TOLERANCE
from topo_search.model.shape import NOWHERE
from topo_search.model.topology import ROOT, Joint
from topo_search.model.value import Vector

Indices = NDArray[np.int64]

HALF_TURN = math.pi * (1 + 1e-12)
"""Boxes of the root orientation reach a little beyond pi, which no float is."""
SUM_ROUNDING = 1e-11
"""Share of the largest terms of a sum that is left to rounding, up to n K = 10,000 (`nlp.bounds.branch.box`)."""


class Tree(NamedTuple):
    """Parents, ports and paths of the modules."""

    parent: Indices
    """-1 for the root; parents come first."""
    port: Indices
    kappa: Indices
    depth: Indices
    """Hinges between the root and a module."""
    path: Indices
    """Angles that move module i, outermost first: psi, alpha_0, alpha_1, then hinges; shape (n, A), -1 beyond."""
    first: Indices
    """Index of the first of module i's 2^depth[i] vertices in a table of all, then the table's length: (n + 1,)."""
    bolted: NDArray[np.bool_]
    """Shape (n, n)."""


class Levers(NamedTuple):
    """Greatest distances over all angles [l_arm]."""

    rotor: Array
    """Greatest distance of module i's rotors from the axis of angle a, with the lever of drag; shape (n, A)."""
    centre: Array
    """Greatest distance of its centre, shape (n, A)."""
    body: Array
    """Greatest distance of its body's moment (`BranchProblem.bodies`); shape (n, A)."""
    between: Array
    """Greatest distance between the axes of two angles; shape (A, A)."""


class Loads(NamedTuple):
    """The load cases."""

    f: Array
    t: Array
    h: Array
    g: Array
    weight: Array
    dead: Indices
    """Rotor at rest, 4 i + q, or -1, shape (K,)."""
    project: Array
    """Pseudo-inverse of sum_k [g_k]x [g_k]x^T, shape (3, 3)."""


class Walls(NamedTuple):
    """Half-spaces about a free end-effector: row r holds n_r . (e_r - p'_E) + d_r <= 0, e_r of an envelope."""

    normal: Array
    module: Indices
    end: Indices
    """0: at the module, 1: far down its airflow."""
    beyond: Array
    """d_r, the radius of the end less the offset of the half-space [l_arm], shape (W,)."""
    length: float
    """Distance of the two ends [l_arm]."""


class Slack(NamedTuple):
    """Losses of a dual value: to deviations that an audit lets pass, and to rounding."""

    force: Array
    """Loss per unit of |nu_k|, shape (K,)."""
    torque: Array
    """Loss per unit of |mu_k|, shape (K,)."""
    wall: float
    """Loss per unit of a wall's multiplier."""
    tip: float
    """Greatest |p'_E| [l_arm]."""


class Separation(NamedTuple):
    """Required separation of modules and airflow [l_arm]."""

    airflow: bool
    length: float
    start_radius: float
    growth: float
    apart: float
    """Least distance of centres; 0 without a limit."""
    of_all: bool
    """True if that is asked of modules that share a joint, too."""
    margin: float
    """By which, to first order, envelopes are to clear each other, or parts."""
    parts: Array
    """Balls that keep out of the airflow of modules that share no joint: x, y, z, radius; shape (b, 4)."""


class BranchProblem(NamedTuple):
    """A task and a tree."""

    tree: Tree
    levers: Levers
    loads: Loads
    walls: Walls
    slack: Slack
    separation: Separation
    bodies: Array
    """Mass of a module with its joints over the mean, and its moments along x and y of the module, shape (n, 3)."""
    torques: Array
    """Torque of each rotor about its module's centre at unit thrust, shape (4, 3)."""
    l_c: float
    u_min: float
    u_max: float
    """Both limits include the audit's tolerance."""
    angles: Array
    """Angles that hinges may have, in order; empty if any will do [rad]."""


def to_arrays(task: ResolvedTask, topology: Topology, problem: Problem = "task") -> BranchProblem:
    """Return the numbers of a task and a tree, which must be rooted at its `centre`.

    Args:
        task: the task.
        topology: the tree.
        problem: which designs the proof is about (`topo_search.model.proof`).
    """
    n, unit, module = topology.n, Units.of(task), task.module
    l_c = module.connector_distance / unit.length
    drag = module.torque_coefficient / (module.thrust_coefficient * module.arm_length)
    tree, carried = _tree(topology), masses(module, task.end_effector, topology)
    bodies = np.column_stack([carried.modules, carried.modules[:, None] * carried.centres]) * n / carried.bodies
    levers = _levers(tree, l_c, drag, bodies)
    cornered = proof_task(task, problem)
    loads, walls, U = _loads(cornered, carried, unit), _walls(task, unit), task.max_thrust_to_weight
    air, kind = module.envelope, task.search.interference
    margin, body = 0.0, task.body_clearance
    if problem == "solver":
        margin, body = task.search.margin, task.centre_distance
    apart = task.separation if kind == "separation" else body or 0.0
    apart = math.sqrt(apart * (apart + 2 * margin))
    length, start_radius, growth = (x / unit.length for x in (air.length, air.start_radius, air.growth))
    return BranchProblem(
        tree,
        levers,
        loads,
        walls,
        _slack(cornered, tree, levers, loads, walls, carried, U),
        Separation(
            airflow=kind == "airflow",
            length=length,
            start_radius=start_radius,
            growth=growth,
            apart=apart / unit.length,
            of_all=kind == "separation",
            margin=margin / unit.length,
            parts=_parts(task, problem) / unit.length,
        ),
        bodies,
        4 * torque_map(module).T,
        l_c,
        max(0.0, task.min_thrust_to_weight - U * TOLERANCE),
        U * (1 + TOLERANCE),
        hinge_angles(task),
    )


def _parts(task: ResolvedTask, problem: Problem) -> Array:
    """Return balls that keep out of other modules' airflow: the solver's, or some that the parts hold [m].

    These are points of the rotors' rims, towards the arm and the two ports beside it, balls between the faces of
    rotors, and one in the hub.
    """
    module, body = task.module, task.module.body
    if task.search.interference != "parts":
        return np.empty((0, 4))
    if problem == "solver":
        return np.column_stack(task.part_cover)
    rotors, ports = ROTOR_DIRECTIONS, PORT_DIRECTIONS
    rims = [(a, out) for a in rotors for out in (a, *(e for e in ports if e @ a > 0))]
    balls = [(*(module.arm_length * a), min(body.rotor_radius, body.rotor_height / 2)) for a in rotors]
    balls += [(*(module.arm_length * a + body.rotor_radius * out), 0.0) for a, out in rims]
    if body.frame is None:
        balls.append((0.0, 0.0, 0.0, min(body.hub) / 2))
    return np.array(balls)


def effort_unit(task: ResolvedTask) -> float:
    """Return the unit of efforts [rad^4/s^4]."""
    return Units.of(task).input ** 2 * max(case.weight for case in task.load_cases)


def hinge_angles(task: ResolvedTask) -> Array:
    """Return the angles that hinges may have, in order; empty if any will do [rad].

    Either sign of an angle is there, so that it does not matter from where a hinge is looked at.
    """
    return np.array([math.radians(angle) for angle in task.search.hinge_set_deg or ()])


def whole_box(task: ResolvedTask, n: int) -> tuple[Array, Array]:
    """Return the box of all angles, from and to, shape (A,) each [rad]: a design's, and what an audit lets pass."""
    angles = hinge_angles(task)
    quarter = np.full(n - 1, math.pi / 2 + TOLERANCE)
    root = [HALF_TURN, math.pi / 2 * (1 + 1e-12), HALF_TURN]
    if task.search.root == "paper":
        root = [TOLERANCE, math.pi / 2 + TOLERANCE, math.pi / 2 + TOLERANCE]
    most = np.concatenate([root, quarter])
    lower, upper = -most, most.copy()
    if len(angles):
        lower[3:], upper[3:] = angles[0], angles[-1]
    return lower, upper


def centre(task: ResolvedTask, topology: Topology) -> int:
    """Return the root of a tree in a proof: its centre, the first if there are two."""
    import networkx as nx

    return 0 if task.search.root == "paper" else min(nx.center(topology.graph()))


def reroot(topology: Topology, root: int) -> Topology:
    """Return the tree rooted at another module: breadth first, ports in order."""
    graph, joints, queue = topology.graph(), list[Joint](), [(root, -1, ROOT)]
    for i, came_from, joint in queue:
        number = len(joints)
        joints.append(joint)
        beyond = [(graph[i][j]["ports"][i], j) for j in graph[i] if j != came_from]
        queue += [(j, i, (number, port, graph[i][j]["ports"][j])) for port, j in sorted(beyond)]
    return Topology(tuple(joints))


def _tree(topology: Topology) -> Tree:
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
    parent, port, kappa, depth, path, first = (
        x.astype(np.int64) for x in (parent, port, np.array(topology.kappas), depth, path, first)
    )
    return Tree(parent, port, kappa, depth, path, first, bolted)


def _levers(tree: Tree, l_c: float, drag: float, bodies: Array) -> Levers:
    """Return the distances along the tree stretched out; an axis is l_c before its module, the root's 0."""
    n = len(tree.parent)
    before = np.concatenate([np.zeros(3), l_c * (2 * tree.depth[1:] - 1)])
    centre = np.abs(2 * l_c * tree.depth[:, None] - before)
    body = bodies[:, :1] * centre + np.linalg.norm(bodies[:, 1:], axis=1)[:, None]
    return Levers(centre + 1 + drag, centre, body, np.abs(before[:, None] - before[None, :])[: n + 2])


def _loads(task: ResolvedTask, carried: Masses, unit: Units) -> Loads:
    cases, position = task.load_cases, task.end_effector.fixed_position
    tip, com = [case.at_end_effector for case in cases], [case.at_com for case in cases]
    f_E, f_C = (np.array([w.force for w in at]) / unit.force for at in (tip, com))
    t = np.add([w.torque for w in tip], [w.torque for w in com]) / unit.torque
    n, share = task.n, carried.tip / carried.total
    weight = np.array([case.weight for case in cases])
    dead = np.array([-1 if rotor is None else rotor for rotor in task.dead_rotors])
    if position is None:
        g, h = f_E + share * f_C, f_C / (carried.total * (n / carried.bodies))
    else:  # p'_E and the COM from B (`nlp.numbers.masses`)
        p_E = np.array(position) / unit.length
        t = t + carried.lever * np.cross(p_E, f_E) + carried.tip / carried.bodies * np.cross(p_E, f_C)
        g, h = np.zeros_like(f_E), (f_E + f_C) / n
    crosses = sum(((g_k @ g_k) * np.eye(3) - np.outer(g_k, g_k) for g_k in g), np.zeros((3, 3)))
    project = np.linalg.pinv(crosses, rcond=1e-9, hermitian=True)
    return Loads(f_E + f_C, t, h, g, weight / weight.max(), dead, project)


def _walls(task: ResolvedTask, unit: Units) -> Walls:
    """Return the half-spaces of the exposure, but of a fixed end-effector, which follows the centre of mass."""
    air, rows = task.module.region_envelope, list[tuple[Vector, int, int, float]]()
    for _, axis, apex in half_spaces(task.exposure) if task.end_effector.fixed_position is None else ():
        x, y, z = axis or NOWHERE
        offset = -float(np.dot((x, y, z), apex))
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
    task: ResolvedTask, tree: Tree, levers: Levers, loads: Loads, walls: Walls, carried: Masses, U: float
) -> Slack:
    """Return what deviations within an audit's tolerance and rounding take from a dual value.

    With e = TOLERANCE m_t g a force may be off by e, a torque about the COM and about the end-effector by l_arm e
    each, hence about B by (1 + 2 m_E / (m_t - m_E)) l_arm e (`nlp.bounds.wrenches`), and about the origin of W by
    the distance of B times e more. Every input may be d = TOLERANCE U beyond its limits: of
    those below zero a rotor's psi gains d |a_j . y| at most. A fixed end-effector may be TOLERANCE l_arm off.
    Hover and other centres of reserves may be off by e along every axis, their torques about the COM alone, where
    that may be: B is m_E / (m_t - m_E) p_E from it.
    """
    n, unit = len(tree.parent), task.module.arm_length
    e, d = TOLERANCE * carried.total, TOLERANCE * U
    about_B = (2 * carried.lever - 1) * e
    if isinstance(task, CorneredTask):
        e *= math.sqrt(3)
        moved = (carried.lever - 1) * task.longest_lever(n) + math.sqrt(3) * task.declared.flight.com_error
        about_B = max(about_B, (1 + moved / unit) * e)
    B, lever = float(levers.body[:, 0].mean()), float(levers.rotor.max())  # the first axis is through the origin
    both = [math.hypot(*case.at_end_effector.force) + math.hypot(*case.at_com.force) for case in task.load_cases]
    off = 0.0 if task.end_effector.fixed_position is None else TOLERANCE * carried.lever
    f, t, h = (np.linalg.norm(x, axis=1) for x in (loads.f, loads.t, loads.h))
    rounding = SUM_ROUNDING * max(1.0, n * len(f) / 10_000)
    force = e + n * d + rounding * (f + n * U)
    levered = f + h + np.linalg.norm(loads.g, axis=1)
    torque = about_B + e * B + n * d * lever + off * np.array(both) / Units.of(task).force
    torque = torque + rounding * (t + n * lever * (levered + U))
    tip = B + carried.lever * (task.farthest_end_effector(n) / unit + TOLERANCE)
    wall = rounding * (float(levers.centre.max()) + walls.length + float(np.abs(walls.beyond).max(initial=0.0)))
    return Slack(force, torque, wall, tip)
