r"""Rods with mass in the check of a proof: the wrench that any rod adds, as an interval.

A record bounds the platform without its rod. Let the rod of a clear design have the mass s X, X the greatest such
mass and 0 <= s <= 1, and its middle at r, and let M be the mass of the rest, or that of modules and joints alone if
p_E is fixed. The forces H_k = f_C (f_E + f_C if p_E is fixed) act at the centre of mass, at

    p_COM = (M p_0 + s X r) / (M + s X),

where p_0 is that point for s = 0. With the accelerations a_k(s) = H_k(s) / (M + s X) their torque is

    p_COM x H_k(s) = M p_0 x a_k(s) + s X r x a_k(s).

All wrenches are affine in s, so a_k(s) = a_k(0) + theta (a_k(1) - a_k(0)), with the same share
theta = s (M + X) / (M + s X) <= s (1 + X / M) for all load cases. So the multipliers y_k = (nu_k, mu_k) of a bound
lose, relative to s = 0,

    loss = -s (sum_k nu_k . df_k + mu_k . dt_k + p'_E . sum_k df_E,k x mu_k + X r . sum_k a_k(s) x mu_k)
           - theta M p_0 . sum_k (a_k(1) - a_k(0)) x mu_k,

where d is the change from s = 0 to 1; if p_E is fixed, dt_k includes p_E x df_E,k and the term with p'_E is left
out. With r = (c + p'_E) / 2, c the rod's connector, that is at most

    s [C |V / 2| + P |G + V / 2| + (1 + X / M) M P_0 |sum_k (a_k(1) - a_k(0)) x mu_k|
       - sum_k (nu_k . df_k + mu_k . dt_k)],    G = sum_k df_E,k x mu_k,    V = X sum_k a_k x mu_k,

with C, P and P_0 the greatest lengths of c, p'_E and p_0. It is convex in V, so one of V(0) and V(1) gives the
greatest value; and as 0 <= s <= 1, the loss is at most this bracket with s = 1, or zero.
"""

import math
from typing import NamedTuple

import numpy as np

from topo_search.compiled_code import njit
from topo_search.model import Array, ResolvedTask
from topo_search.model.proven import TOLERANCE


class RodInterval(NamedTuple):
    """Rods of a task, in the units of `verify.proof.platform`."""

    max_mass: float
    """X [kg]; 0 if no rod has mass."""
    max_tip_distance: float
    """P."""
    max_connector_distance: float
    """C."""
    df: Array
    """Shape (K, 3)."""
    dt: Array
    """Shape (K, 3)."""
    df_tip: Array
    """df_E,k; 0 if p_E is fixed; shape (K, 3)."""
    weight: Array
    """X a_k without and with the heaviest rod, shape (2, K, 3)."""
    shifted: Array
    """(1 + X / M) M P_0 (a_k(1) - a_k(0)), shape (K, 3)."""
    magnitude: Array
    """Magnitude of all factors of mu_k, for the allowance for rounding, shape (K,)."""


def rod_interval(
    task: ResolvedTask,
    light: tuple[Array, Array, Array],
    heavy: tuple[Array, Array, Array],
    depth: int,
    centroid: float,
) -> RodInterval:
    """Return the interval of a task's rods.

    Args:
        task: task without a counted rod.
        light: f_E, f_C and torque of every load case without a rod, shape (K, 3) each.
        heavy: the same with the heaviest rod.
        depth: greatest number of hinges between the root and a module.
        centroid: greatest distance of C from the origin, over the arm.
    """
    l_arm, X, bodies = task.module.arm_length, task.heaviest_rod, task.total_mass(task.n) - task.end_effector.mass
    (f_E, f_C, _), (df_E, df_C, dt) = light, (b - a for a, b in zip(light, heavy, strict=True))
    largest_reach = task.largest_reach(task.n)
    reach = 0.0 if largest_reach is None else largest_reach / l_arm + TOLERANCE
    C = (2 * depth + 1) * task.module.connector_distance / l_arm
    P, M, H, dH, df_tip, tip = C + reach, bodies + task.end_effector.mass, f_C, df_C, df_E, C + reach
    if task.end_effector.fixed_position is not None:
        p_E = np.array(task.end_effector.fixed_position) / l_arm
        M, H, dH, df_tip, tip = bodies, f_E + f_C, df_E + df_C, np.zeros_like(df_E), math.hypot(*p_E)
        dt = dt + np.cross(p_E, df_E)
    a = np.array([H / M, (H + dH) / (M + X)])
    max_com_distance = centroid + task.end_effector.mass / bodies * tip
    shifted = (M + X) * max_com_distance * (a[1] - a[0])
    magnitude = np.linalg.norm([dt, shifted, P * df_tip, P * X * a[0], P * X * a[1]], axis=2).sum(axis=0)
    return RodInterval(X, P, C, df_E + df_C, dt, df_tip, X * a, shifted, magnitude)


@njit(cache=True, allocates=False)
def rod_loss(rod: RodInterval, y: Array) -> float:
    """Return the greatest loss to a rod of the bound with multipliers y, shape (K, 6)."""
    if rod.max_mass == 0.0:
        return 0.0
    gain, (gx, gy, gz), largest = 0.0, _torque_sum(rod.df_tip, y), 0.0
    for k in range(len(y)):
        for l in range(3):
            gain += rod.df[k, l] * y[k, l] + rod.dt[k, l] * y[k, 3 + l]
    for end in range(2):
        x, y_, z = _torque_sum(rod.weight[end], y)
        at_connector = math.sqrt(x * x + y_ * y_ + z * z) / 2
        x, y_, z = gx + x / 2, gy + y_ / 2, gz + z / 2
        at_tip = math.sqrt(x * x + y_ * y_ + z * z)
        largest = max(largest, rod.max_connector_distance * at_connector + rod.max_tip_distance * at_tip)
    x, y_, z = _torque_sum(rod.shifted, y)
    return max(0.0, largest + math.sqrt(x * x + y_ * y_ + z * z) - gain)


@njit(cache=True, inner=True, allocates=False)
def _torque_sum(forces: Array, y: Array) -> tuple[float, float, float]:
    """Return sum_k forces_k x mu_k."""
    a, b, c = 0.0, 0.0, 0.0
    for k in range(len(y)):
        (x, y_, z), mu = forces[k], y[k, 3:]
        a, b, c = a + y_ * mu[2] - z * mu[1], b + z * mu[0] - x * mu[2], c + x * mu[1] - y_ * mu[0]
    return a, b, c
