"""The share of uniformly drawn topologies that a few starts solve, and why the others are not solved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from attempts import TaskChoice, attempts, cost
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
    """Measure every example at its connector distance, and the first one at several distances."""
    examples = options.examples or EXAMPLES
    plan = [(example, DISTANCE) for example in examples]
    plan += [(examples[0], distance) for distance in options.distances or DISTANCES if distance != DISTANCE]
    for n in options.sizes:
        for topology in sample(n, options.topologies, 0):
            for problem, settings in PROBLEMS.items():
                pending: dict[TaskChoice, Row] = {}
                for example, distance in plan:
                    identity = {"part": PART, "n": n, "key": topology.key, "problem": problem}
                    identity |= {"example": example, "distance": distance}
                    if not rows.where(**identity):
                        pending[TaskChoice(example, n, (*settings, at(distance)))] = identity
                while pending:  # in one process: loading all code takes longer than most solves
                    cap = options.cap * len(pending)
                    with Child(_first_designs, list(pending), topology.key, options.starts, cap=cap) as child:
                        for row in child:
                            rows.add({**pending.pop(next(iter(pending))), **row})
                    if child.capped:
                        rows.add({**pending.pop(next(iter(pending))), "solved": False, "capped": True})


def _first_designs(tasks: list[TaskChoice], key: str, starts: int) -> Iterator[Row]:
    """Yield an empty row, then one row per task: the results of the starts of a topology up to a design."""
    yield {}
    for choice in tasks:
        solves = attempts("ours", "ours", choice, [key], range(starts))
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
    """Return the kind of a constraint: `wrench`, or the kind of clearance."""
    return "wrench" if constraint.startswith("load case") else constraint.split(",")[0].split(" ")[0]


def table(rows: Rows) -> str:
    """Return the shares by problem, example and distance."""
    measured = rows.where(part=PART)
    sizes = sorted({row["n"] for row in measured})
    kinds = sorted({(row["problem"], row["example"], row["distance"]) for row in measured})
    lines = [
        f"| problem | example | distance, m | {' | '.join(f'n = {n}' for n in sizes)} |",
        "|---|---|---|" + "---|" * len(sizes),
    ]
    for problem, example, distance in kinds:
        selection = {"problem": problem, "example": example, "distance": distance}
        cells = [_share(rows.where(part=PART, n=n, **selection)) for n in sizes]
        lines.append(f"| {problem} | {example} | {distance:.2f} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _share(measured: list[Row]) -> str:
    solved = sum(row["solved"] for row in measured)
    missed = Counter(
        max(row["missed"], key=row["missed"].get) for row in measured if not row["solved"] and row.get("missed")
    )
    reasons = ", ".join(f"{kind} {count}" for kind, count in missed.most_common())
    return f"{solved} of {len(measured)}" + (f" ({reasons})" if reasons else "")
