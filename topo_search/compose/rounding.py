"""Designs whose hinge angles are rounded, or are those of shared brackets: all else is solved again and audited.

The root orientation is not rounded: the autopilot holds it, not a bracket.
"""

import math
from typing import NamedTuple

import numpy as np

from topo_search.compose.binding import solve_near
from topo_search.compose.designs import audit, compare_audits
from topo_search.model import Audit, Design, Infeasible, Status
from topo_search.model.search import MIN_STEP_DEG
from topo_search.study.request import Margins

STEPS = (30.0, 15.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, MIN_STEP_DEG)
"""Steps that are tried where a larger one leads to no clear design [deg]."""


class NotClear(Exception):
    """No design near the given one has the hinge angles and a clear audit; the message says why."""


class Rounded(NamedTuple):
    """A design with rounded hinge angles."""

    design: Design
    audit: Audit
    notes: tuple[str, ...]
    """Changes by rounding, one sentence each."""


def round_angles(design: Design, step_deg: float) -> Rounded:
    """Round the hinge angles of a design to a step, solve the rest of it again, and audit it.

    Several roundings near the design are tried; the one of least effort that is clear is returned.

    Args:
        design: the design.
        step_deg: hinge angles become multiples of this step, at least 0.1 [deg].

    Raises:
        NotClear: no rounding is clear, or all hinges of a flat lattice are 0; the message names a smaller step that
            leads to a clear design, if there is one.
        RuntimeError: an audit failed; the message gives the reason.

    Example:
        >>> from topo_search import read_design, round_angles
        >>> rounded = round_angles(read_design("hover-2/best.json"), 30.0)
        >>> [round(math.degrees(angle)) % 30 for angle in rounded.design.hinge_angles_rad]
        [0]
    """
    if design.task.search.lattice is not None:
        raise NotClear("all hinges of a flat lattice are at 0 deg")
    try:
        rounded, after = _round(design, step_deg)
    except NotClear as reason:
        raise NotClear(f"no rounding to {step_deg:g} deg is clear: {reason}; {_advice(design, step_deg)}") from None
    effort = rounded.objective / design.objective if design.objective else 1.0
    changes = np.degrees(np.subtract(rounded.hinge_angles_rad, design.hinge_angles_rad))
    largest = float(np.abs(changes).max(initial=0.0))
    cost = (
        f"Hinge angles are rounded to {step_deg:g} deg, none by more than {largest:.3g} deg, and all else is "
        f"solved again: control effort {round(100 * (effort - 1), 4) + 0.0:+.3g} %."
    )
    return Rounded(rounded, after, (cost, compare_audits(audit(design), after)))


def _round(design: Design, step_deg: float) -> tuple[Design, Audit]:
    """Return the result of `move_hinges` for multiples of a step, of those that the task allows."""
    if (allowed := design.task.search.hinge_set_deg) is None:
        return move_hinges(design, hinge_step_deg=step_deg)
    multiples = tuple(angle for angle in allowed if math.isclose(angle, step_deg * round(angle / step_deg)))
    if not multiples:
        raise NotClear("its task allows no such angle")
    return move_hinges(design, hinge_angles_deg=multiples)


def _advice(design: Design, step_deg: float) -> str:
    """Return the largest smaller one of the listed steps that leads to a clear design, in words."""
    for step in (step for step in STEPS if step < step_deg):
        try:
            _round(design, step)
        except NotClear:
            continue
        return f"choose {step:g} deg, which is"
    return f"nor is one to a smaller step, down to {MIN_STEP_DEG:g} deg"


def move_hinges(design: Design, **hinge_set: float | tuple[float, ...]) -> tuple[Design, Audit]:
    """Return a clear design near a given one whose hinge angles are from a set, and its audit.

    Args:
        design: the design; its task is kept.
        hinge_set: fields of `[search]` that state the set.

    Raises:
        NotClear: no design is clear, at the margin of the task or a larger one.
        RuntimeError: an audit failed; the message gives the reason.
    """
    ladder = Margins.of(design.task)
    while True:
        search = ladder.task.search.any_angle.model_copy(update=hinge_set)
        outcome = solve_near(design, ladder.task.model_copy(update={"search": search}))
        if outcome is None:
            raise NotClear("nearby angles all bring modules too close to each other")
        if isinstance(outcome, Infeasible):
            missed = f"{outcome.violation:.3g} {outcome.unit}".rstrip()
            raise NotClear(f"the best one misses {outcome.worst_constraint} by {missed}")
        audited = audit(outcome)
        if audited.verdict == Status.CLEAR:
            return outcome, audited
        if not ladder.raise_after(audited):
            raise NotClear(f"of the best one, {audited.failure(design.task)}")
