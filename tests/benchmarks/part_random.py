"""Each method from its own starts, until the first design: what a user waits for."""

from __future__ import annotations

import statistics

from attempts import METHODS, Stated, attempts, cost
from children import Child
from options import AIRFLOW_ALONE, Options
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
                stated = Stated(EXAMPLE, n, (AIRFLOW_ALONE,))
                with Child(
                    attempts, method, method, stated, [topology.key], range(10**6), cap=options.cap
                ) as child:
                    while not solved and (answer := next(child, None)) is not None:
                        spent, starts, solved = spent + cost(answer), starts + 1, answer["J"] is not None
                    spent = spent if solved else options.cap
                rows.add({**identity, "seconds": spent, "starts": starts, "solved": solved})


def table(rows: Rows) -> str:
    """Return medians by size; a direct formulation that meets the cap makes a ratio a lower bound."""
    lines = [
        "| n | topologies | solved, ours / direct | median CPU s | median starts | times slower, median |",
        "|---|---|---|---|---|---|",
    ]
    for n in sorted({row["n"] for row in rows.where(part=PART)}):
        ours, direct = (
            {row["key"]: row for row in rows.where(part=PART, n=n, method=method)} for method in METHODS
        )
        pairs = [(ours[key], direct[key]) for key in ours.keys() & direct.keys()]
        cells = [" / ".join(str(sum(row["solved"] for row in of)) for of in zip(*pairs, strict=True))]
        for name, form in (("seconds", ".2f"), ("starts", ".0f")):
            medians = (statistics.median(row[name] for row in of) for of in zip(*pairs, strict=True))
            cells.append(" / ".join(format(median, form) for median in medians))
        lines.append(f"| {n} | {len(pairs)} | {' | '.join(cells)} | {_middle(pairs)} |")
    return "\n".join(lines)


def _middle(pairs: list[tuple[Row, Row]]) -> str:
    ratios = [
        (theirs["seconds"] / our["seconds"], theirs["solved"])
        for our, theirs in pairs
        if our["solved"] or theirs["solved"]
    ]
    if not ratios:
        return "none solved"
    middle = statistics.median_low([ratio for ratio, _ in ratios])
    bound = any(not solved for ratio, solved in ratios if ratio <= middle)
    return f"{'>= ' if bound else ''}{middle:.1f}"
