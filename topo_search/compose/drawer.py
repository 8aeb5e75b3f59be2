"""One drawer of brackets for several tasks: a design for each from its run, and what to move from task to task.

| symbol | meaning | unit |
|---|---|---|
| t, d, k | task, one of its designs, kind of bracket: the size of its angle, rounded as in the kit's file names | |
| x[t, d] | 1 for the design that is chosen | |
| c[d, k] | brackets of a kind in a design | |
| y[k, j] | 1 if the drawer has j or more of a kind: `y[k, j] >= sum x[t, d]` of all d with `c[d, k] >= j` | |
| z[t, d, e] | 1 if d is chosen for task t and e for the next: `sum_e z = x[t, d]`, `sum_d z = x[t + 1, e]` | |
| m[d, e] | joints to undo and to bolt from d to e | |
| J, J* | effort of a design, and the least of its task | rad^4/s^4 |

Least sum y first, of these least sum m z, of these least sum J / J* x: three integer programs. Of designs of a task
that are bolted alike only the one with the least effort is a choice. Once the least sum y is known, z is only for d
and e that such a drawer serves, with some design of each other task. A bracket turned upside down turns the other
way, so the sign of its angle makes no other kind. Modules are alike, and alike after half a turn.
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
from topo_search.export.brackets import DIGITS, Part, bracket, bracket_file, bracket_turns
from topo_search.export.kit import BRACKETS, write_kit
from topo_search.export.sheet import STYLE
from topo_search.export.tree_drawing import tree_svg
from topo_search.model import Audit, BadInput, Design, Fault, Status, Task
from topo_search.model.arrays import Array
from topo_search.model.files import to_json, write_atomically
from topo_search.model.proven import upper_text
from topo_search.model.text import html_page, paragraph, table
from topo_search.model.topology import PORT_NAMES
from topo_search.model.value import Index, Number, Value
from topo_search.report.wording import quantity
from topo_search.study import Observer, RunFolder, answer_of
from topo_search.study.optima import clear_designs

FILE, PAGE = "kit.json", "index.html"


class NoCommonKit(Exception):
    """A task has no audited design to choose from."""


class ChosenDesign(Value):
    """The design that is chosen for a task."""

    task: str
    run: str
    """Folder of its run."""
    design: str
    """Its file, in the folder of the kit."""
    topology_key: str
    over_best_percent: Number
    """Effort over the least of its task [%]."""


class Brackets(Value):
    """Brackets of one kind in the drawer."""

    angle_deg: Number
    """Size of the hinge angle [deg]."""
    count: Index
    """As many as the task that needs most of them."""

    @property
    def file(self) -> str:
        """Path of its STL file in the folder of the kit."""
        return f"{BRACKETS}/{bracket_file(self.angle_deg)}"


class Step(Value):
    """One joint to undo or to bolt: a module that comes off the piece that the others form, or is added to it."""

    module: Index
    """The module that moves."""
    port: Index
    to: Index
    """The module of the piece."""
    to_port: Index
    bracket_deg: Number
    """Kind of the bracket: the size of the hinge angle [deg]."""

    @property
    def words(self) -> str:
        """The joint."""
        return (
            f"port {PORT_NAMES[self.port]} of module {self.module}, port {PORT_NAMES[self.to_port]} of module "
            f"{self.to}, bracket of {self.bracket_deg:.{DIGITS}f} deg"
        )


class Change(Value):
    """Joints to undo and to bolt from one task to the next; the part that stays is in one piece."""

    model_config = ConfigDict(serialize_by_alias=True, validate_by_name=True)

    before: str = Field(alias="from")
    """Task."""
    after: str = Field(alias="to")
    """The next task."""
    undo: Index
    """Number of joints."""
    bolt: Index
    """Number of joints."""
    undo_steps: tuple[Step, ...]
    """In order, numbered as in the design before; what is left stays in one piece."""
    bolt_steps: tuple[Step, ...]
    """In order, numbered as in the design after; what is there is in one piece."""
    stay: tuple[tuple[Index, Index], ...]
    """Modules that stay bolted together: number in the design before, and in that after."""

    @property
    def words(self) -> str:
        """Instruction for the change, without a full stop."""
        undo = quantity(self.undo, "joint")
        todo = f"from {self.before} to {self.after}: undo {undo}, then bolt {self.bolt}"
        if len(self.stay) == 1:
            return f"{todo}; no two modules stay together"
        stay = ", ".join(f"{i} as {j}" for i, j in self.stay)
        return f"{todo}; these modules stay bolted together in one piece: {stay}"

    @property
    def instructions(self) -> list[str]:
        """The steps, one sentence each, in order."""
        steps = [("Undo", step) for step in self.undo_steps] + [("Bolt", step) for step in self.bolt_steps]
        return [f"{number}. {what} {step.words}." for number, (what, step) in enumerate(steps, start=1)]


class SharedKit(Value):
    """One drawer of brackets for several tasks, as `kit.json` holds it."""

    format: Literal["topo-search/kit"] = "topo-search/kit"
    version: Literal[1] = 1
    within_percent: Number
    """Largest effort of a design that could be chosen, over the least of its task [%]."""
    modules: Index
    """Number of modules of the largest design."""
    tasks: tuple[ChosenDesign, ...]
    """In the order given."""
    brackets: tuple[Brackets, ...]
    """By angle. No choice of the designs kept needs fewer in all."""
    changes: tuple[Change, ...]
    """One from each task to the next."""
    designs_kept: tuple[Index, ...]
    """Number of designs that each task could choose from."""

    @property
    def lines(self) -> list[str]:
        """The drawer, the tasks and the changes, for a reader."""
        brackets, kinds = sum(kind.count for kind in self.brackets), quantity(len(self.brackets), "kind")
        most = upper_text(max(task.over_best_percent for task in self.tasks), 3)
        kept = " x ".join(map(str, self.designs_kept))
        return [
            f"{self.modules} modules and {brackets} brackets of {kinds} do all tasks "
            f"within {most} % of their least effort",
            f"no choice of the designs kept ({kept}) needs fewer brackets",
            *(f"bracket {kind.angle_deg:.{DIGITS}f} deg: {kind.count}" for kind in self.brackets),
            *(
                f"{task.task}: {task.topology_key}, {upper_text(task.over_best_percent, 3)} % over the least effort"
                for task in self.tasks
            ),
            *(change.words for change in self.changes),
        ]

    @property
    def pages(self) -> list[str]:
        """Names of the sheets of the changes."""
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
    """Choose a design for each of several tasks such that few brackets serve them all, and write their kits.

    Args:
        tasks: tasks, files, names of examples, or folders of finished runs. What is no folder is searched first,
            in its default folder of `search`, with every local optimum kept; each gives its clear designs as large
            as its best.
        out: a new or empty folder, which gets `kit.json`, a page, a sheet a change, the brackets of the drawer to
            print, a file a kind, and a folder with the kit of each task.
        within: largest effort of a design over the least of its task [%].
        tolerance_deg: range of angles that one bracket may serve: designs with such angles replaced by the middle
            of the range are choices as well, if they are clear [deg].
        workers: worker processes of a search; default: the cores available.
        observer: receives the progress of searches.
        note: receives what is to be known beside it.

    Raises:
        BadInput: something is no finished run, modules differ, brackets do not fit, or the folder is in use.
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
        alone, choices = choices, share_brackets(choices, tolerance_deg, within)
        if choices == alone:
            note(f"no design is clear with a bracket shared within {tolerance_deg:g} deg")
    chosen = [designs[d] for designs, d in zip(choices, choose(choices), strict=True)]
    shared = _describe(runs, choices, chosen, within)
    for number, (design, entry) in enumerate(zip(chosen, shared.tasks, strict=True)):
        beside = brackets_note(design)
        before = [f"{change.words}." for change in shared.changes[number - 1 : number]]
        written = write_kit(design, (out / entry.design).parent, (*before, beside))
        for text in (beside, *written.notes):
            note(f"{entry.task}: {text}")
    for kind in shared.brackets:
        solid = bracket(chosen[0].task.module.bracket_sizes, math.radians(kind.angle_deg))
        write_atomically(out / kind.file, Part("bracket", kind.file, solid).stl())
    for name, change, pair in zip(shared.pages, shared.changes, pairwise(chosen), strict=True):
        title = f"From {change.before} to {change.after}"
        write_atomically(out / name, html_page(title, STYLE, _change_lines(change, *pair)))
    write_atomically(out / PAGE, _drawer_page(shared, chosen))
    write_atomically(out / FILE, to_json(shared))
    return shared


