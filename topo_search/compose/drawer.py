"""One drawer of brackets for several tasks: a design for each task, and the joints to change between tasks.

| symbol | meaning | unit |
|---|---|---|
| t, d, k | task, one of its designs, kind of bracket: the size of its angle, rounded as in the kit's file names | |
| x[t, d] | 1 if design d is chosen for task t | |
| c[d, k] | number of brackets of kind k in design d | |
| y[k, j] | 1 if the drawer has at least j of kind k: `y[k, j] >= sum x[t, d]` over d with `c[d, k] >= j` | |
| z[t, d, e] | 1 if d is chosen for task t and e for the next: `sum_e z = x[t, d]`, `sum_d z = x[t + 1, e]` | |
| m[d, e] | joints to undo and to bolt from d to e | |
| J, J* | effort of a design, least effort of its task | rad^4/s^4 |

Three integer programs in turn minimize sum y, then sum m z, then sum J / J* x; each keeps the optimum of the ones
before. Among designs of a task with the same assembly only the one with the least effort is a choice. Once the
least sum y is known, z is defined only for pairs d, e that a drawer of that size serves together with some design
of every other task. A bracket turned upside down tilts the other way, so kinds do not depend on the sign of the
angle. Modules are identical, and symmetric under half a turn.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from html import escape
from itertools import pairwise, product
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from topo_search.compose.designs import audits, brackets_note
from topo_search.compose.searching import search
from topo_search.export.brackets import DIGITS, PrintedPart, bracket, bracket_file, bracket_turns
from topo_search.export.html_page import html_page
from topo_search.export.kit import BRACKETS, write_kit
from topo_search.export.sheet import STYLE
from topo_search.export.tree_drawing import tree_svg
from topo_search.model import Audit, BadInput, Design, Fault, Status, Task
from topo_search.model.arrays import Array
from topo_search.model.files import to_json, write_atomically
from topo_search.model.html import paragraph, table
from topo_search.model.proven import upper_text
from topo_search.model.topology import PORT_NAMES
from topo_search.model.value import Index, Number, Value
from topo_search.report.wording import quantity
from topo_search.study import Observer, RunFolder, answer_of
from topo_search.study.optima import clear_designs


class NoCommonKit(Exception):
    """A task has no audited design to choose from."""


class ChosenDesign(Value):
    """The design chosen for a task."""

    task: str
    run: str
    """Folder of the task's run."""
    design: str
    """File of the design, relative to the folder of the kit."""
    topology_key: str
    over_best_percent: Number
    """Effort over the least effort of its task [%]."""


class Brackets(Value):
    """Brackets of one kind in the drawer."""

    angle_deg: Number
    """Size of the hinge angle [deg]."""
    count: Index
    """Number in the drawer: the largest number that any task needs."""

    @property
    def file(self) -> str:
        """STL file, relative to the folder of the kit."""
        return f"{BRACKETS}/{bracket_file(self.angle_deg)}"


class Step(Value):
    """One joint to undo or to bolt, by which a module leaves or joins the piece that the other modules form."""

    module: Index
    """The module that moves."""
    port: Index
    to: Index
    """The module of the piece at the joint."""
    to_port: Index
    bracket_deg: Number
    """Kind of the bracket: the size of the hinge angle [deg]."""

    @property
    def words(self) -> str:
        """The joint in words."""
        return (
            f"port {PORT_NAMES[self.port]} of module {self.module}, port {PORT_NAMES[self.to_port]} of module "
            f"{self.to}, bracket of {self.bracket_deg:.{DIGITS}f} deg"
        )


