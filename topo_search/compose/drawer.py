"""One drawer of brackets for several tasks: a design for each task, and the joints to change between tasks."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from html import escape
from itertools import pairwise
from pathlib import Path

from topo_search.compose.choosing import choose, count_kinds, excess, ports_of, shared_part
from topo_search.compose.designs import brackets_note
from topo_search.compose.rounding import NotClear, move_hinges
from topo_search.compose.searching import search
from topo_search.compose.shared_kit import Brackets, Change, ChosenDesign, SharedKit, Step
from topo_search.export.brackets import DIGITS, PrintedPart, bracket
from topo_search.export.kit import write_kit
from topo_search.export.sheet import STYLE
from topo_search.export.tree_drawing import tree_svg
from topo_search.model import BadInput, Design, Fault, Task
from topo_search.model.files import to_json, write_atomically
from topo_search.model.html import html_page, paragraph, table
from topo_search.model.task_file import read_task
from topo_search.study import Observer, RunFolder, answer_of
from topo_search.study.optima import clear_designs


class NoCommonKit(Exception):
    """A task has no audited design to choose from."""


def kit(
    tasks: Sequence[Task | str | Path],
    *,
    out: str | Path,
    within: float = 2.0,
    tolerance_deg: float = 0.0,
    workers: int | None = None,
    observer: Observer | None = None,
    note: Callable[[str], None] = lambda _: None,
) -> SharedKit:
    """Choose a design for each of several tasks so that few brackets serve all of them, and write the kits.

    Args:
        tasks: tasks, task files, names of examples, or folders of finished runs. A task is searched first, in the
            default folder of `search`, and every local optimum is kept. The choices are the clear designs of a run
            that have as many modules as its best design.
        out: a new or empty folder. It gets `kit.json`, a page, a sheet per change, one file to print per kind of
            bracket, and a folder per task with its kit.
        within: largest effort of a design over the least effort of its task [%].
        tolerance_deg: width of the range of hinge angles that one bracket may serve [deg]. Designs whose angles are
            moved to the middle of such a range are also choices, if they are clear.
        workers: worker processes of a search; default: the cores available.
        observer: receives the progress of searches; default: as for `search`.
        note: called with remarks, such as on the clearance of brackets.

    Raises:
        BadInput: a run is not finished, modules differ, brackets do not fit, or the folder is in use.
        NoCommonKit: a run has no design with a clear audit.
        NotClear: the brackets of a chosen design are not clear.

    Example:
        >>> from topo_search import kit
        >>> [brackets.count for brackets in kit(["hover-2"], out="drawer").brackets]
        [1]
    """
    out = Path(out)
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise BadInput("--out", f"must be a new or empty folder, but got {out}")
    runs, choices = list[Path](), list[list[Design]]()
    for task in tasks:
        if isinstance(task, Task) or not Path(task).is_dir():
            _refuse_types(task if isinstance(task, Task) else read_task(task))
            task = search(task, keep_within=within, workers=workers, observer=observer).folder
        runs.append(Path(task))
        choices.append(_read_choices(runs[-1], within))
    _require_same_module(runs, choices)
    for design in (designs[0] for designs in choices):
        least = min((b - a for a, b in pairwise(design.task.search.hinge_set_deg or ())), default=math.inf)
        if tolerance_deg >= least:
            rule = f"must be below {least:g}, by which hinge angles of {design.task.name} differ"
            raise BadInput("--bracket-tolerance", f"{rule}, but got {tolerance_deg:g}")
    if tolerance_deg:
        choices = share_brackets(choices, tolerance_deg, within)
    chosen = [designs[d] for designs, d in zip(choices, choose(choices), strict=True)]
    shared, clearances = _describe(runs, choices, chosen, within), list[str]()
    for design in chosen:
        brackets, are_clear = brackets_note(design)
        if not are_clear:
            raise NotClear(f"{design.task.name}: {brackets} Nothing is written.")
        clearances.append(brackets)
    for number, (design, entry, brackets) in enumerate(zip(chosen, shared.tasks, clearances, strict=True)):
        changes = [f"{change.words}." for change in shared.changes[number - 1 : number]]
        written = write_kit(design, (out / entry.design).parent, (*changes, brackets))
        for text in (brackets, *written.notes):
            note(f"{entry.task}: {text}")
    for kind in shared.brackets:
        solid = bracket(chosen[0].task.module.bracket_sizes, math.radians(kind.angle_deg))
        write_atomically(out / kind.file, PrintedPart("bracket", kind.file, solid).stl())
    for name, change, pair in zip(shared.pages, shared.changes, pairwise(chosen), strict=True):
        title = f"From {change.before} to {change.after}"
        write_atomically(out / name, html_page(title, STYLE, change_lines(change, *pair)))
    write_atomically(out / "index.html", drawer_page(shared, chosen))
    write_atomically(out / "kit.json", to_json(shared))
    return shared


def share_brackets(choices: Sequence[Sequence[Design]], tolerance_deg: float, within: float) -> list[list[Design]]:
    """Return the choices, with clear designs for shared brackets in addition.

    Sizes of angles are grouped from the smallest up, in groups no wider than the tolerance, and replaced by the
    middle of their group. Root orientation, end-effector and inputs are solved again.
    """
    sizes = sorted({size for designs in choices for design in designs for size in count_kinds(design)})
    shared, group = dict[float, float](), list[float]()
    for size, next_size in zip(sizes, [*sizes[1:], math.inf], strict=True):
        group.append(size)
        if next_size - group[0] > tolerance_deg:
            shared |= dict.fromkeys(group, round((group[0] + group[-1]) / 2, DIGITS))
            group = []
    result = []
    for designs in choices:
        clear, largest = list[Design](), (1 + within / 100) * designs[0].objective
        for design in designs:
            angles = {shared[size] for size in count_kinds(design)}
            if angles == set(count_kinds(design)):
                continue
            with suppress(NotClear):
                moved, _ = move_hinges(design, hinge_angles_deg=tuple(angles))
                clear += [moved] if moved.objective <= largest else []
        result.append(sorted((*designs, *clear), key=lambda design: design.objective))
    return result


def growing_steps(design: Design, piece: Iterable[int]) -> tuple[Step, ...]:
    """Return the joints that complete a platform from a piece of it, module by module."""
    ports, grown = ports_of(design), list(piece)
    steps, bolted = list[Step](), set(grown)
    for i in grown:
        for port, (j, port_of_j, phi) in ports[i].items():
            if j not in bolted:
                bolted.add(j)
                grown.append(j)
                steps.append(Step(module=j, port=port_of_j, to=i, to_port=port, bracket_deg=abs(phi)))
    return tuple(steps)


def _read_choices(run: Path, within: float) -> list[Design]:
    """Return a run's clear designs as large as its best one, with at most `within` % more effort, by effort."""
    with RunFolder.load(run) as folder:
        _refuse_types(folder.request.task)
        answer = answer_of(folder)
        if not answer.complete:
            rule = "must be a finished run, but it is not; continue it with the same command"
            raise BadInput(str(run), rule)
        best = answer.best
        if best is None or best.objective is None:
            raise NoCommonKit(f"no common kit: {run} has no design with a clear audit")
        level = folder.levels[answer.level]
        largest = (1 + within / 100) * best.objective
        designs = [
            design
            for row in level.ledger.ranking(best.modules)
            if row.objective is not None and row.objective <= largest
            for design in clear_designs(level, row)
            if design.objective <= largest
        ]
        return sorted(designs, key=lambda design: (design.objective, design.topology.key))


