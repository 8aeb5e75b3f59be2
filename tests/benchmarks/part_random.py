"""Time to the first design of each method from its own starts, for which a user waits."""

from __future__ import annotations

import statistics

from attempts import METHODS, TaskChoice, attempts, cost
from children import Child
from options import AIRFLOW_ALONE, Options
from rows import Row, Rows

from topo_search.topologies import sample

PART, SIZES, EXAMPLE = "random", (10, 20, 40), "ten-wrenches"


def measure(rows: Rows, options: Options) -> None:
    """Measure each topology with both methods, each in a new process, until a design is found or the cap is met."""
    for n in options.sizes:
        for topology in sample(n, options.topologies, 0):
            for method in METHODS:
                identity = {"part": PART, "n": n, "key": topology.key, "method": method, "cap": options.cap}
                if rows.where(**identity):
                    continue
                seconds, starts, solved = 0.0, 0, False
                choice = TaskChoice(EXAMPLE, n, (AIRFLOW_ALONE,))
                with Child(
                    attempts, method, method, choice, [topology.key], range(10**6), cap=options.cap
                ) as child:
                    while not solved and (answer := next(child, None)) is not None:
                        seconds, starts, solved = seconds + cost(answer), starts + 1, answer["J"] is not None
                    seconds = seconds if solved else options.cap
                rows.add({**identity, "seconds": seconds, "starts": starts, "solved": solved})


def table(rows: Rows) -> str:
    """Return medians by size; if the direct formulation meets the cap, the ratio is a lower bound."""
    lines = [
        "| n | topologies | solved, ours / direct | median CPU s | median starts | times slower, median |",
        "|---|---|---|---|---|---|",
    ]
    for n in sorted({row["n"] for row in rows.where(part=PART)}):
        ours, direct = (
            {row["key"]: row for row in rows.where(part=PART, n=n, method=method)} for method in METHODS
        )
        pairs = [(ours[key], direct[key]) for key in ours.keys() & direct.keys()]
        cells = [" / ".join(str(sum(row["solved"] for row in side)) for side in zip(*pairs, strict=True))]
        for name, form in (("seconds", ".2f"), ("starts", ".0f")):
            medians = (statistics.median(row[name] for row in side) for side in zip(*pairs, strict=True))
            cells.append(" / ".join(format(median, form) for median in medians))
        lines.append(f"| {n} | {len(pairs)} | {' | '.join(cells)} | {_median_ratio(pairs)} |")
    return "\n".join(lines)


def _median_ratio(pairs: list[tuple[Row, Row]]) -> str:
    ratios = [
        (direct["seconds"] / ours["seconds"], direct["solved"])
        for ours, direct in pairs
        if ours["solved"] or direct["solved"]
    ]
    if not ratios:
        return "none solved"
    median = statistics.median_low([ratio for ratio, _ in ratios])
    bound = any(not solved for ratio, solved in ratios if ratio <= median)
    return f"{'>= ' if bound else ''}{median:.1f}"