class Change(Value):
    """Joints to undo and to bolt from one task to the next; the shared part stays in one piece."""

    model_config = ConfigDict(serialize_by_alias=True, validate_by_name=True)

    before: str = Field(alias="from")
    """Task."""
    after: str = Field(alias="to")
    """The next task."""
    undo: Index
    """Number of joints to undo."""
    bolt: Index
    """Number of joints to bolt."""
    undo_steps: tuple[Step, ...]
    """In order, with module numbers of the design before; the rest stays in one piece."""
    bolt_steps: tuple[Step, ...]
    """In order, with module numbers of the design after; the bolted part is in one piece."""
    stay: tuple[tuple[Index, Index], ...]
    """Modules that stay bolted together: number in the design before, number in the design after."""

    @property
    def words(self) -> str:
        """Instruction for the change, without a full stop."""
        undo = quantity(self.undo, "joint")
        text = f"from {self.before} to {self.after}: undo {undo}, then bolt {self.bolt}"
        if len(self.stay) == 1:
            return f"{text}; no two modules stay together"
        stay = ", ".join(f"{i} as {j}" for i, j in self.stay)
        return f"{text}; these modules stay bolted together in one piece: {stay}"

    @property
    def instructions(self) -> list[str]:
        """The steps, one sentence each, in order."""
        steps = [("Undo", step) for step in self.undo_steps] + [("Bolt", step) for step in self.bolt_steps]
        return [f"{number}. {verb} {step.words}." for number, (verb, step) in enumerate(steps, start=1)]


