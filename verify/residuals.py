"""Residuals of the core: limits on a design's numbers other than clearances; sections of the audit add theirs.

Deviations are scaled: forces by m_t g, torques by l_arm m_t g, inputs by the upper limit of `[module]`, lengths by
l_arm, the objective by its value; angles are in rad. A scaled deviation above its tolerance, mostly TOLERANCE, is a
violation. Wrenches are checked about the COM and about the end-effector, because with a long lever arm a force
within the tolerance can be a torque beyond it.
"""

import math
import sys
from collections.abc import Iterator

import numpy as np

from topo_search.model import LEAST_OFFSET, Design, Residual, Status, needs_offset
from topo_search.model.proven import TOLERANCE
from verify.kinematics import Platform, objective, wrench_errors


def residuals(design: Design, platform: Platform) -> tuple[Residual, ...]:
    """Return the residuals of wrenches, inputs, angles, end-effector, connectors and objective."""
    connectors, J = design.task.search.connectors, objective(design)
    # a quarter turn violates `connectors = "aligned"`; half turns are equivalent
    misaligned = sum(kappa % 2 for kappa in design.topology.kappas) if connectors == "aligned" else 0
    error, scale = abs(design.objective - J), max(J, sys.float_info.min)
    return (
        *_wrenches(design, platform),
        *_inputs(design),
        *_angles(design),
        *_end_effector(design, platform),
        residual(f'joints against connectors = "{connectors}"', misaligned, "joints", 1.0, tolerance=0.0),
        residual("objective", error, "rad^4/s^4", scale, claim=design.objective, derived=J),
    )


def residual(
    name: str,
    value: float,
    unit: str,
    scale: float,
    *,
    tolerance: float = TOLERANCE,
    claim: float | None = None,
    derived: float | None = None,
    status: Status | None = None,
) -> Residual:
    """Return a residual; its tolerance decides the status unless one is given."""
    scaled = value / scale if scale > 0 else math.inf
    return Residual(
        name=name,
        value=clamp(value),
        unit=unit,
        scaled=clamp(scaled),
        tolerance=tolerance,
        status=status or (Status.CLEAR if scaled <= tolerance else Status.VIOLATED),
        stated=claim,
        derived=None if derived is None else clamp(derived),
    )


def clamp(value: float) -> float:
    """Return the value, or the largest float if it is not finite, because JSON has no infinity."""
    return value if math.isfinite(value) else sys.float_info.max


def _wrenches(design: Design, platform: Platform) -> Iterator[Residual]:
    n = design.topology.n
    for case, error in zip(design.task.case_labels, wrench_errors(design, platform), strict=True):
        force, torque = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
        yield residual(f"{case}, force", force, "N", design.task.force_unit(n))
        yield residual(f"{case}, torque", torque, "N m", design.task.torque_unit(n))
        at_tip = float(np.linalg.norm(error[3:] - np.cross(platform.p_e, error[:3])))
        yield residual(f"{case}, torque about the end-effector", at_tip, "N m", design.task.torque_unit(n))


def _inputs(design: Design) -> Iterator[Residual]:
    scale, shares = design.task.max_input, design.task.input_shares
    limits, lowest = scale * shares, design.task.min_input * shares
    for case, u in zip(design.task.case_labels, design.inputs, strict=True):
        for name, sign, bounds in (("largest", 1.0, limits), ("smallest", -1.0, lowest)):
            excess = sign * (u - bounds)
            excess[(limits == 0) & (u == 0)] = -math.inf  # of rotors that a type of module lacks
            worst = np.unravel_index(np.argmax(excess), u.shape)
            size, claim, bound = max(0.0, float(excess[worst])), float(u[worst]), float(bounds[worst])
            yield residual(
                f"{case}, {name} rotor input", size, "rad^2/s^2", scale, claim=claim, derived=bound or None
            )


def _angles(design: Design) -> Iterator[Residual]:
    def excess(angle: float, limit: float) -> float:
        return max(0.0, abs(angle) - limit)

    for i, alpha in enumerate(design.hinge_angles_rad, start=1):
        yield residual(f"hinge angle of module {i}", excess(alpha, math.pi / 2), "rad", 1.0, claim=alpha)
    if (allowed := design.task.search.hinge_set_deg) is not None:
        for i, alpha in enumerate(design.hinge_angles_rad, start=1):
            nearest = min(map(math.radians, allowed), key=lambda angle: abs(angle - alpha))
            name = f"hinge angle of module {i} against the task's set"
            yield residual(name, abs(nearest - alpha), "rad", 1.0, tolerance=0.0, claim=alpha, derived=nearest)
    ranges = design.task.search.root_ranges.items()
    for (name, (low, high)), angle in zip(ranges, design.root_orientation_rad, strict=False):
        beyond = max(0.0, low - angle, angle - high)
        yield residual(f"root orientation, {name}", beyond, "rad", 1.0, claim=angle)


def _end_effector(design: Design, platform: Platform) -> Iterator[Residual]:
    l_arm = design.task.module.arm_length
    fixed = design.task.end_effector.fixed_position
    if fixed is not None:
        yield residual("end-effector position", float(np.linalg.norm(platform.p_e - np.array(fixed))), "m", l_arm)
    reach, farthest = float(np.linalg.norm(platform.p_e)), design.task.farthest_end_effector(design.topology.n)
    yield residual("end-effector's reach", max(0.0, reach - farthest), "m", l_arm, derived=reach)
    if any(needs_offset(exposure) for exposure in design.task.exposure):
        deficit = max(0.0, LEAST_OFFSET * l_arm - reach)
        yield residual("end-effector's distance from the COM", deficit, "m", l_arm, derived=reach)