def _refuse_types(task: Task) -> None:
    if task.module_types:
        rule = f"must be left out, as one drawer holds modules of one kind, but got {len(task.module_types)}"
        raise BadInput(task.name, [Fault("module_types", rule)])


def _require_same_module(runs: Sequence[Path], choices: Sequence[Sequence[Design]]) -> None:
    """Raise BadInput unless all tasks have the same module; airflow may differ, as it depends on the task."""
    first, *modules = (designs[0].task.module.model_dump(mode="json", exclude={"airflow"}) for designs in choices)
    for run, module in zip(runs[1:], modules, strict=True):
        if faults := [
            Fault(f"module.{name}", f"must be that of {runs[0]}, as one drawer holds modules of one kind")
            for name in sorted({*first, *module})
            if first.get(name) != module.get(name)
        ]:
            raise BadInput(str(run), faults)


def _describe(
    runs: Sequence[Path], choices: Sequence[Sequence[Design]], chosen: Sequence[Design], within: float
) -> SharedKit:
    """Return the contents of `kit.json` for the chosen designs."""
    drawer = Counter[float]()
    for design in chosen:
        drawer |= count_kinds(design)
    changes = []
    for before, after in pairwise(chosen):
        part = shared_part(before, after)
        change = Change(
            before=before.task.name,
            after=after.task.name,
            undo=before.topology.n - len(part),
            bolt=after.topology.n - len(part),
            undo_steps=growing_steps(before, part)[::-1],
            bolt_steps=growing_steps(after, part.values()),
            stay=tuple(sorted(part.items())),
        )
        changes.append(change)
    return SharedKit(
        within_percent=within,
        modules=max(design.topology.n for design in chosen),
        tasks=tuple(
            ChosenDesign(
                task=design.task.name,
                run=str(run),
                design=f"{number}-{design.task.name}/design.json",
                topology_key=design.topology.key,
                over_best_percent=100 * excess(design, designs),
            )
            for number, (run, designs, design) in enumerate(zip(runs, choices, chosen, strict=True), start=1)
        ),
        brackets=tuple(Brackets(angle_deg=angle, count=count) for angle, count in sorted(drawer.items())),
        changes=tuple(changes),
        designs_kept=tuple(map(len, choices)),
    )


