"""The share of uniformly drawn topologies that a few starts solve, and what stops the others."""

from __future__ import annotations

from collections import Counter

from attempts import Stated, attempts, cost
from children import Child
from options import PAPER, Options, at
from rows import Row, Rows

from topo_search.topologies import sample

PART, SIZES = "share", (10, 20, 40)
EXAMPLES = ("ten-wrenches", "ten-wrenches-local", "ten-wrenches-directional", "ten-wrenches-exterior-60")
DISTANCE, DISTANCES = 0.22, (0.15, 0.18, 0.22, 0.26, 0.30)
"""Connector distance of the examples, and those of the curve [m]."""
PROBLEMS = {"airflow only": (PAPER,), "with body clearance": ()}


def measure(rows: Rows, options: Options) -> None:
    """Measure every example as it is, and the first one against the connector distance."""
    examples = options.examples or EXAMPLES
    plan = [(example, DISTANCE) for example in examples]
    plan += [(examples[0], distance) for distance in options.distances or DISTANCES if distance != DISTANCE]
    for n in options.sizes:
        for topology in sample(n, options.topologies, 0):
            for problem, settings in PROBLEMS.items():
                for example, distance in plan:
                    identity = {"part": PART, "n": n, "key": topology.key, "problem": problem}
                    identity |= {"example": example, "distance": distance}
                    if not rows.where(**identity):
                        stated = Stated(example, n, (*settings, at(distance)))
                        rows.add({**identity, **_first_design(stated, topology.key, options)})


def _first_design(stated: Stated, key: str, options: Options) -> Row:
    spent, starts, missed, solved = 0.0, 0, Counter[str](), False
    with Child(attempts, "ours", "ours", stated, [key], range(options.starts), cap=options.cap) as child:
        while not solved and (answer := next(child, None)) is not None:
            spent, starts, solved = spent + cost(answer), starts + 1, answer["J"] is not None
            if not solved:
                missed[kind_of(answer["missed"])] += 1
    return {"solved": solved, "seconds": spent, "starts": starts, "missed": missed, "capped": child.capped}


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
        max(row["missed"], key=row["missed"].get) for row in measured if not row["solved"] and row["missed"]
    )
    reasons = ", ".join(f"{kind} {count}" for kind, count in missed.most_common())
    return f"{solved} of {len(measured)}" + (f" ({reasons})" if reasons else "")
