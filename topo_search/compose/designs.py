"""Single designs: solving, auditing, brackets; pages and pictures of designs and runs."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import nlp
import verify
from topo_search.compose.binding import backends, enclose_speed, own_constraints, processes, starting_points
from topo_search.engine import Failed, Outcome
from topo_search.engine.workers import audit_deadline, audit_job
from topo_search.limits import LIMITS
from topo_search.model import Audit, BadInput, Clearance, Design, Geometry, ResolvedTask, Status, Task, as_bad_input
from topo_search.model.bracket import Bracket
from topo_search.model.files import load_json, to_geometry, write_atomically
from topo_search.model.proven import lower_text
from topo_search.model.task_file import read_task
from topo_search.own_constraint import OwnConstraint
from topo_search.report.cell import View
from topo_search.study import RunFile, RunFolder, Solved, answer_of, solve_single
from topo_search.study.directory import CHANGED
from topo_search.topologies.own_topologies import OwnTopology, own_topology, refuse_unlike

if TYPE_CHECKING:
    from topo_search.report.design_page import Comparison
    from topo_search.report.headline import Compared


def solve(
    task: Task | str | Path,
    topology: OwnTopology,
    *,
    starts: int | None = None,
    seed: int = 0,
    time_limit: float | None = None,
    near: Iterable[Design] = (),
    constraints: Iterable[OwnConstraint] = (),
    progress: Callable[[Outcome], None] = lambda _: None,
    note: Callable[[str], None] = lambda _: None,
) -> Solved:
    """Find the best design of one topology and audit it.

    Both run in the calling process, or in a worker process if there is a time limit or a constraint of your own,
    which might crash or never end. Without `starts` and `time_limit`, solving stops after three rounds of starts in
    a row without improvement.

    Args:
        task: a task, its file, or the name of a shipped example. The topology decides the number of modules.
        topology: a tree, its key, or a graph (see `Topology.graph`).
        starts: number of starts; default: until more starts no longer help.
        seed: random seed of the starts.
        time_limit: time after which solving stops [s]; default: none.
        near: designs of any trees; each adds one start to the first round.
        constraints: your own constraints on the design; they are evaluated, not certified.
        progress: called with the best outcome after each round.
        note: called with a message before slow preparations, such as compiling.

    Raises:
        BadInput: the task, the topology, a design or a constraint is invalid, or the task's connectors do not allow
            the topology.
        ValueError: the number of starts is out of range (`limits`).

    Example:
        >>> from topo_search import read_task, solve
        >>> hover = "load_cases=[{com={force=[0.0,0.0,1.0]}}]"
        >>> task = read_task("push", ("modules=2", hover))
        >>> solved = solve(task, "a10", starts=1)
        >>> len(solved.outcome.hinge_angles_rad), solved.audit.verdict.value
        (1, 'clear')
    """
    if starts is not None and not 1 <= starts <= LIMITS.starts:
        raise ValueError(f"`1 <= starts <= {LIMITS.starts:,}` must hold, but got {starts:,}")
    user_task = enclose_speed(task if isinstance(task, Task) else read_task(task))
    with as_bad_input("topology"):
        tree = own_topology(topology, user_task)
    if tree.n > LIMITS.modules:
        raise BadInput("topology", f"must have at most {LIMITS.modules} modules, but got {tree.n:,}")
    resolved = user_task.resolve(user_task.sizes[0] if user_task.module_types else tree.n)
    with as_bad_input(f"{resolved.name}: topology"):
        refuse_unlike(tree, resolved)
    designs, user_constraints = starting_points(near), own_constraints(constraints)
    nlp.refuse_unusable(user_constraints, resolved.on(tree), tree)
    nlp.prepare(resolved, note)
    with processes(int(time_limit is not None or bool(user_constraints))) as engine:
        return solve_single(
            user_task,
            tree,
            backends(user_constraints),
            starts=starts,
            round_size=nlp.default_starts(resolved),
            seed=seed,
            time_limit=time_limit,
            engine=engine,
            progress=progress,
            near=designs,
        )


def read_design(path: str | Path) -> Design:
    """Return the design in a file, with its lower bound and gap recomputed.

    If the file has no rotor inputs, the design gets the best inputs that the audit finds.

    Args:
        path: a file with a design, or a geometry without inputs.

    Raises:
        BadInput: the file cannot be read, or holds no design.

    Example:
        >>> from topo_search import read_design
        >>> design = read_design("hover-2/best.json")
        >>> design.topology.key, design.lower_bound <= design.objective
        ('a10', True)
    """
    design = read_completed(path)
    return with_bound(design, nlp.lower_bound)


def read_completed(path: str | Path) -> Design:
    """Return the design in a file, without recomputing its bound; otherwise like `read_design`."""
    return verify.complete(to_geometry(load_json(path, most_bytes=LIMITS.design_bytes), str(path)))


def with_bound(design: Design, bound: Callable[[ResolvedTask], float]) -> Design:
    """Return a design with a computed lower bound of effort and its gap: those in a file are not proven.

    A design of a maximised value has neither.
    """
    if design.value is not None:
        return design.model_copy(update={"lower_bound": None, "gap": None})
    least = bound(design.task)
    gap = Design.gap_of(design.objective, min(least, design.objective))
    return design.model_copy(update={"lower_bound": least, "gap": gap})


def compare_audits(before: Audit, after: Audit) -> str:
    """Return a sentence about how a design's audit changed."""
    clearances = (min((pair.analytic_m for pair in result.pairs), default=None) for result in (before, after))
    old, new = ("none" if gap is None else f"{lower_text(1000 * gap, 3)} mm" for gap in clearances)
    return f"Audit: {after.verdict} (before: {before.verdict}); smallest clearance {new} (before: {old})."


