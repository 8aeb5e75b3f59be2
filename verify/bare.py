"""The best inputs found for a platform that came without any: one convex program a load case.

| symbol | meaning | shape | unit |
|---|---|---|---|
| v | inputs over the largest input of a rotor, between the least and the largest that a design may use | (4n,) | |
| A | wrench map about the COM, W = A v | (6, 4n) | m_t g, l_arm m_t g |
| b | required wrench of each load case | (K, 6) | the same |
"""

from __future__ import annotations

import numpy as np

from topo_search.model import Design, Geometry, ResolvedTask
from topo_search.model.module import CountedRod
from verify.assembly import choose_mount
from verify.bodies import Array
from verify.flight.inputs import least_inputs
from verify.flight.programs import LARGEST, Box, find_solutions, nearest
from verify.kinematics import Platform, platform
from verify.parts import rigid_parts
from verify.rod import straight_rod
from verify.wrench import objective, required_wrench, wrench_map


def complete(geometry: Geometry) -> Design:
    """Return the design of a geometry: with the rod that its task counts, and with the best inputs found.

    Of a load case that no inputs produce, it has inputs that miss it least.
    """
    if isinstance(geometry, Design):
        return geometry
    fields = {name: getattr(geometry, name) for name in Geometry.model_fields}
    idle = ((0.0,) * (4 * geometry.topology.n),) * len(geometry.task.load_cases)
    design = _count_rod(Design(**fields, rotor_speeds_squared=idle, objective=0.0, inputs_computed=True))
    u = _least(design.task, platform(design))
    design = design.model_copy(update={"rotor_speeds_squared": tuple(map(tuple, u.tolist()))})
    return design.model_copy(update={"objective": objective(design)})


def _count_rod(design: Design) -> Design:
    """Return a design with the rod of its mount, else of the best, if its task counts one and does not name it."""
    end_effector, l_arm = design.task.end_effector, design.task.module.arm_length
    if end_effector.rod_mass == "ignored" or end_effector.counted_rod is not None:
        return design
    mount, parts = design.mount or choose_mount(design), rigid_parts(design, platform(design))
    if mount is None or not parts.in_range:
        return design
    mass = end_effector.rod_linear_density * l_arm * straight_rod(design, parts, mount).length
    rod = CountedRod(module=mount.module, port=mount.port, mass=mass)
    return design.model_copy(update={"mount": mount, "task": design.task.with_rod(rod)})


def _least(task: ResolvedTask, at: Platform) -> Array:
    """Return the inputs of every load case, shape (K, 4n) [rad^2/s^2]; zeros where numbers are too large."""
    unit = np.repeat([task.force_unit(task.n), task.torque_unit(task.n)], 3)
    A = wrench_map(at, task.module) * task.max_input / unit[:, None]
    b = np.array([required_wrench(case, at.p_e) for case in task.load_cases]) / unit
    N = A.shape[1]
    if not (np.abs(A).max() <= LARGEST and np.abs(b).max() <= LARGEST):
        return np.zeros((len(b), N))
    box = Box(np.full(N, task.min_input / task.max_input), np.ones(N))
    reached = find_solutions(A, b, box)
    v = reached.v.copy()
    for k, b_k in enumerate(b):
        if reached.yes[k]:
            least = least_inputs(A, A @ v[k], box)
            v[k] = v[k] if least is None else least
        else:
            v[k], _ = nearest(A, b_k, box.low, box.high)
    return np.asarray(v * task.max_input)
