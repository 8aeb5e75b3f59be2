"""Reserves that a task asks for, and failures that it must survive, against what was measured."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from topo_search.model import CaseFlight, Design, Flight, Residual, Sensitivity, Status
from topo_search.model.audit import WITHIN_TOLERANCES
from topo_search.model.load_case import AT, PLACES, AskedFlight, centres
from topo_search.model.proven import TOLERANCE
from verify.flight.joints import inertia
from verify.kinematics import platform
from verify.residuals import residual


def reserve_residuals(design: Design, measured: Flight | None) -> Iterator[Residual]:
    """Yield by how much each reserve is less than asked; undecided where nothing is proven."""
    task, flight = design.task, design.task.flight
    side = "horizontal" if flight.directions == "horizontal" else "force"
    for number, label, _ in centres(task):
        case = None if measured is None else measured.cases[number]
        for field, point, unit, r, scale in (
            *((side, at, "N", flight.force_reserve, task.force_unit(task.n)) for at in PLACES[flight.at]),
            ("torque", "", "Nm", flight.torque_reserve, task.torque_unit(task.n)),
        ):
            if r > 0:
                lower, upper = _bracket(flight, case, f"{field}_reserve{point}{{}}_{unit}")
                words = f"{label}, {'horizontal force' if field == 'horizontal' else field} reserve{AT[point]}"
                yield _judge(words, "N" if unit == "N" else "N m", r, lower, upper, scale)

        if any(flight.angular_acceleration):
            yield from _accelerations(design, case, label)
        if flight.com_error:
            words = f"{label}, error of the centre of mass"
            bracket = _bracket(flight, case, "com_error{}_m")
            yield _judge(words, "m", flight.com_error, *bracket, task.module.arm_length)
    if flight.tilt_deg:
        hover = None if measured is None else measured.hover
        words = "hover, tilt"
        yield _judge(words, "deg", flight.tilt_deg, *_bracket(flight, hover, "tilt{}_deg"), math.degrees(1.0))


def _accelerations(design: Design, case: CaseFlight | None, label: str) -> Iterator[Residual]:
    """Yield by how much each acceleration about an axis is less than asked."""
    task, flight, J = design.task, design.task.flight, inertia(design, platform(design))
    lower, upper = _bracket(flight, case, "angular_acceleration{}_rad_s2")
    rows = zip("xyz", flight.angular_acceleration, np.linalg.norm(J, axis=0), strict=True)
    for k, (axis, a, size) in enumerate(rows):
        if a > 0:
            at_least, at_most = (side[k] if isinstance(side, tuple) else side for side in (lower, upper))
            words = f"{label}, angular acceleration about {axis}"
            yield _judge(words, "rad/s^2", a, at_least, at_most, task.torque_unit(task.n) / float(size))


def failure_residuals(design: Design, measured: Flight | None) -> Iterator[Residual]:
    """Yield how many single rotors may not fail, and by how much less torque is left than asked."""
    task, flight = design.task, design.task.flight
    if flight.rotor_out == "none":
        return
    out = None if measured is None else measured.rotors_out_asked
    where = "hover" if flight.rotor_out == "hover" else "hover and cases that carry the weight"
    kept = 0 if out is None else out.survive
    status = Status.CLEAR if kept == 4 * task.n else Status.UNDECIDED
    status = Status.VIOLATED if out is not None and out.lost else status
    rotors = {"claim": float(4 * task.n), "derived": float(kept)}
    yield residual(
        f"{where}, any rotor dead", float(4 * task.n - kept), "rotors", 1.0, tolerance=0.0, status=status, **rotors
    )
    r, scale = flight.rotor_out_torque or 0.0, task.torque_unit(task.n)
    if r > 0:
        lower = (None if out is None else out.torque_reserve_Nm) or 0.0
        upper = None if out is None else out.torque_reserve_at_most_Nm
        yield _judge(f"{where}, any rotor dead, torque reserve", "N m", r, lower, upper, scale)


def load_residuals(design: Design, measured: Flight | None) -> Iterator[Residual]:
    """Yield by how much the joints bear more than asked, over all joints and load cases."""
    task = design.task
    kinds = (("force", "force_N", "N", task.force_unit), ("moment", "moment_Nm", "N m", task.torque_unit))
    for (what, field, unit, scale), most in zip(kinds, task.joint_limits, strict=True):
        if most is None:
            continue
        loads = () if measured is None else (load for load in measured.joints if load.case != measured.hover.name)
        largest = max((float(getattr(load, field)) for load in loads), default=0.0)
        name, known = f"largest {what} in a joint", Status.UNDECIDED if measured is None else None
        beyond = max(0.0, largest - most)
        yield residual(name, beyond, unit, scale(task.n), claim=most, derived=largest, status=known)


def tolerance_residuals(design: Design, errors: Sensitivity | None) -> Iterator[Residual]:
    """Yield by how much the least clearance falls short of 0 within the tolerances, if it must not."""
    worst = None if errors is None else errors.tolerances
    if not design.task.flight.tolerances or worst is None:  # there is no clearance to lose
        return
    short = 0.0 if worst.status == Status.CLEAR else max(0.0, -worst.lower_m)
    limits = {"tolerance": 0.0, "claim": 0.0, "derived": worst.lower_m}
    yield residual(WITHIN_TOLERANCES, short, "m", design.task.module.arm_length, status=worst.status, **limits)


def _judge(name: str, unit: str, r: float, lower: float, upper: float | None, scale: float) -> Residual:
    """Return by how much a reserve is less than the r that is asked; `upper` is None where nothing is proven."""
    short = max(0.0, r - lower)
    status = Status.UNDECIDED
    if short <= TOLERANCE * scale:
        status = Status.CLEAR
    elif upper is not None and r - upper > TOLERANCE * scale:
        status = Status.VIOLATED
    return residual(name, short, unit, scale, claim=r, derived=lower, status=status)


def _bracket(flight: AskedFlight, case: CaseFlight | None, name: str) -> tuple[Any, Any]:
    """Return what a figure of the allocator is at least, and at most; None where nothing is proven.

    Args:
        flight: says which allocator.
        case: what was measured.
        name: of the figure, with braces where that of the upper bound says so.
    """
    if case is None or case.possible is None:
        return 0.0, None
    if not case.possible:
        return 0.0, 0.0
    names = name.format(""), name.format("_at_most")
    if flight.allocator == "pseudo-inverse":  # its figures are exact
        names = (f"{names[0]}_pseudo_inverse",) * 2
    lower, upper = (getattr(case, one) for one in names)
    return (0.0 if lower is None else lower), upper
