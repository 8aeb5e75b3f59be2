"""Each method from its own starts, until the first design: what a user waits for."""

from __future__ import annotations

import statistics

from attempts import METHODS, Stated, attempts, cost
from children import Child
from options import PAPER, Options
from rows import Row, Rows

from topo_search.topologies import sample

PART, SIZES, EXAMPLE = "random", (10, 20, 40), "ten-wrenches"


def measure(rows: Rows, options: Options) -> None:
    """Measure each topology with both methods, each in a new process until it has a design or meets the cap."""
    for n in options.sizes:
        for topology in sample(n, options.topologies, 0):
            for method in METHODS:
                identity = {"part": PART, "n": n, "key": topology.key, "method": method, "cap": options.cap}
                if rows.where(**identity):
                    continue
                spent, starts, solved = 0.0, 0, False
                stated = Stated(EXAMPLE, n, (PAPER,))
                with Child(
                    attempts, method, method, stated, [topology.key], range(10**6), cap=options.cap
                ) as child:
                    while not solved and (answer := next(child, None)) is not None:
                        spent, starts, solved = spent + cost(answer), starts + 1, answer["J"] is not None
                    spent = spent if solved else options.cap
                rows.add({**identity, "seconds": spent, "starts": starts, "solved": solved})


def table(rows: Rows) -> str:
    """Return medians by size; a direct formulation without a design makes a ratio a lower bound."""
    lines = [
        "| n | topologies | solved, ours / direct | median CPU s | median starts | times slower, median |",
        "|---|---|---|---|---|---|",
    ]
    for n in sorted({row["n"] for row in rows.where(part=PART)}):
        by_method: dict[str, list[Row]] = {
            method: [*rows.where(part=PART, n=n, method=method)] for method in METHODS
        }
        pairs = [*zip(*by_method.values(), strict=False)]
        cells = [" / ".join(str(sum(row["solved"] for row in of)) for of in by_method.values())]
        for name, form in (("seconds", ".2f"), ("starts", ".0f")):
            cells.append(
                " / ".join(f"{statistics.median(row[name] for row in of):{form}}" for of in by_method.values())
            )
        ratios = sorted(
            (theirs["seconds"] / our["seconds"], theirs["solved"]) for our, theirs in pairs if our["solved"]
        )
        middle = statistics.median_low([ratio for ratio, _ in ratios]) if ratios else 0.0
        bound = any(not solved for ratio, solved in ratios if ratio <= middle)
        cells.append(f"{'>= ' if bound else ''}{middle:.0f}")
        lines.append(f"| {n} | {len(pairs)} | {' | '.join(cells)} |")
    return "\n".join(lines)
