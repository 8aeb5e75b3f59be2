"""The share of uniformly drawn topologies that a few starts solve, and what stops the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from attempts import Stated, attempts, cost
from children import Child
from options import AIRFLOW_ALONE, Options, at
from rows import Row, Rows

from topo_search.topologies import sample

PART, SIZES = "share", (10, 20, 40)
EXAMPLES = ("ten-wrenches", "ten-wrenches-local", "ten-wrenches-directional", "ten-wrenches-exterior-60")
DISTANCE, DISTANCES = 0.22, (0.15, 0.18, 0.22, 0.26, 0.30)
"""Connector distance of the examples, and those of the curve [m]."""
PROBLEMS = {
    "airflow only": (AIRFLOW_ALONE,),
    "with body clearance": (),
    "merging airflow": ("search.interference=parts",),
}


def measure(rows: Rows, options: Options) -> None:
    """Measure every example as it is, and the first one against the connector distance."""
    examples = options.examples or EXAMPLES
    plan = [(example, DISTANCE) for example in examples]
    plan += [(examples[0], distance) for distance in options.distances or DISTANCES if distance != DISTANCE]
    for n in options.sizes:
        for topology in sample(n, options.topologies, 0):
            for problem, settings in PROBLEMS.items():
                todo: dict[Stated, Row] = {}
                for example, distance in plan:
                    identity = {"part": PART, "n": n, "key": topology.key, "problem": problem}
                    identity |= {"example": example, "distance": distance}
                    if not rows.where(**identity):
                        todo[Stated(example, n, (*settings, at(distance)))] = identity
                while todo:  # in one process: loading all code takes longer than most solves
                    cap = options.cap * len(todo)
                    with Child(_first_designs, list(todo), topology.key, options.starts, cap=cap) as child:
                        for row in child:
                            rows.add({**todo.pop(next(iter(todo))), **row})
                    if child.capped:
                        rows.add({**todo.pop(next(iter(todo))), "solved": False, "capped": True})


def _first_designs(tasks: list[Stated], key: str, most: int) -> Iterator[Row]:
    """Yield an empty row, then one a task: what the first starts of a topology lead to, up to a design."""
    yield {}
    for stated in tasks:
        solves = attempts("ours", "ours", stated, [key], range(most))
        next(solves)
        row: Row = {"solved": False, "seconds": 0.0, "starts": 0, "missed": Counter[str](), "capped": False}
        while not row["solved"] and (answer := next(solves, None)) is not None:
            row["seconds"] += cost(answer)
            row["starts"] += 1
            row["solved"] = answer["J"] is not None
            if not row["solved"]:
                row["missed"][kind_of(answer["missed"])] += 1
        yield row


def kind_of(constraint: str) -> str:
    """Return what a constraint is about: `wrench`, or the kind of clearance."""
    return "wrench" if constraint.startswith("load case") else constraint.split(",")[0].split(" ")[0]


def table(rows: Rows) -> str:
    """Return the shares: the examples at their distance, then the curve."""
    measured = rows.where(part=PART)
    sizes = sorted({row["n"] for row in measured})
    kinds = sorted({(row["problem"], row["example"], row["distance"]) for row in measured})
    lines = [
        f"| problem | example | distance, m | {' | '.join(f'n = {n}' for n in sizes)} |",
        "|---|---|---|" + "---|" * len(sizes),
    ]
    for problem, example, distance in kinds:
        which = {"problem": problem, "example": example, "distance": distance}
        cells = [_share(rows.where(part=PART, n=n, **which)) for n in sizes]
        lines.append(f"| {problem} | {example} | {distance:.2f} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _share(measured: list[Row]) -> str:
    solved = sum(row["solved"] for row in measured)
    missed = Counter(
        max(row["missed"], key=row["missed"].get) for row in measured if not row["solved"] and row.get("missed")
    )
    reasons = ", ".join(f"{kind} {count}" for kind, count in missed.most_common())
    return f"{solved} of {len(measured)}" + (f" ({reasons})" if reasons else "")