class SharedKit(Value):
    """One drawer of brackets for several tasks, as `kit.json` holds it."""

    format: Literal["topo-search/kit"] = "topo-search/kit"
    version: Literal[1] = 1
    within_percent: Number
    """Largest effort of a choice over the least effort of its task [%]."""
    modules: Index
    """Number of modules of the largest design."""
    tasks: tuple[ChosenDesign, ...]
    """In the order given."""
    brackets: tuple[Brackets, ...]
    """By angle. No choice among the designs kept needs fewer brackets in total."""
    changes: tuple[Change, ...]
    """One from each task to the next."""
    designs_kept: tuple[Index, ...]
    """Number of designs to choose from, for each task."""

    @property
    def lines(self) -> list[str]:
        """The drawer, the tasks and the changes in words."""
        brackets, kinds = sum(kind.count for kind in self.brackets), quantity(len(self.brackets), "kind")
        excess = upper_text(max(task.over_best_percent for task in self.tasks), 3)
        choices = " x ".join(map(str, self.designs_kept))
        return [
            f"{self.modules} modules and {brackets} brackets of {kinds} do all tasks "
            f"within {excess} % of their least effort",
            f"no choice among the designs kept ({choices}) needs fewer brackets",
            *(f"bracket {kind.angle_deg:.{DIGITS}f} deg: {kind.count}" for kind in self.brackets),
            *(
                f"{task.task}: {task.topology_key}, {upper_text(task.over_best_percent, 3)} % over the least effort"
                for task in self.tasks
            ),
            *(change.words for change in self.changes),
        ]

    @property
    def pages(self) -> list[str]:
        """File names of the sheets, one for each change."""
        return [
            f"change-{number}-{change.before}-{change.after}.html"
            for number, change in enumerate(self.changes, start=1)
        ]


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
        observer: receives the progress of searches.
        note: called with remarks, such as on the clearance of brackets.

    Raises:
        BadInput: a run is not finished, modules differ between tasks, brackets do not fit, or the folder is in use.
        NoCommonKit: a run has no design with a clear audit.
    """
    out = Path(out)
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise BadInput("--out", f"must be a new or empty folder, but got {out}")
    runs, choices = list[Path](), list[list[Design]]()
    for task in tasks:
        if isinstance(task, Task) or not Path(task).is_dir():
            task = search(task, keep_within=within, workers=workers, observer=observer).folder
        runs.append(Path(task))
        choices.append(_read_choices(runs[-1], within))
    _require_same_module(runs, choices)
    if tolerance_deg:
        separate, choices = choices, share_brackets(choices, tolerance_deg, within)
        if choices == separate:
            note(f"no design is clear with a bracket shared within {tolerance_deg:g} deg")
    chosen = [designs[d] for designs, d in zip(choices, choose(choices), strict=True)]
    shared = _describe(runs, choices, chosen, within)
    for number, (design, entry) in enumerate(zip(chosen, shared.tasks, strict=True)):
        brackets, _ = brackets_note(design)
        changes = [f"{change.words}." for change in shared.changes[number - 1 : number]]
        written = write_kit(design, (out / entry.design).parent, (*changes, brackets))
        for text in (brackets, *written.notes):
            note(f"{entry.task}: {text}")
    for kind in shared.brackets:
        solid = bracket(chosen[0].task.module.bracket_sizes, math.radians(kind.angle_deg))
        write_atomically(out / kind.file, PrintedPart("bracket", kind.file, solid).stl())
    for name, change, pair in zip(shared.pages, shared.changes, pairwise(chosen), strict=True):
        title = f"From {change.before} to {change.after}"
        write_atomically(out / name, html_page(title, STYLE, _change_lines(change, *pair)))
    write_atomically(out / "index.html", _drawer_page(shared, chosen))
    write_atomically(out / "kit.json", to_json(shared))
    return shared


def share_brackets(choices: Sequence[Sequence[Design]], tolerance_deg: float, within: float) -> list[list[Design]]:
    """Return the choices, and clear designs with hinge angles of shared brackets in addition.

    Sizes of angles are grouped from the smallest up, in groups no wider than the tolerance, and replaced by the
    middle of their group. Root orientation and end-effector stay; the inputs are recomputed.
    """
    from nlp.refit import NotPossible, refit  # loads CasADi

    sizes = sorted({size for designs in choices for design in designs for size in count_kinds(design)})
    shared, group = dict[float, float](), list[float]()
    for size, next_size in zip(sizes, [*sizes[1:], math.inf], strict=True):
        group.append(size)
        if next_size - group[0] > tolerance_deg:
            shared |= dict.fromkeys(group, round((group[0] + group[-1]) / 2, DIGITS))
            group = []
    result = []
    for designs in choices:
        refitted = list[Design]()
        for design in designs:
            if all(shared[size] == size for size in count_kinds(design)):
                continue
            turns = zip(design.hinge_angles_rad, bracket_turns(design), strict=True)
            with suppress(NotPossible):
                angles = [math.copysign(math.radians(shared[abs(phi)]), a) for a, phi in turns]
                refitted.append(refit(design, angles))
        largest = (1 + within / 100) * designs[0].objective
        clear = [
            design
            for design, audit in zip(refitted, audits(refitted), strict=True)
            if isinstance(audit, Audit) and audit.verdict is Status.CLEAR and design.objective <= largest
        ]
        result.append(sorted((*designs, *clear), key=lambda design: design.objective))
    return result


def choose(choices: Sequence[Sequence[Design]]) -> tuple[int, ...]:
    """Return the index of the chosen design of each task; the programs are those of the module's docstring."""
    kept = [_without_copies(each) for each in choices]
    designs = [each[d] for each, indices in zip(choices, kept, strict=True) for d in indices]
    first = np.cumsum([0, *map(len, kept)]).tolist()
    tasks = [range(*bounds) for bounds in pairwise(first)]
    counts = [count_kinds(design) for design in designs]
    brackets = sorted({(kind, j) for count in counts for kind, c in count.items() for j in range(1, c + 1)})
    needs = np.array([[count[kind] >= j for kind, j in brackets] for count in counts]).reshape(len(designs), -1)
    y = range(len(designs), len(designs) + len(brackets))
    rows: list[BracketRow] = [(dict.fromkeys(task, 1.0), 1.0, 1.0) for task in tasks]
    for task, (k, y_k) in product(tasks, enumerate(y)):
        rows.append(({y_k: 1.0} | {d: -1.0 for d in task if needs[d, k]}, 0.0, math.inf))
    drawer = dict.fromkeys(y, 1.0)
    _, fewest = _minimize(drawer, rows, y.stop, len(designs))
    rows.append((drawer, -math.inf, round(fewest) + 0.5))
    z = {pair: number for number, pair in enumerate(_pairs(needs, tasks, round(fewest)), start=y.stop)}
    for side, linked in enumerate((range(first[-2]), range(first[1], first[-1]))):
        rows += [({d: -1.0} | {z_k: 1.0 for pair, z_k in z.items() if pair[side] == d}, 0.0, 0.0) for d in linked]
    moves = dict[int, float]()
    for pair, number in z.items():
        before, after = (designs[d] for d in pair)
        moves[number] = before.topology.n + after.topology.n - 2 * len(shared_part(before, after))
    _, fewest_moves = _minimize(moves, rows, y.stop + len(z), len(designs))
    rows.append((moves, -math.inf, round(fewest_moves) + 0.5))
    excess = [_excess(designs[d], designs[task.start : task.stop]) for task in tasks for d in task]
    effort = {d: 1e6 * value for d, value in enumerate(excess)}  # HiGHS stops within 1e-6 of the optimum
    x, _ = _minimize(effort, rows, y.stop + len(z), len(designs))
    return tuple(indices[int(np.argmax(x[task]))] for indices, task in zip(kept, tasks, strict=True))