def share_brackets(choices: Sequence[Sequence[Design]], tolerance_deg: float, within: float) -> list[list[Design]]:
    """Return choices with designs added whose hinge angles are those of shared brackets, if they are clear.

    Sizes of angles are shared in groups no wider than the tolerance, from the least on; the root's orientation and
    the end-effector stay, the inputs are found again.
    """
    from nlp.evaluation import NotPossible, refit  # loads CasADi

    sizes = sorted({size for designs in choices for design in designs for size in count_kinds(design)})
    shared, group = dict[float, float](), list[float]()
    for size, after in zip(sizes, [*sizes[1:], math.inf], strict=True):
        group.append(size)
        if after - group[0] > tolerance_deg:
            shared |= dict.fromkeys(group, round((group[0] + group[-1]) / 2, DIGITS))
            group = []
    result = []
    for designs in choices:
        moved = list[Design]()
        for design in designs:
            if all(shared[size] == size for size in count_kinds(design)):
                continue
            turns = zip(design.hinge_angles_rad, bracket_turns(design), strict=True)
            with suppress(NotPossible):
                moved.append(refit(design, [math.copysign(math.radians(shared[abs(phi)]), a) for a, phi in turns]))
        most = (1 + within / 100) * designs[0].objective
        clear = [
            design
            for design, verdict in zip(moved, audits(moved), strict=True)
            if isinstance(verdict, Audit) and verdict.verdict is Status.CLEAR and design.objective <= most
        ]
        result.append(sorted((*designs, *clear), key=lambda design: design.objective))
    return result


