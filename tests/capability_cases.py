"""Platforms and what they hold of a maximised quantity, by own linear programs."""

import math
from functools import cache

import numpy as np
from nlp_cases import push, random_tree
from scipy.optimize import linprog
from test_nlp_bounds_branch import placed

from topo_search.model.corners import to_corners
from topo_search.model.maximized import task_at
from verify.kinematics import Platform, poses, required_wrench, wrench_map

HOVER = {"name": "hover", "carries_weight": True}
SIDE = {"name": "side", "carries_weight": True, "end_effector": {"force": [0.1, 0.0, 0.0]}}
QUANTITIES = ("force_reserve", "torque_reserve", "load", "payload")


@cache
def task_of(quantity, n, directions="horizontal", cases="hover side"):
    """A task of n modules that maximises a quantity."""
    flight = {"at": "com", "directions": directions}
    stated = [case for case in (HOVER, SIDE) if case["name"] in cases]
    return push(n, load_cases=stated, search={"maximize": quantity}, flight=flight)


def platform_at(task, tree, theta, tip):
    """A platform with these angles and, unless the task fixes it, its end-effector there."""
    module = task.module
    at = poses(tree, theta[:3], theta[3:], module.connector_distance)
    joints, p_COM, tip = placed(task, tree, at, tip)
    o = at.p - p_COM
    turned = np.einsum("nij,qj->nqi", at.R, module.arm_length * module.rotor_table.positions)
    axes = np.einsum("nij,qj->nqi", at.R, module.rotor_table.axes)
    return Platform(at, p_COM, o, tip - p_COM, tip, o[:, None] + turned, axes, joints - p_COM)


def drawn(task, rng):
    """A random tree with its angles and its end-effector, bent little enough to hover now and then."""
    tree = random_tree(task.n, rng, aligned=True)
    bend = rng.choice([0.2, 0.6, 1.0])
    root = np.array([rng.uniform(-math.pi, math.pi), *rng.normal(size=2) * bend / 2])
    theta = np.concatenate([root, np.clip(rng.normal(size=task.n - 1) * bend, -1.5, 1.5)])
    return tree, theta, rng.normal(size=3) * task.module.arm_length * rng.choice([0.1, 1.0, 3.0])


def wrenches(task, platform, value, towards=()):
    """All wrenches that T(s) requires, shape (K, 6) [N, N m]."""
    stated = to_corners(task_at(task, value).with_fields("search", towards=towards), inner=True)
    return np.array([required_wrench(case, platform.p_e) for case in stated.load_cases])


def meets(task, platform, value, towards=()):
    """True if inputs within limits produce every wrench of T(s)."""
    return all(_solved(task, platform, b) for b in wrenches(task, platform, value, towards))


def produced(task, platform, case):
    """True if inputs within limits produce the wrench of a load case."""
    return _solved(task, platform, required_wrench(case, platform.p_e))


def held(task, platform, towards=()):
    """The largest s of T(s), whose wrenches are linear in s; None if the platform does not even meet T(0)."""
    if not meets(task, platform, 0.0):
        return None
    unit = 0.01
    stated, double = (wrenches(task, platform, k * unit, towards) for k in (1, 2))
    slopes = (double - stated) / unit
    at_0 = stated - unit * slopes
    sizes = [_solved(task, platform, b, d) for b, d in zip(at_0, slopes, strict=True) if d.any()]
    return min(sizes, default=math.inf)


def _solved(task, platform, b, d=None):
    """Return whether inputs produce b, or the largest s for which they produce b + s d."""
    A, low, high = wrench_map(platform, task.module), task.min_input, task.max_input
    scale = np.array([1.0, 1.0, 1.0, *[1 / task.module.arm_length] * 3]) / task.force_unit(task.n)
    columns, bounds, cost = A * high, [(low / high, 1.0)] * A.shape[1], np.zeros(A.shape[1])
    if d is not None:
        columns, bounds, cost = np.column_stack([columns, -d]), [*bounds, (0.0, None)], np.append(cost, -1.0)
    found = linprog(cost, A_eq=columns * scale[:, None], b_eq=b * scale, bounds=bounds)
    if d is None:
        return found.status == 0
    return found.x[-1] if found.status == 0 else (math.inf if found.status == 3 else 0.0)