def brackets_note(design: Design) -> tuple[str, bool]:
    """Return a sentence about the clearance of a kit's brackets from airflow and rotors, as the audit proves it.

    The second value is False if they are not clear; the sentence then says what to change. They are audited even if
    the task has no `[module.bracket]`.

    Raises:
        RuntimeError: the audit failed; the message gives the reason.
    """
    sizes = design.task.module.bracket_sizes
    nearest = _nearest_bracket(design, sizes)
    if nearest is None:
        return "Brackets: there are no joints, or numbers are too large to audit them.", True
    clearance = f"{lower_text(1000 * nearest.analytic_m, 3)} mm"
    if nearest.status is Status.CLEAR:
        text = "Brackets are audited clear of all airflow and rotors; the smallest clearance is"
        return f"{text} {clearance}, {nearest.name}.", True
    found = f"Brackets are not clear: {nearest.name}, {clearance} ({nearest.status})"
    for smaller in sizes.smaller:
        if (pair := _nearest_bracket(design, smaller)) is not None and pair.status is Status.CLEAR:
            table = ", ".join(f"{name} = {value:g}" for name, value in dict(smaller).items())
            return f"{found}. Smaller ones are: search again with module.bracket = {{ {table} }}.", False
    advice = "search again with [module.bracket] in the task, which the audit then judges"
    return f"{found}, nor are smaller ones: {advice}.", False


def _nearest_bracket(design: Design, sizes: Bracket) -> Clearance | None:
    """Return the smallest clearance of brackets of some sizes, those that are not clear first; None without any."""
    module = design.task.module.model_copy(update={"bracket": sizes})
    task = design.task.model_copy(update={"module": module})
    kinds = ("bracket-airflow", "bracket-rotor")
    pairs = [pair for pair in audit(design.model_copy(update={"task": task})).pairs if pair.kind in kinds]
    return min(pairs, key=lambda pair: (pair.status is Status.CLEAR, pair.analytic_m), default=None)


def audit(design: Geometry, *, constraints: Iterable[OwnConstraint] = ()) -> Audit:
    """Return the exact audit of a design.

    It runs in the calling process, or in a worker process if there are constraints of your own. A geometry without
    rotor inputs is judged with the best inputs that the audit finds.

    Args:
        design: a design, or a geometry without inputs.
        constraints: your own constraints, evaluated on the design, not certified. Those that its file names but
            that are not given here are `not checked`.

    Raises:
        BadInput: `design` is neither, or a constraint cannot be used.
        RuntimeError: the audit failed; the message gives the reason.

    Example:
        >>> from topo_search import audit, read_design
        >>> result = audit(read_design("hover-2/best.json"))
        >>> result.verdict.value, result.pairs[0].name
        ('clear', 'airflow of modules 0 and 1')
    """
    if not isinstance(design, Geometry):
        raise BadInput("design", f"must be a Design or a Geometry, but got {type(design).__name__}")
    user_constraints = own_constraints(constraints)
    nlp.refuse_unusable(user_constraints, design.task, design.topology)
    (result,) = audits([design], workers=int(bool(user_constraints)), constraints=user_constraints)
    if isinstance(result, Failed):
        raise RuntimeError(f"the audit failed: {result.reason}")
    return result


def audits(
    designs: Iterable[Geometry], *, workers: int = 0, constraints: Sequence[OwnConstraint] = ()
) -> Iterator[Audit | Failed]:
    """Yield the audit of each design in order.

    Args:
        designs: designs or geometries, consumed lazily, a few ahead of the audits.
        workers: number of worker processes, where a crash fails only one audit; 0: the calling process.
        constraints: as for `audit`.
    """
    finished: dict[int, Audit | Failed] = {}
    next_number = 0
    with processes(workers) as engine:
        results = engine.run(
            partial(audit_job, backends(constraints).audit),
            enumerate(designs),
            deadline=lambda job: audit_deadline(job[1].topology.n),
        )
        for (number, _), result in results:
            finished[number] = result
            while next_number in finished:
                yield finished.pop(next_number)
                next_number += 1


