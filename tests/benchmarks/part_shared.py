"""Time to build and solve with both methods from one start that leads both to a design."""

from __future__ import annotations

import statistics

from attempts import METHODS, TaskChoice, attempts, cost
from children import Child
from options import AIRFLOW_ALONE, Options
from rows import Row, Rows

from topo_search.topologies import sample

PART, SIZES, EXAMPLE = "shared", (10, 20, 40), "ten-wrenches"


def measure(rows: Rows, options: Options) -> None:
    """Try the starts of each topology until one leads both methods to a design; every solve in a new process."""
    for n in options.sizes:
        for topology in sample(n, options.topologies, 0):
            identity = {"part": PART, "n": n, "key": topology.key}
            if rows.where(**identity):
                continue
            answers: dict[str, Row] | None = None
            index = 0
            while answers is None and index < options.starts:
                answers = _solve_with_both(
                    TaskChoice(EXAMPLE, n, (AIRFLOW_ALONE,)), topology.key, index, options.cap
                )
                index += 1
            rows.add({**identity, "tried": index, **(answers or {})})


def _solve_with_both(choice: TaskChoice, key: str, index: int, cap: int) -> dict[str, Row] | None:
    answers: dict[str, Row] = {}
    for method in METHODS:
        with Child(attempts, method, "ours", choice, [key], [index], cap=cap) as child:
            answer = next(child, None)
        if answer is None or answer["J"] is None:
            return None
        answers[method] = answer
    return answers


def table(rows: Rows) -> str:
    """Return medians by size."""
    lines = [
        "| n | topologies | build s, ours / direct | solve s | peak MB | iterations | times slower | J, times |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for n in sorted({row["n"] for row in rows.where(part=PART)}):
        measured = rows.where(part=PART, n=n)
        both = [row for row in measured if "direct" in row]
        if not both:
            lines.append(f"| {n} | 0 of {len(measured)} | | | | | | |")
            continue
        cells = []
        for name, form in (("build", ".3f"), ("solve", ".3f"), ("peak_mb", ".0f"), ("iterations", ".0f")):
            medians = (statistics.median(row[method][name] for row in both) for method in METHODS)
            cells.append(" / ".join(format(value, form) for value in medians))
        # both get the same start: the time of drawing it does not count
        times = [
            (cost(row["direct"]) - row["direct"]["draw"]) / (cost(row["ours"]) - row["ours"]["draw"])
            for row in both
        ]
        ratios = f"{statistics.median(times):.1f} ({min(times):.1f} to {max(times):.1f})"
        efforts = statistics.median(row["direct"]["J"] / row["ours"]["J"] for row in both)
        lines.append(f"| {n} | {len(both)} of {len(measured)} | {' | '.join(cells)} | {ratios} | {efforts:.4f} |")
    return "\n".join(lines)