def choose(choices: Sequence[Sequence[Design]]) -> tuple[int, ...]:
    """Return the index of the design to choose for each task, by the programs of the module's docstring."""
    kept = [_without_copies(each) for each in choices]
    designs = [each[d] for each, of in zip(choices, kept, strict=True) for d in of]
    first = np.cumsum([0, *map(len, kept)]).tolist()
    tasks = [range(*bounds) for bounds in pairwise(first)]
    counts = [count_kinds(design) for design in designs]
    brackets = sorted({(kind, j) for count in counts for kind, most in count.items() for j in range(1, most + 1)})
    needs = np.array([[count[kind] >= j for kind, j in brackets] for count in counts]).reshape(len(designs), -1)
    y = range(len(designs), len(designs) + len(brackets))
    rows: list[BracketRow] = [(dict.fromkeys(of, 1.0), 1.0, 1.0) for of in tasks]
    for of, (k, y_k) in product(tasks, enumerate(y)):
        rows.append(({y_k: 1.0} | {d: -1.0 for d in of if needs[d, k]}, 0.0, math.inf))
    drawer = dict.fromkeys(y, 1.0)
    _, fewest = _least(drawer, rows, y.stop, len(designs))
    rows.append((drawer, -math.inf, round(fewest) + 0.5))
    z = {pair: number for number, pair in enumerate(_pairs(needs, tasks, round(fewest)), start=y.stop)}
    for side, of in enumerate((range(first[-2]), range(first[1], first[-1]))):
        rows += [({d: -1.0} | {number: 1.0 for pair, number in z.items() if pair[side] == d}, 0.0, 0.0) for d in of]
    moves = dict[int, float]()
    for pair, number in z.items():
        one, other = (designs[d] for d in pair)
        moves[number] = one.topology.n + other.topology.n - 2 * len(shared_part(one, other))
    _, least = _least(moves, rows, y.stop + len(z), len(designs))
    rows.append((moves, -math.inf, round(least) + 0.5))
    excess = [_excess(each[d], each) for each, of in zip(choices, kept, strict=True) for d in of]
    effort = {d: 1e6 * over for d, over in enumerate(excess)}  # HiGHS stops within 1e-6 of the least
    x, _ = _least(effort, rows, y.stop + len(z), len(designs))
    return tuple(each[int(np.argmax(x[of]))] for each, of in zip(kept, tasks, strict=True))


