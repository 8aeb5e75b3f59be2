"""Rotor inputs of a bare geometry, feasibility of the vertices of wrench sets, and power.

| symbol | meaning | shape | unit |
|---|---|---|---|
| N | number of rotors; types of module may have fewer than r | | |
| v | inputs over u_max of `[module]`, between the limits for a design | (N,) | |
| A | wrench map about the COM, W = A v | (6, N) | m_t g, l_arm m_t g |
| b | required wrench of each load case, or of each vertex of a set | (K, 6) | the same |

The best inputs come from one convex program per load case. The wrenches of all v are a convex set, so a wrench set
is feasible if its vertices are. A design holds no inputs for vertices: for each, the audit solves a linear program
that yields inputs that produce the vertex, or multipliers that prove that none do. Otherwise it is undecided.

Power:

| symbol | meaning | unit |
|---|---|---|
| u | squared speeds of all rotors: the design's; in hover, those of least effort | rad^2/s^2 |
| P_0, P | ideal power, sum_j (k_f u_j)^1.5 / sqrt(2 rho pi R^2); shaft power, sum_j k_tau u_j^1.5 | W |
| FM | figure of merit, P_0 / P | |

The endurance is an upper bound for any inputs within their limits that produce the wrench: of the least P among
them, a convex program, only a lower bound is used, and motors, controllers and wires draw more.
"""

from collections.abc import Iterator

import numpy as np

from topo_search.model import (
    Array,
    CasePower,
    CountedRod,
    Design,
    Flight,
    Geometry,
    Residual,
    ResolvedTask,
    Status,
)
from topo_search.model.corners import corners_of
from topo_search.model.proven import TOLERANCE
from verify.assembly import choose_mount
from verify.flight.programs import LARGEST, Bounds, find_solutions, least_inputs, nearest
from verify.kinematics import Platform, has_rotor, objective, per_rotor, platform, required_wrench, wrench_map
from verify.requirements import Scene
from verify.residuals import clamp, residual
from verify.sections import Findings


def complete(geometry: Geometry) -> Design:
    """Return a geometry as a design, with the rod whose mass its task includes and the best inputs.

    For a load case that no inputs produce, the inputs are those with the smallest residual.
    """
    if isinstance(geometry, Design):
        return geometry
    fields = {name: getattr(geometry, name) for name in Geometry.model_fields}
    idle = ((0.0,) * geometry.task.rotor_count,) * len(geometry.task.load_cases)
    design = _count_rod(Design(**fields, rotor_speeds_squared=idle, objective=0.0, inputs_computed=True))
    u = _best_inputs(design.task, platform(design))
    design = design.model_copy(update={"rotor_speeds_squared": tuple(map(tuple, u.tolist()))})
    return design.model_copy(update={"objective": objective(design)})


def _count_rod(design: Design) -> Design:
    """Return a design with its rod counted, from its own or the best mount, if its task includes an unnamed rod."""
    end_effector, l_arm = design.task.end_effector, design.task.module.arm_length
    if end_effector.rod_mass == "ignored" or end_effector.counted_rod is not None:
        return design
    mount, scene = design.mount or choose_mount(design), Scene(design)
    if mount is None or not scene.in_range:
        return design
    mass = end_effector.rod_linear_density * l_arm * scene.straight_rod(mount).length
    rod = CountedRod(module=mount.module, port=mount.port, mass=mass)
    return design.model_copy(update={"mount": mount, "task": design.task.with_rod(rod)})


def _best_inputs(task: ResolvedTask, platform: Platform) -> Array:
    """Return the inputs of every load case, shape (K, r n) [rad^2/s^2]; zeros if numbers are too large."""
    unit = np.repeat([task.force_unit(task.n), task.torque_unit(task.n)], 3)
    exists = has_rotor(task)
    A = wrench_map(platform, task.modules_of_nodes)[:, exists.ravel()] * task.max_input / unit[:, None]
    b = np.array([required_wrench(case, platform.p_e) for case in task.load_cases]) / unit
    u = np.zeros((len(b), exists.size))
    if not (np.abs(A).max() <= LARGEST and np.abs(b).max() <= LARGEST):
        return u
    shares = task.input_shares[exists]
    box = Bounds(task.min_input / task.max_input * shares, shares)
    solvable = find_solutions(A, b, box)
    v = solvable.v.copy()
    for k, b_k in enumerate(b):
        if solvable.yes[k]:
            best, _ = least_inputs(A, A @ v[k], box)
            v[k] = v[k] if best is None else best
        else:
            v[k], _ = nearest(A, b_k, box.low, box.high)
    u[:, exists.ravel()] = v * task.max_input
    return u


