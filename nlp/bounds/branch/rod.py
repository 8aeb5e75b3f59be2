r"""Load cases of a platform whose rod has mass, for bounds that hold for rods of any mass and at any connector.

A bound of the lightest platform, less a loss, holds for every clear design at the same angles. The angles and the
end-effector are the design's own, or the end-effector is fixed relative to the centre of mass.

| symbol | meaning |
|---|---|
| x, X | mass of the design's rod, and of the heaviest one of a clear design; s = x / X |
| c, r | connector of the rod; middle of the rod, (c + p'_E) / 2 |
| M | mass of the lightest platform, m_t - m_R; for a fixed end-effector that of modules and joints |
| p_0 | centre of mass of the lightest platform at these angles |
| H_k | force with the lever p_COM: f_C, for a fixed end-effector f_E + f_C |
| d | change by the heaviest rod: a load case is affine in x, so f_k + s df_k is that of the design |

**Loss.** With the rod the centre of mass is p_COM = p_0 + x (r - p_0) / (M + x). The torque of load case k about
the origin of W, tau_k + p_COM x H_k + q x f_E with q = p'_E, or the fixed p_E, exceeds that of the lightest
platform by

.. math::

    s \; r \times dH_k + \frac{x}{M + x} (r - p_0) \times \Big(H_k - \frac{M}{X} dH_k\Big)
    + s \; (d\tau_k + q \times df_{E,k})

since x (H_k + s dH_k) / (M + x) = s dH_k + x (H_k - (M / X) dH_k) / (M + x). As mu . (p x f) = p . (f x mu) and
x / (M + x) <= s X / M, D exceeds that of the lightest platform by at least

.. math::

    s \Big[\sum_k \nu_k \cdot df_k + \mu_k \cdot dt_k - |p'_E| \Big|\sum_k (df_{E,k} + dH_k / 2) \times \mu_k\Big|
    - |c| \Big|\sum_k dH_k / 2 \times \mu_k\Big|
    - |r - p_0| \Big|\sum_k (X H_k / M - dH_k) \times \mu_k\Big|\Big]

where, if the end-effector is fixed, dt_k includes p_E x df_E and the second sum has no df_E. As 0 <= s <= 1, that
is at least the smaller of 0 and the bracket. Mostly it is 0: a heavier platform needs more effort.

**Distances.** A connector is at most l_c (2 depth + 1) from the origin, which is the root module's centre, and p'_E
at most the largest reach (with the audit's tolerance) from a connector. |p_0| is at most the mean distance of
modules and joints plus m_E / (m_t - m_E) times |p'_E|, or |p_E| if that is fixed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from nlp.numbers.masses import Masses
from nlp.units import Units
from topo_search.model import Array, LoadCase, ResolvedTask
from topo_search.model.proven import TOLERANCE


class RodChange(NamedTuple):
    """Changes of the load cases by the heaviest rod, in the units of `nlp.bounds.branch.arrays`."""

    force: Array
    """df_k, shape (K, 3)."""
    torque: Array
    """dt_k, shape (K, 3)."""
    levered: Array
    """Forces of the last three sums times the greatest distances, shape (3, K, 3); (0, K, 3) without a rod."""
    mass: float
    """X [m]."""
    farthest: float
    """Greatest |p'_E|; 0 without a rod."""


def wrenches(cases: Sequence[LoadCase], unit: Units) -> tuple[Array, Array, Array]:
    """Return f_E, f_C and tau of load cases, shape (K, 3) each."""
    tip, com = [case.at_end_effector for case in cases], [case.at_com for case in cases]
    f_E, f_C = (np.array([w.force for w in wrenches]) / unit.force for wrenches in (tip, com))
    return f_E, f_C, np.add([w.torque for w in tip], [w.torque for w in com]) / unit.torque


def rod_change(
    task: ResolvedTask, heaviest: Sequence[LoadCase], mass: Masses, farthest_connector: float, body_distance: float
) -> RodChange:
    """Return the changes of the load cases of a task.

    Args:
        task: task of the lightest platform, with its corners.
        heaviest: the load cases for the heaviest rod.
        mass: masses of the lightest platform.
        farthest_connector: greatest |c| [l_arm].
        body_distance: mean distance of modules and joints from the origin [l_arm].
    """
    unit, K = Units.of(task), len(task.load_cases)
    if task.heaviest_rod == 0.0:
        return RodChange(np.zeros((K, 3)), np.zeros((K, 3)), np.zeros((0, K, 3)), 0.0, 0.0)
    (f_E, f_C, t), with_rod = wrenches(task.load_cases, unit), wrenches(heaviest, unit)
    df_E, df_C, dt = (heavy - light for heavy, light in zip(with_rod, (f_E, f_C, t), strict=True))
    X, reach = task.heaviest_rod / mass.module, (task.largest_reach(task.n) or 0.0) / unit.length + TOLERANCE
    farthest, middle = farthest_connector + reach, farthest_connector + reach / 2
    H, dH, at_tip, M, tip_distance = f_C, df_C, df_E, mass.total, farthest
    if (position := task.end_effector.fixed_position) is not None:
        p_E = np.array(position) / unit.length
        H, dH, at_tip, M, tip_distance = f_E + f_C, df_E + df_C, 0.0 * df_E, mass.bodies, float(np.linalg.norm(p_E))
        dt = dt + np.cross(p_E, df_E)
    to_com = middle + body_distance + (mass.lever - 1) * tip_distance
    levered = [farthest * (at_tip + dH / 2), farthest_connector * dH / 2, to_com * (X / M * H - dH)]
    return RodChange(df_E + df_C, dt, np.array(levered), X, farthest)
