"""Own constraints checked: on a final design by their own expressions, and before a search by trying them."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from nlp.user_constraints.expressions import platform_of, rows, scale_of
from nlp.user_constraints.rows import TOLERANCE, UserRows
from topo_search.model import BadInput, Design, Fault, ResolvedTask, Topology
from topo_search.model.arrays import Array
from topo_search.model.design import StatedCheck
from topo_search.protocols import OwnConstraint, SymbolicPlatform

DRAWS = 256
"""Random platforms; each value of an own constraint must be finite on one of them."""


def check_stated(
    constraints: Sequence[OwnConstraint],
    design: Design,
    *,
    orientations: Array,
    centres: Array,
    end_effector: Array,
) -> tuple[StatedCheck, ...]:
    """Return what own constraints come to on a design, by their own expressions at poses that others computed.

    Args:
        constraints: what is checked.
        design: its angles and inputs.
        orientations: R_i, shape (n, 3, 3).
        centres: o_i from the centre of mass, shape (n, 3) [m].
        end_effector: p_E from the centre of mass, shape (3,) [m].
    """
    platform = platform_of(
        design.task,
        design.topology,
        orientations=orientations,
        centres=centres,
        end_effector=end_effector,
        hinge_angles=design.hinge_angles_rad,
        inputs=design.rotor_speeds_squared,
    )
    return tuple(_check(one, platform) for one in constraints)


def _check(constraint: OwnConstraint, platform: SymbolicPlatform) -> StatedCheck:
    values = np.asarray(ca.evalf(rows(constraint, platform)), dtype=float).ravel()
    if not np.all(np.isfinite(values)):  # a constraint that has no value is not met
        return StatedCheck(**constraint.stated.model_dump(), status="missed")
    beyond = np.maximum(constraint.lower - values, values - constraint.upper)
    place = int(np.argmax(beyond))
    met = beyond[place] <= TOLERANCE * scale_of(constraint, platform.task)
    return StatedCheck(
        **constraint.stated.model_dump(),
        status="met" if met else "missed",
        value=float(values[place]),
        off_by=float(beyond[place]),
    )


def refuse_unusable(constraints: Sequence[OwnConstraint], task: ResolvedTask, topology: Topology) -> None:
    """Try own constraints on the symbols of one topology, and on random values of them, before workers do.

    Raises:
        BadInput: names the constraint, and what its expression raises or returns in place of expressions.
    """
    rng = np.random.default_rng(0)
    for constraint in constraints:
        try:
            own = UserRows([constraint], task, topology)
            known = {symbol.element_hash() for symbol in ca.symvar(own.x)}
            foreign = [symbol.name() for symbol in ca.symvar(own.g) if symbol.element_hash() not in known]
            if foreign:
                raise ValueError(f"must be made of the platform's symbols alone, but has {', '.join(foreign)}")
            _ = own.bounds
            finite = np.zeros(own.g.shape, dtype=bool)
            for _ in range(DRAWS):
                finite |= np.isfinite(np.asarray(own.values(own.draw(rng))))
                if np.all(finite):
                    break
            else:
                raise ValueError(f"must have a finite value, but has none on {DRAWS} random platforms")
        except Exception as error:
            told = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
            rule = f"cannot be stated for {topology.key}: {' '.join(told.split())}"
            raise BadInput("constraints", [Fault(constraint.name, rule)]) from error