def drawer_page(shared: SharedKit, designs: Sequence[Design]) -> str:
    """Return the page of a kit: its brackets, the design of each task, and every change."""
    lines = [paragraph(text) for text in shared.lines[:2]]
    brackets = [(f"{kind.angle_deg:.{DIGITS}f}", kind.count, kind.file) for kind in shared.brackets]
    lines += ["<h2>Drawer</h2>", table(("hinge angle [deg]", "brackets", "to print"), brackets), "<h2>Tasks</h2>"]
    captions = [
        f'<a href="{escape(task.design.replace("design.json", "assembly.html"))}">{escape(task.task)}</a>'
        for task in shared.tasks
    ]
    lines.append(_side_by_side(zip(captions, map(tree_svg, designs), strict=True)))
    for number, change in enumerate(shared.changes):
        lines += change_lines(change, designs[number], designs[number + 1])
    return html_page(f"One drawer for {len(designs)} tasks", STYLE, lines)


def change_lines(change: Change, before: Design, after: Design) -> Iterator[str]:
    """Yield drawings of both platforms, with the joints that stay in green, and the steps in order."""
    yield f"<h2>From {escape(change.before)} to {escape(change.after)}</h2>"
    stays = zip((before, after), zip(*change.stay, strict=True), strict=True)
    yield _side_by_side((escape(design.task.name), tree_svg(design, marked=stay)) for design, stay in stays)
    yield paragraph(
        "Joints that stay are green. Modules come off, and are added, one at a time; the others stay in one piece."
    )
    yield from (paragraph(text) for text in change.instructions)
    yield paragraph(
        f"Then mount rod and end-effector as in the last step of the assembly sheet of {escape(change.after)}, "
        "and load the allocation of that kit into the autopilot."
    )


def _side_by_side(drawings: Iterable[tuple[str, str]]) -> str:
    figures = (f"<figure><figcaption>{caption}</figcaption>{svg}</figure>" for caption, svg in drawings)
    return f"<section>{''.join(figures)}</section>"
