"""Residuals of the flight requirements: required reserves, rotor failures, joint loads and tolerances."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from topo_search.model import CaseFlight, Design, Flight, Residual, Sensitivity, Status
from topo_search.model.proven import TOLERANCE
from topo_search.model.reserves import AT, POINT_SUFFIXES, AskedFlight, centres
from topo_search.model.sensitivity import WITHIN_TOLERANCES
from verify.flight.joints import inertia
from verify.kinematics import has_rotor, platform
from verify.residuals import residual
from verify.sections import Findings


def flight_residuals(found: Findings) -> Iterator[Residual]:
    """Yield the residuals of reserves, failures, loads and tolerances."""
    design, capability = found.scene.design, found.figures["flight"]
    yield from reserve_residuals(design, capability)
    yield from failure_residuals(design, capability)
    yield from load_residuals(design, capability)
    yield from tolerance_residuals(design, found.figures["sensitivity"])


def reserve_residuals(design: Design, capability: Flight | None) -> Iterator[Residual]:
    """Yield the shortfall of each required reserve; undecided if nothing is proven."""
    task, flight = design.task, design.task.flight
    side = "horizontal" if flight.directions == "horizontal" else "force"
    for number, label, _ in centres(task):
        case = None if capability is None else capability.cases[number]
        for field, point, unit, r, scale in (
            *((side, at, "N", flight.force_reserve, task.force_unit(task.n)) for at in POINT_SUFFIXES[flight.at]),
            ("torque", "", "Nm", flight.torque_reserve, task.torque_unit(task.n)),
        ):
            if r > 0:
                lower, upper = _bracket(flight, case, f"{field}_reserve{point}{{}}_{unit}")
                name = f"{label}, {'horizontal force' if field == 'horizontal' else field} reserve{AT[point]}"
                yield _shortfall(name, "N" if unit == "N" else "N m", r, lower, upper, scale)

        if any(flight.angular_acceleration):
            yield from _acceleration_residuals(design, case, label)
        if flight.com_error:
            name = f"{label}, error of the centre of mass"
            bracket = _bracket(flight, case, "com_error{}_m")
            yield _shortfall(name, "m", flight.com_error, *bracket, task.module.arm_length)
    if flight.tilt_deg:
        hover = None if capability is None else capability.hover
        bracket = _bracket(flight, hover, "tilt{}_deg")
        yield _shortfall("hover, tilt", "deg", flight.tilt_deg, *bracket, math.degrees(1.0))
    moment = None if capability is None else capability.rod_moment_Nm
    reserves = [r for r in (flight.torque_reserve, flight.rotor_out_torque) if r]
    if reserves and moment is not None:
        least, scale = min(reserves), task.torque_unit(task.n)
        name = (
            "moment of the rod whose mass is ignored, beyond the torque reserve "
            '(end_effector.rod_mass = "included" counts it)'
        )
        yield residual(name, max(0.0, moment - least), "N m", scale, claim=least, derived=moment)


def _acceleration_residuals(design: Design, case: CaseFlight | None, label: str) -> Iterator[Residual]:
    """Yield the shortfall of each required angular acceleration."""
    task, flight, J = design.task, design.task.flight, inertia(design, platform(design))
    lower, upper = _bracket(flight, case, "angular_acceleration{}_rad_s2")
    axes = zip("xyz", flight.angular_acceleration, np.linalg.norm(J, axis=0), strict=True)
    for k, (axis, a, J_axis) in enumerate(axes):
        if a > 0:
            at_least, at_most = (bound[k] if isinstance(bound, tuple) else bound for bound in (lower, upper))
            name = f"{label}, angular acceleration about {axis}"
            yield _shortfall(name, "rad/s^2", a, at_least, at_most, task.torque_unit(task.n) / float(J_axis))


def failure_residuals(design: Design, capability: Flight | None) -> Iterator[Residual]:
    """Yield the number of rotor failures not survived, and the shortfall of the remaining torque reserve."""
    task, flight = design.task, design.task.flight
    if flight.rotor_out == "none":
        return
    out = None if capability is None else capability.rotors_out_asked
    cases = "hover" if flight.rotor_out == "hover" else "hover and cases that carry the weight"
    survived, rotors = 0 if out is None else out.survive, int(has_rotor(task).sum())
    status = Status.CLEAR if survived == rotors else Status.UNDECIDED
    status = Status.VIOLATED if out is not None and (out.lost or out.hover_only) else status
    counts = {"claim": float(rotors), "derived": float(survived)}
    name, fatal = f"{cases}, any rotor dead", float(rotors - survived)
    yield residual(name, fatal, "rotors", 1.0, tolerance=0.0, status=status, **counts)
    r, scale = flight.rotor_out_torque or 0.0, task.torque_unit(task.n)
    if r > 0:
        lower = (None if out is None else out.torque_reserve_Nm) or 0.0
        upper = None if out is None else out.torque_reserve_at_most_Nm
        yield _shortfall(f"{name}, torque reserve", "N m", r, lower, upper, scale)


def load_residuals(design: Design, capability: Flight | None) -> Iterator[Residual]:
    """Yield the excess of the largest joint force and moment, over all joints and load cases."""
    task = design.task
    quantities = (("force", "force_N", "N", task.force_unit), ("moment", "moment_Nm", "N m", task.torque_unit))
    for (quantity, field, unit, scale), limit in zip(quantities, task.joint_limits, strict=True):
        if limit is None:
            continue
        loads = () if capability is None else (j for j in capability.joints if j.case != capability.hover.name)
        largest = max((float(getattr(load, field)) for load in loads), default=0.0)
        name, status = f"largest {quantity} in a joint", Status.UNDECIDED if capability is None else None
        excess = max(0.0, largest - limit)
        yield residual(name, excess, unit, scale(task.n), claim=limit, derived=largest, status=status)


def tolerance_residuals(design: Design, errors: Sensitivity | None) -> Iterator[Residual]:
    """Yield the violation of the smallest clearance within the tolerances, if the task requires clearance there.

    An example that contradicts a proven limit is a fault of the audit, whether tolerances are required or not.
    """
    if errors is None:  # there is no clearance to lose
        return
    worst, l_arm = errors.tolerances, design.task.module.arm_length
    for name, limit, unit, scale in (
        ("hinge angles", errors.hinge_angle_deg, "deg", math.degrees(1.0)),
        ("positions", errors.position_m, "m", l_arm),
        ("airflow", errors.envelope_m, "m", l_arm),
        ("tolerances", None if worst is None else worst.factor, "times the task's", 1.0),
    ):
        if limit is not None and limit.violated_at is not None and limit.violated_at < limit.tolerated:
            excess, status = limit.tolerated - limit.violated_at, Status.INCONSISTENT
            limits = {"claim": limit.tolerated, "derived": limit.violated_at}
            yield residual(f"tolerated errors of {name}", excess, unit, scale, status=status, **limits)
    if worst is not None and (design.task.flight.tolerances or worst.status == Status.INCONSISTENT):
        violation = 0.0 if worst.status == Status.CLEAR else max(0.0, -worst.lower_m)
        limits = {"tolerance": 0.0, "claim": 0.0, "derived": worst.lower_m}
        yield residual(WITHIN_TOLERANCES, violation, "m", l_arm, status=worst.status, **limits)


def _shortfall(name: str, unit: str, r: float, lower: float, upper: float | None, scale: float) -> Residual:
    """Return the shortfall of a reserve from the required r; `upper` is None if nothing is proven."""
    shortfall = max(0.0, r - lower)
    status = Status.UNDECIDED
    if shortfall <= TOLERANCE * scale:
        status = Status.CLEAR
    elif upper is not None and r - upper > TOLERANCE * scale:
        status = Status.VIOLATED
    return residual(name, shortfall, unit, scale, claim=r, derived=lower, status=status)


def _bracket(flight: AskedFlight, case: CaseFlight | None, name: str) -> tuple[Any, Any]:
    """Return the lower and upper bound of a figure for the task's allocator; upper None if nothing is proven.

    Args:
        flight: the flight requirements, which name the allocator.
        case: the capability in one load case.
        name: field name, with braces where that of the upper bound has a suffix.
    """
    if case is None or case.possible is None:
        return 0.0, None
    if not case.possible:
        return 0.0, 0.0
    names = name.format(""), name.format("_at_most")
    if flight.allocator == "pseudo-inverse":  # its figures are exact
        names = (f"{names[0]}_pseudo_inverse",) * 2
    lower, upper = (getattr(case, field) for field in names)
    return (0.0 if lower is None else lower), upper