BracketRow = tuple[dict[int, float], float, float]
"""A linear constraint: coefficients by variable, lower and upper bound of their sum."""


def _minimize(cost: dict[int, float], rows: Sequence[BracketRow], size: int, integers: int) -> tuple[Array, float]:
    """Minimize a cost over variables from 0 to 1, the first `integers` of them whole; return point and cost."""
    from scipy.optimize import LinearConstraint, milp  # slow to import
    from scipy.sparse import csr_array

    entries = [(r, c, value) for r, (row, _, _) in enumerate(rows) for c, value in row.items()]
    at_row, at_column, values = zip(*entries, strict=True)
    _, lower, upper = zip(*rows, strict=True)
    solution = milp(
        [cost.get(c, 0.0) for c in range(size)],
        constraints=LinearConstraint(csr_array((values, (at_row, at_column)), (len(rows), size)), lower, upper),
        integrality=np.arange(size) < integers,
        bounds=(0, 1),
        options={"mip_rel_gap": 0.0, "presolve": False},  # SciPy 1.17's presolve may never end on efforts
    )
    if not solution.success:
        raise RuntimeError(f"the integer program of the drawer failed: {solution.message}")
    return solution.x, solution.fun


def _pairs(needs: NDArray[np.bool_], tasks: Sequence[range], fewest: int) -> Iterator[tuple[int, int]]:
    """Yield pairs of designs of adjacent tasks that `fewest` brackets serve with some design of each other task."""
    for t, (before, after) in enumerate(pairwise(tasks)):
        for d in before:
            both = needs[d] | needs[after]
            served = both.sum(axis=1) <= fewest
            for task in (*tasks[:t], *tasks[t + 2 :]):
                more = ~both @ needs[task].T.astype(int)
                served &= both.sum(axis=1) + more.min(axis=1) <= fewest
            yield from ((d, after[e]) for e in np.flatnonzero(served).tolist())


def _without_copies(designs: Sequence[Design]) -> list[int]:
    """Return the indices of designs with distinct assemblies, of each the design with the least effort."""
    distinct: dict[frozenset[tuple[float, int]], list[int]] = {}
    for d in sorted(range(len(designs)), key=lambda d: designs[d].objective):
        same_kinds = distinct.setdefault(frozenset(count_kinds(designs[d]).items()), [])
        n = designs[d].topology.n
        if not any(len(shared_part(designs[d], designs[e])) == n == designs[e].topology.n for e in same_kinds):
            same_kinds.append(d)
    return sorted(d for same_kinds in distinct.values() for d in same_kinds)


def count_kinds(design: Design) -> Counter[float]:
    """Return the number of brackets of each kind, by the size of the angle [deg]."""
    return Counter(map(abs, bracket_turns(design)))