BracketRow = tuple[dict[int, float], float, float]
"""A constraint: coefficients by variable, and the limits of their sum."""


def _least(cost: dict[int, float], rows: Sequence[BracketRow], size: int, whole: int) -> tuple[Array, float]:
    """Return variables from 0 to 1, the first of them whole numbers, with the least cost, and that cost."""
    from scipy.optimize import LinearConstraint, milp  # slow to import
    from scipy.sparse import csr_array

    entries = [(r, c, value) for r, (row, _, _) in enumerate(rows) for c, value in row.items()]
    at_row, at_column, values = zip(*entries, strict=True)
    _, lower, upper = zip(*rows, strict=True)
    solution = milp(
        [cost.get(c, 0.0) for c in range(size)],
        constraints=LinearConstraint(csr_array((values, (at_row, at_column)), (len(rows), size)), lower, upper),
        integrality=np.arange(size) < whole,
        bounds=(0, 1),
        options={"mip_rel_gap": 0.0, "presolve": False},  # SciPy 1.17's presolve may never end on efforts
    )
    if not solution.success:
        raise RuntimeError(f"the integer program of the drawer failed: {solution.message}")
    return solution.x, solution.fun


def _pairs(needs: NDArray[np.bool_], tasks: Sequence[range], most: int) -> Iterator[tuple[int, int]]:
    """Yield pairs of designs of adjacent tasks that fit `most` brackets with some design of each other task."""
    for t, (one, other) in enumerate(pairwise(tasks)):
        for d in one:
            both = needs[d] | needs[other]
            served = both.sum(axis=1) <= most
            for of in (*tasks[:t], *tasks[t + 2 :]):
                more = ~both @ needs[of].T.astype(int)
                served &= both.sum(axis=1) + more.min(axis=1) <= most
            yield from ((d, other[e]) for e in np.flatnonzero(served).tolist())


def _without_copies(designs: Sequence[Design]) -> list[int]:
    """Return the indices of the designs with the least effort of all whose modules are bolted alike."""
    kept: dict[frozenset[tuple[float, int]], list[int]] = {}
    for d in sorted(range(len(designs)), key=lambda d: designs[d].objective):
        alike = kept.setdefault(frozenset(count_kinds(designs[d]).items()), [])
        n = designs[d].topology.n
        if not any(len(shared_part(designs[d], designs[e])) == n == designs[e].topology.n for e in alike):
            alike.append(d)
    return sorted(d for alike in kept.values() for d in alike)


def count_kinds(design: Design) -> Counter[float]:
    """Return the number of brackets of each kind, by the size of the angle [deg]."""
    return Counter(map(abs, bracket_turns(design)))


def shared_part(one: Design, other: Design) -> dict[int, int]:
    """Return the largest part in one piece that two designs share: numbers of its modules in one, and in the other.

    It is found exactly: two joints that agree, a module at each, fix all the rest.
    """
    mine, theirs = _ports(one), _ports(other)
    sides = [[(i, a, phi) for i, joints in of.items() for a, (*_, phi) in joints.items()] for of in (mine, theirs)]
    largest = {0: 0}
    seen = set[tuple[int, int, int]]()
    for (start, a, angle), (match, b, angle_there) in product(*sides):
        turn = (b - a) % 4
        if angle != angle_there or turn % 2 or (start, match, turn) in seen:
            continue
        part, grown = {start: (match, turn)}, [start]
        for i in grown:
            j, turn = part[i]
            for port, (child, child_port, phi) in mine[i].items():
                there = theirs[j].get((port + turn) % 4)
                if child not in part and there and there[2] == phi and (there[1] - child_port) % 2 == 0:
                    part[child] = there[0], (there[1] - child_port) % 4
                    grown.append(child)
        seen.update((i, *at) for i, at in part.items())
        if len(part) > len(largest):
            largest = {i: j for i, (j, _) in part.items()}
    return largest


