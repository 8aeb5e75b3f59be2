"""Reserves that a task asks for, against those that were measured."""

from __future__ import annotations

from collections.abc import Iterator

from topo_search.model import CaseFlight, Design, Flight, Residual, Status
from topo_search.model.reserves import centres
from topo_search.model.tolerances import TOLERANCE


def reserve_residuals(design: Design, measured: Flight | None) -> Iterator[Residual]:
    """Yield by how much each reserve is less than asked; undecided where nothing is proven."""
    task, asked = design.task, design.task.flight
    side = "horizontal" if asked.directions == "horizontal" else "force"
    for number, label, _ in centres(task):
        case = None if measured is None else measured.cases[number]
        for field, unit, r, scale in (
            (side, "N", asked.force_reserve, task.force_unit(task.n)),
            ("torque", "Nm", asked.torque_reserve, task.torque_unit(task.n)),
        ):
            if r > 0:
                lower, upper = _bracket(case, f"{field}_reserve", unit)
                short = max(0.0, r - lower)
                status = Status.UNDECIDED
                if short <= TOLERANCE * scale:
                    status = Status.CLEAR
                elif r - upper > TOLERANCE * scale:
                    status = Status.VIOLATED
                words = f"{label}, {'horizontal force' if field == 'horizontal' else field} reserve"
                yield Residual(
                    name=words,
                    value=short,
                    unit="N" if unit == "N" else "N m",
                    scaled=short / scale,
                    tolerance=TOLERANCE,
                    status=status,
                    stated=r,
                    derived=lower,
                )


def _bracket(case: CaseFlight | None, name: str, unit: str) -> tuple[float, float]:
    """Return what a reserve is at least, and at most."""
    if case is None or case.possible is None:
        return 0.0, float("inf")
    if not case.possible:
        return 0.0, 0.0
    lower, upper = getattr(case, f"{name}_{unit}"), getattr(case, f"{name}_at_most_{unit}")
    return (0.0 if lower is None else lower), (float("inf") if upper is None else upper)
