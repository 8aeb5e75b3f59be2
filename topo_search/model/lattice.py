"""Rules of flat lattices: what a task may ask of platforms whose joints form cycles."""

from __future__ import annotations

from typing import TYPE_CHECKING

from topo_search.limits import LIMITS
from topo_search.model.value import Broken, show

if TYPE_CHECKING:
    from topo_search.model.task import Task

LOADS = "moments in the joints of a cycle are statically indeterminate, and not computed"


def broken_lattice(task: Task) -> Broken:
    """Yield what a task with `lattice = "flat"` may not have, and what only such a task may have."""
    search, flat = task.search, 'with lattice = "flat"'
    if search.lattice is None:
        if search.closures is not None:
            yield ("search", "closures"), f"must be left out without lattice, but got {search.closures}"
        return
    for field, value in (("hinge_step_deg", search.hinge_step_deg), ("hinge_angles_deg", search.hinge_angles_deg)):
        if value is not None:
            yield ("search", field), f"must be left out {flat}, whose hinges are all 0, but got {show(value)}"
    if search.connectors == "any":
        rule = f'must be "aligned" {flat}, whose neighbours are joined at opposite ports, but got "any"'
        yield ("search", "connectors"), rule
    if task.joint_limits != (None, None):
        name = "joint_moment" if task.flight.joint_moment else "joint_force"
        yield ("flight", name), f"must be left out {flat}: {LOADS}"
    if task.module.bracket is not None:
        yield ("module", "bracket"), f"must be left out {flat}: brackets of cycles are not audited"
    if task.sizes and task.sizes[-1] > LIMITS.lattice_modules:
        yield "modules", f"must be at most {LIMITS.lattice_modules} {flat}, but got {show(task.modules)}"
    module, folds = task.module, task.folds(search.margin)
    if search.interference == "airflow" and module.connector_distance <= module.envelope.end_radius:
        rule = f'must be "parts" or "separation" {flat}: the airflow of neighbours side by side overlaps'
        yield ("search", "interference"), f'{rule}, but got "airflow"'
    elif not any(low <= 0.0 <= high for low, high in folds):
        rule = "must be left out: rotors of neighbours side by side are in each other's way"
        yield ("search", "lattice"), f"{rule}, but got {show(search.lattice)}"