def corner_residuals(found: Findings) -> Iterator[Residual]:
    """Yield the residual of each vertex of the wrench sets: the largest error of its equations."""
    task, platform, n = found.scene.design.task, found.scene.platform, found.scene.design.topology.n
    corners = corners_of(task)
    if not corners:
        return
    unit = np.repeat([task.force_unit(n), task.torque_unit(n)], 3)
    exists, u_max = has_rotor(task), task.module.max_input(task.gravity)
    A = wrench_map(platform, task.modules_of_nodes)[:, exists.ravel()] * u_max / unit[:, None]
    b = np.array([required_wrench(case, platform.p_e) for _, case in corners]) / unit
    shares = task.input_shares[exists]
    box = Bounds(task.module.min_input * shares, task.search.peak_input * shares)
    if np.abs(A).max() <= LARGEST and np.abs(b).max() <= LARGEST:
        solvable = find_solutions(A, b, box)
        error = solvable.v @ A.T - b
        about_tip = error[:, 3:] - np.cross(platform.p_e / task.module.arm_length, error[:, :3])
        errors = np.linalg.norm([error[:, :3], error[:, 3:], about_tip], axis=2)
        yes, no = solvable.yes & np.all(errors <= TOLERANCE, axis=0), solvable.no
        largest = np.abs(error).max(axis=1)
    else:  # too large for the programs' precision
        yes, no, largest = np.zeros(len(b), dtype=bool), np.zeros(len(b), dtype=bool), np.zeros(len(b))
    for k, (label, _) in enumerate(corners):
        status = Status.CLEAR if yes[k] else Status.VIOLATED if no[k] else Status.UNDECIDED
        yield residual(label, float(largest[k]), "m_t g, l_arm m_t g", 1.0, status=status)


def power(found: Findings) -> tuple[CasePower, ...]:
    """Return the power in hover, if the platform can hover, and in every load case."""
    return tuple(_powers(found.scene.design, found.scene.platform, found.figures["flight"]))


def _powers(design: Design, platform: Platform, capability: Flight | None) -> Iterator[CasePower]:
    task, exists, rho = design.task, has_rotor(design.task), design.task.air_density
    k_tau, P_0 = task.module.torque_coefficient, task.module.ideal_power(rho)
    A, inputs = wrench_map(platform, task.modules_of_nodes)[:, exists.ravel()], design.inputs[:, exists]
    drags = per_rotor(
        task.modules_of_nodes, lambda kind: kind.torque_coefficient / k_tau * np.abs(kind.rotor_table.drags)
    )[exists]
    ideal = per_rotor(
        task.modules_of_nodes,
        lambda kind: kind.ideal_power(rho) / P_0 * (kind.rotor_table.gains**1.5 / kind.rotor_table.sizes),
    )[exists]
    cubes = np.maximum(inputs, 0.0) ** 1.5
    rows = [
        (label, float(np.sum(drags * w)), float(np.sum(ideal * w)), A @ u, u)
        for label, w, u in zip(task.case_labels, cubes, inputs, strict=True)
    ]
    flying, rotors = [kind for kind in task.types if kind.rotor_table.count], inputs.shape[1]
    kinds = {(kind.thrust_coefficient, kind.torque_coefficient, kind.body.rotor_radius) for kind in flying}
    equal = len(kinds) == 1 and all(kind.rotor_table.is_uniform for kind in flying)
    if capability is not None and capability.hover_power_ratio is not None and equal:
        straight_up = task.force_unit(task.n) / (rotors * flying[0].thrust_coefficient)
        cube = rotors * straight_up**1.5 * capability.hover_power_ratio
        weight = np.array([0.0, 0.0, task.force_unit(task.n), 0.0, 0.0, 0.0])
        hover = capability.hover.name, float(drags[0] * cube), float(ideal[0] * cube), weight, np.zeros(rotors)
        rows.insert(0, hover)
    for name, drag, ideal_share, b, u in rows:
        shaft_W, merit = clamp(k_tau * drag), ideal_share / drag if drag > 0 else 1.0
        yield CasePower(
            name=name,
            ideal_W=clamp(P_0 * ideal_share),
            shaft_W=shaft_W,
            figure_of_merit=clamp(task.module.figure_of_merit(rho) * merit),
            endurance_min=_endurance(task, A, b, u, drags),
        )


def _endurance(task: ResolvedTask, A: Array, b: Array, u: Array, drags: Array) -> float | None:
    """Return an upper bound on the time that all batteries last with inputs that produce a wrench [min].

    The batteries of all modules feed all rotors: a module without rotors supplies the others.

    Args:
        task: the task.
        A: wrench map, shape (6, N).
        b: the wrench, shape (6,) [N, N m].
        u: inputs that are also allowed, shape (N,) [rad^2/s^2].
        drags: drag torques over k_tau of `[module]` times the input, shape (N,).
    """
    module, limit = task.module, task.module.max_input(task.gravity)
    unit = np.repeat([task.force_unit(task.n), task.torque_unit(task.n)], 3)
    shares = task.input_shares[has_rotor(task)]
    box = Bounds(np.minimum(module.min_input * shares, u / limit), np.maximum(shares, u / limit))
    # shaft power is a plain sum for inputs that are scaled by their drags
    scale = drags ** (2 / 3)
    scaled = Bounds(box.low * scale, box.high * scale)
    _, least = least_inputs(A / scale * limit / unit[:, None], b / unit, scaled, 1.5)
    shaft_W = module.torque_coefficient * limit**1.5 * least
    stored_Wh = sum(count * (kind.battery_Wh or 0.0) for kind, count in task.counts)
    return clamp(stored_Wh * 60 / shaft_W) if stored_Wh and shaft_W > 0 else None