def shared_part(first: Design, second: Design) -> dict[int, int]:
    """Return the largest connected part that two designs share: its modules in the first, and in the second.

    The result is exact: a joint of one design that is matched with a joint of the other fixes all other modules.
    """
    ports = _ports(first), _ports(second)
    sides = [[(i, a, phi) for i, joints in side.items() for a, (*_, phi) in joints.items()] for side in ports]
    largest = {0: 0}
    seen = set[tuple[int, int, int]]()
    for (start, a, angle), (match, b, match_angle) in product(*sides):
        turn = (b - a) % 4
        if angle != match_angle or turn % 2 or (start, match, turn) in seen:
            continue
        part, grown = {start: (match, turn)}, [start]
        for i in grown:
            j, turn = part[i]
            for port, (child, child_port, phi) in ports[0][i].items():
                joint = ports[1][j].get((port + turn) % 4)
                if child not in part and joint and joint[2] == phi and (joint[1] - child_port) % 2 == 0:
                    part[child] = joint[0], (joint[1] - child_port) % 4
                    grown.append(child)
        seen.update((i, *matched) for i, matched in part.items())
        if len(part) > len(largest):
            largest = {i: j for i, (j, _) in part.items()}
    return largest


def _ports(design: Design) -> dict[int, dict[int, tuple[int, int, float]]]:
    """Return for each module and port with a joint the module and port at its other end, and phi."""
    ports: dict[int, dict[int, tuple[int, int, float]]] = {i: {} for i in range(design.topology.n)}
    for (h, i, a, b), phi in zip(design.topology.edges(), bracket_turns(design), strict=True):
        ports[h][a], ports[i][b] = (i, b, phi), (h, a, phi)
    return ports


def growing_steps(design: Design, piece: Iterable[int]) -> tuple[Step, ...]:
    """Return the joints that complete a platform from a piece of it, module by module."""
    ports, grown = _ports(design), list(piece)
    steps, bolted = list[Step](), set(grown)
    for i in grown:
        for port, (j, port_of_j, phi) in ports[i].items():
            if j not in bolted:
                bolted.add(j)
                grown.append(j)
                steps.append(Step(module=j, port=port_of_j, to=i, to_port=port, bracket_deg=abs(phi)))
    return tuple(steps)


def _excess(design: Design, choices: Sequence[Design]) -> float:
    least = min(choice.objective for choice in choices)
    return design.objective / least - 1 if least else 0.0


def _read_choices(run: Path, within: float) -> list[Design]:
    """Return a run's clear designs as large as its best one, with at most `within` % more effort, by effort."""
    with RunFolder.load(run) as folder:
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
        changes.append(
            Change(
                before=before.task.name,
                after=after.task.name,
                undo=before.topology.n - len(part),
                bolt=after.topology.n - len(part),
                undo_steps=growing_steps(before, part)[::-1],
                bolt_steps=growing_steps(after, part.values()),
                stay=tuple(sorted(part.items())),
            )
        )
    return SharedKit(
        within_percent=within,
        modules=max(design.topology.n for design in chosen),
        tasks=tuple(
            ChosenDesign(
                task=design.task.name,
                run=str(run),
                design=f"{number}-{design.task.name}/design.json",
                topology_key=design.topology.key,
                over_best_percent=100 * _excess(design, designs),
            )
            for number, (run, designs, design) in enumerate(zip(runs, choices, chosen, strict=True), start=1)
        ),
        brackets=tuple(Brackets(angle_deg=angle, count=count) for angle, count in sorted(drawer.items())),
        changes=tuple(changes),
        designs_kept=tuple(map(len, choices)),
    )


def _drawer_page(shared: SharedKit, designs: Sequence[Design]) -> str:
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
        lines += _change_lines(change, designs[number], designs[number + 1])
    return html_page(f"One drawer for {len(designs)} tasks", STYLE, lines)


def _change_lines(change: Change, before: Design, after: Design) -> Iterator[str]:
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