def _ports(design: Design) -> dict[int, dict[int, tuple[int, int, float]]]:
    """Return for every module's port with a joint the module there, its port, and phi, the same at both ends."""
    ports: dict[int, dict[int, tuple[int, int, float]]] = {i: {} for i in range(design.topology.n)}
    for (h, i, a, b), phi in zip(design.topology.edges(), bracket_turns(design), strict=True):
        ports[h][a], ports[i][b] = (i, b, phi), (h, a, phi)
    return ports


def growing_steps(design: Design, piece: Iterable[int]) -> tuple[Step, ...]:
    """Return the joints by which a platform grows from a piece of it, module by module."""
    ports, grown = _ports(design), list(piece)
    steps, known = list[Step](), set(grown)
    for i in grown:
        for port, (j, port_of_j, phi) in ports[i].items():
            if j not in known:
                known.add(j)
                grown.append(j)
                steps.append(Step(module=j, port=port_of_j, to=i, to_port=port, bracket_deg=abs(phi)))
    return tuple(steps)


def _excess(design: Design, choices: Sequence[Design]) -> float:
    least = min(each.objective for each in choices)
    return design.objective / least - 1 if least else 0.0


def _read_choices(run: Path, within: float) -> list[Design]:
    """Return the designs of a run with a clear audit, of its best size and so much effort at most, by effort."""
    with RunFolder.load(run) as folder:
        answer = answer_of(folder)
        if not answer.complete:
            rule = "must be a finished run, but something is left to do; continue it with the same command"
            raise BadInput(str(run), rule)
        best = answer.best
        if best is None or best.objective is None:
            raise NoCommonKit(f"no common kit: {run} has no design with a clear audit")
        level = folder.levels[answer.level]
        most = (1 + within / 100) * best.objective
        designs = [
            design
            for row in level.ledger.ranking(best.modules)
            if row.objective is not None and row.objective <= most
            for design in clear_designs(level, row)
            if design.objective <= most
        ]
        return sorted(designs, key=lambda design: (design.objective, design.topology.key))


def _require_same_module(runs: Sequence[Path], choices: Sequence[Sequence[Design]]) -> None:
    """Refuse tasks whose modules are not the same, whatever their airflow: that is up to the task."""
    first, *others = (designs[0].task.module.model_dump(mode="json", exclude={"airflow"}) for designs in choices)
    for run, other in zip(runs[1:], others, strict=True):
        if faults := [
            Fault(f"module.{name}", f"must be that of {runs[0]}, as one drawer holds modules of one kind")
            for name in sorted({*first, *other})
            if first.get(name) != other.get(name)
        ]:
            raise BadInput(str(run), faults)


def _describe(
    runs: Sequence[Path], choices: Sequence[Sequence[Design]], chosen: Sequence[Design], within: float
) -> SharedKit:
    """Return what `kit.json` says of the designs that are chosen."""
    drawer = Counter[float]()
    for design in chosen:
        drawer |= count_kinds(design)
    changes = []
    for one, other in pairwise(chosen):
        part = shared_part(one, other)
        changes.append(
            Change(
                before=one.task.name,
                after=other.task.name,
                undo=one.topology.n - len(part),
                bolt=other.topology.n - len(part),
                undo_steps=growing_steps(one, part)[::-1],
                bolt_steps=growing_steps(other, part.values()),
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
    """Return the page of a drawer: what is in it, the design of each task, and every change."""
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
    """Yield the two platforms with the joints that stay in one colour, and the steps in order."""
    yield f"<h2>From {escape(change.before)} to {escape(change.after)}</h2>"
    stays = zip((before, after), zip(*change.stay, strict=True), strict=True)
    yield _side_by_side((escape(design.task.name), tree_svg(design, marked=stay)) for design, stay in stays)
    yield paragraph(
        "Joints that stay are green. Every module comes off the end of a piece, and is added to one piece."
    )
    yield from (paragraph(text) for text in change.instructions)
    yield paragraph(
        f"Then rod and end-effector go where the last step of the assembly sheet of {escape(change.after)} says, "
        "and the autopilot gets the allocation of that kit."
    )


def _side_by_side(drawings: Iterable[tuple[str, str]]) -> str:
    figures = (f"<figure><figcaption>{caption}</figcaption>{svg}</figure>" for caption, svg in drawings)
    return f"<section>{''.join(figures)}</section>"
