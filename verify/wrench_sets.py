"""Check that load cases that represent a set of wrenches can exert all of it.

| symbol | meaning | shape | unit |
|---|---|---|---|
| v | inputs over the largest input of a rotor, between the least and the largest that a design may use | (4n,) | |
| A | wrench map about the COM, W = A v | (6, 4n) | m_t g, l_arm m_t g |
| b | wrench of a corner of a set | (6,) | the same |

The wrenches of all v are a convex set, so the corners decide. A design has no inputs for them: each is a linear
program of the audit's own, with inputs that produce the corner, or multipliers that show that none do, in hand.
What neither shows is undecided.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from topo_search.model import Design, Residual, Status
from topo_search.model.corners import corners_of
from topo_search.model.proven import TOLERANCE
from verify.flight.programs import LARGEST, Box, find_solutions
from verify.kinematics import Platform
from verify.residuals import residual
from verify.wrench import required_wrench, wrench_map


def corner_residuals(design: Design, platform: Platform) -> Iterator[Residual]:
    """Yield by how much the best inputs miss each corner: the largest of its equations."""
    task, n = design.task, design.topology.n
    corners = corners_of(task)
    if not corners:
        return
    unit = np.repeat([task.force_unit(n), task.torque_unit(n)], 3)
    A = wrench_map(platform, task.module) * task.module.max_input(task.gravity) / unit[:, None]
    b = np.array([required_wrench(case, platform.p_e) for _, case in corners]) / unit
    box = Box(np.full(4 * n, task.module.min_input), np.full(4 * n, task.search.peak_input))
    if np.abs(A).max() <= LARGEST and np.abs(b).max() <= LARGEST:
        solvable = find_solutions(A, b, box)
        error = solvable.v @ A.T - b
        about_tip = error[:, 3:] - np.cross(platform.p_e / task.module.arm_length, error[:, :3])
        parts = np.linalg.norm([error[:, :3], error[:, 3:], about_tip], axis=2)
        yes, no = solvable.yes & np.all(parts <= TOLERANCE, axis=0), solvable.no
        missed = np.abs(error).max(axis=1)
    else:  # the digits that programs need are lost
        yes, no, missed = np.zeros(len(b), dtype=bool), np.zeros(len(b), dtype=bool), np.zeros(len(b))
    for k, (label, _) in enumerate(corners):
        status = Status.CLEAR if yes[k] else Status.VIOLATED if no[k] else Status.UNDECIDED
        yield residual(label, float(missed[k]), "m_t g, l_arm m_t g", 1.0, status=status)
