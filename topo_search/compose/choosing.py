"""The choice of a design for each of several tasks, so that few brackets serve all: three integer programs.

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

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import numpy as np

from topo_search.export.brackets import bracket_turns
from topo_search.model import Array, Design, Flags
from topo_search.topologies.task_symmetry import HALF_TURN, has_symmetry


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
    shares = [excess(designs[d], designs[task.start : task.stop]) for task in tasks for d in task]
    effort = {d: 1e6 * share for d, share in enumerate(shares)}  # HiGHS stops within 1e-6 of the optimum
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


def _pairs(needs: Flags, tasks: Sequence[range], fewest: int) -> Iterator[tuple[int, int]]:
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
    ports = ports_of(first), ports_of(second)
    sides = [[(i, a, phi) for i, joints in side.items() for a, (*_, phi) in joints.items()] for side in ports]
    largest = {0: 0}
    symmetric = all(has_symmetry(kind, HALF_TURN) for kind in first.task.types)
    same = 2 if symmetric else 4  # quarter turns that leave a module as it is
    seen = set[tuple[int, int, int]]()
    for (start, a, angle), (match, b, match_angle) in product(*sides):
        turn = (b - a) % 4
        if angle != match_angle or turn % same or (start, match, turn) in seen:
            continue
        part, grown = {start: (match, turn)}, [start]
        for i in grown:
            j, turn = part[i]
            for port, (child, child_port, phi) in ports[0][i].items():
                joint = ports[1][j].get((port + turn) % 4)
                if child not in part and joint and joint[2] == phi and (joint[1] - child_port) % same == 0:
                    part[child] = joint[0], (joint[1] - child_port) % 4
                    grown.append(child)
        seen.update((i, *matched) for i, matched in part.items())
        if len(part) > len(largest):
            largest = {i: j for i, (j, _) in part.items()}
    return largest


def ports_of(design: Design) -> dict[int, dict[int, tuple[int, int, float]]]:
    """Return for each module and port with a joint the module and port at its other end, and phi."""
    ports: dict[int, dict[int, tuple[int, int, float]]] = {i: {} for i in range(design.topology.n)}
    for (h, i, a, b), phi in zip(design.topology.edges(), bracket_turns(design), strict=True):
        ports[h][a], ports[i][b] = (i, b, phi), (h, a, phi)
    return ports


def excess(design: Design, choices: Sequence[Design]) -> float:
    """Return a design's effort over the least effort of its task, as a share."""
    least = min(choice.objective for choice in choices)
    return design.objective / least - 1 if least else 0.0
