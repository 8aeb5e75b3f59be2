"""The page of a single audited design."""

from __future__ import annotations

from typing import Any

from topo_search.model import Audit, Design, ResolvedTask, Status, Task
from topo_search.model.files import to_toml
from topo_search.model.proven import at_least, gap_percent
from topo_search.model.task_warnings import task_warnings
from topo_search.report.design_part import design_part
from topo_search.report.headline import headline, tally
from topo_search.report.page import Page, Reproduction, SimulatedPart, Table, TaskPart, json_in_script
from topo_search.report.task_facts import facts, load_cases
from topo_search.report.view import shared_meshes
from topo_search.report.wording import EFFORT, figures, modules


def design_page(design: Design, audit: Audit, file: str, simulated: SimulatedPart | None = None) -> Page:
    """Return the page of a design.

    Args:
        design: the design.
        audit: its audit.
        file: the name of its file, for the commands.
        simulated: what it did in simulation.
    """
    task = design.task
    gap = design.gap if audit.verdict == Status.CLEAR else None  # the effort of another design bounds nothing
    return Page(
        title=title(task.name, task.n),
        key=design.topology.key,
        verdict=str(audit.verdict),
        checked=tally(audit),
        answer="One design: this page says nothing about other trees of modules.",
        tiles=headline(design, audit, gap, "a single design"),
        notes=(),
        bound=bound(design.lower_bound, gap, task.n),
        task=task_part(task, task),
        design=design_part(design, audit),
        meshes=json_in_script(shared_meshes(design)),
        run=None,
        reproduction=_reproduction(design, audit, file),
        simulated=simulated,
    )


def title(name: str, n: int) -> str:
    """Return what a page is about: its task and size."""
    return f"{name}: {modules(n)}"


def task_part(task: ResolvedTask, stated: Task) -> TaskPart:
    """Return the task as it was understood, with the warnings about it as it was stated."""
    columns = ("load case", "the rotors together produce", "weight λ")
    warnings = tuple(map(str, task_warnings(stated)))
    return TaskPart(facts(task), Table(columns, load_cases(task), frozenset({0, 2})), warnings)


def bound(lower_bound: float | None, gap: float | None, n: int) -> tuple[str, ...]:
    """Return the lower bound and what it means, a paragraph each."""
    if lower_bound is None:
        return ("The design states no lower bound, so how far it is from the optimum is unknown.",)
    told = f"Lower bound: {figures(at_least(lower_bound, 5), 5)} rad⁴/s⁴ for the control effort {EFFORT}."
    meaning = (
        f"It holds for every platform of {modules(n)} of this kind, for any tree, hinge angles and end-effector "
        "position: it is what the forces of the load cases would cost rotors within their limits if every thrust "
        "axis could point wherever it is needed. Torques and geometry are neglected, so part of the gap may come "
        "from the bound rather than from the design. The proof assumes that wrenches are met exactly. The audit "
        "tolerates 1e-6 of the weight, so an audited design may lie below the bound by up to 3.5e-6 times the "
        "weight over the forces of the load cases."
    )
    if gap is None:
        return told, meaning
    return (
        told,
        f"The gap is {gap_percent(gap)}: no platform of {modules(n)} saves more than this share of the effort.",
        meaning,
    )


def _reproduction(design: Design, audit: Audit, file: str) -> Reproduction:
    """Return how to audit the design again and, if it says how it was found, how to find it."""
    solver: dict[str, Any] = design.solver or {}
    commands = [f"topo-search audit {file}"]
    if isinstance(solver.get("seed"), int) and isinstance(solver.get("starts"), int):
        options = f"--starts {solver['starts']} --seed {solver['seed']}"
        commands.append(f"topo-search solve task.toml --topology {design.topology.key} {options}")
    versions = {
        str(name): str(value) for name, value in {**(solver.get("versions") or {}), **audit.versions}.items()
    }
    return Reproduction(tuple(commands), to_toml(design.task), versions, ())