def write_report(
    source: str | Path,
    *,
    out: str | Path | None = None,
    flight: str | Path | None = None,
    note: Callable[[str], None] = warnings.warn,
) -> Path:
    """Write the report of a run, or of a single design after auditing it, and return its path.

    Args:
        source: a run's folder or a design's file.
        out: the page's file; default: `report.html` in the folder, or the design's name with `.html`.
        flight: folder that `fly --out` wrote for the design; the page shows its flights.
        note: called with a warning for each file in a run's folder that differs from the ledger. The page shows the
            ledger.

    Raises:
        BadInput: the source is neither, the flights are of another design, the folder is in use by a run, or the
            page would replace a file that the run did not write.
        RuntimeError: the audit failed; the message gives the reason.

    Example:
        >>> from topo_search import write_report
        >>> print(write_report("hover-2/best.json", out="best.html"))
        best.html
    """
    from topo_search.report.design_page import design_page, read_simulated
    from topo_search.report.page import render
    from topo_search.report.run_page import run_page, write_run_page

    source = Path(source)
    if source.is_dir():
        if flight is not None:
            rule = f"must come with the file of the design that was flown, but got the folder {source}"
            raise BadInput("--flight", rule)
        with RunFolder.load(source, writes=out is None) as folder:
            for name in folder.changed_files():
                note(f"warning: {name} {CHANGED}; the page shows what the run wrote")
            if out is None:
                write_run_page(folder)
                return source / RunFile.REPORT
            page = run_page(folder)
    else:
        design = read_completed(source)
        simulated = None if flight is None else read_simulated(Path(flight), design)
        page = design_page(*_judge(design), source.name, simulated)
    path = Path(out or source.with_suffix(".html"))
    write_atomically(path, render(page))
    return path


def _judge(design: Design) -> tuple[Design, Audit]:
    return with_bound(design, nlp.proven_bound), audit(design)


def write_page(folder: RunFolder) -> None:
    """Write a run's page unless it is current; the import is here because only the coordinator needs it."""
    if folder.page_is_current():
        return
    from topo_search.report.run_page import write_run_page

    write_run_page(folder)


def plot_platform(design: Design, audited: Audit | None = None) -> Any:
    """Return an interactive 3-D Plotly figure of a design, with airflow envelopes and target regions.

    Args:
        design: the design.
        audited: its audit; with it the figure also shows the closest pair and the rod.

    Example:
        >>> from topo_search import plot_platform, read_answer
        >>> figure = plot_platform(read_answer("hover-2").design)
        >>> type(figure).__name__
        'Figure'
    """
    from topo_search.export.poses import poses_to_draw
    from topo_search.report.scene import figure
    from topo_search.report.wording import closest

    return figure(design, poses_to_draw(design), closest(audited), None if audited is None else audited.assembly)


figure = plot_platform
"""Former name of `plot_platform`."""


def view(design: Design, audited: Audit | None = None) -> View:
    """Return the 3-D view of the page of a design, for a cell of a notebook or as a page of its own.

    Args:
        design: the design.
        audited: its audit; None: audit it.

    Example:
        >>> from topo_search import read_answer, view
        >>> view(read_answer("hover-2").design)
        <3-D view of push: 2 modules, a10>
    """
    return View.of(design, audited or audit(design))


def compare(first: str | Path, second: str | Path, *, out: str | Path | None = None) -> Comparison:
    """Compare two runs or designs, and return the designs of each, best first.

    Args:
        first: a run's folder or a design's file.
        second: likewise.
        out: file of a page that shows both side by side; None: no page.

    Raises:
        BadInput: a source is neither, or is a run without a design.
        RuntimeError: the audit of a design failed; the message gives the reason.

    Example:
        >>> from topo_search import compare
        >>> [side[0].name for side in compare("hover-2", "hover-2/best.json")]
        ['hover-2/a10', 'best']
    """
    from topo_search.report.design_page import Comparison, compare_page
    from topo_search.report.page import render

    sides = Comparison(_designs(Path(source)) for source in (first, second))
    if out is not None:
        write_atomically(Path(out), render(compare_page(*sides)))
    return sides


def _designs(source: Path) -> list[Compared]:
    from topo_search.report.headline import Compared, compared_designs

    if not source.is_dir():
        design, judged = _judge(read_completed(source))
        return [Compared(source.stem, design, judged, design.gap if judged.verdict == "clear" else None)]
    with RunFolder.load(source) as folder:
        answer = answer_of(folder).at_level
        if answer.shown is None:
            raise BadInput(str(source), "holds no design yet")
        return [*compared_designs(folder.levels[answer.level], answer, f"{source.resolve().name}/")]
