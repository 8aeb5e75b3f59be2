"""All trees of a small size: time until nearly every feasible tree reaches its best known effort."""

from __future__ import annotations

import math

from attempts import METHODS, TaskChoice, attempts, cost
from children import Child
from options import Options
from rows import Row, Rows

from topo_search.topologies import candidates

PART, SIZES, EXAMPLE = "five", (5,), "push"
WITHIN = 1e-3
"""A tree is done within this relative distance of its best known effort."""
SHARE = 0.95
"""Share of the feasible trees that has to be done."""


def measure(rows: Rows, options: Options) -> None:
    """Run both methods over all trees, start by start, until each has used its CPU time.

    The method that has used less time goes next. The long runs also determine the best known efforts.
    """
    for n in options.sizes:
        identity = {"part": PART, "n": n, "budget": options.seconds}
        if rows.where(**identity):
            continue
        trees = candidates(n, symmetry="c2", connectors="aligned", root="free")
        keys, choice = [candidate.topology.key for candidate in trees], TaskChoice(EXAMPLE, n)
        history: dict[str, list[tuple[str, float, float | None]]] = {method: [] for method in METHODS}
        cpu_s, peak = dict.fromkeys(METHODS, 0.0), dict.fromkeys(METHODS, 0.0)
        with (
            Child(attempts, "ours", "ours", choice, keys, range(10**6)) as ours,
            Child(attempts, "direct", "direct", choice, keys, range(10**6)) as direct,
        ):
            children = {"ours": ours, "direct": direct}
            while min(cpu_s.values()) < options.seconds:
                method = min(METHODS, key=lambda method: cpu_s[method])
                row = next(children[method])
                cpu_s[method] += cost(row)
                peak[method] = row["peak_mb"]
                history[method].append((row["key"], round(cpu_s[method], 4), row["J"]))
        for method in METHODS:
            rows.add({**identity, "method": method, "peak_mb": peak[method], "history": history[method]})


def table(rows: Rows) -> str:
    """Return one line per size and method."""
    lines = [
        "| n | trees, feasible | method | solves | feasible solves | peak MB | CPU s to 95 % | times slower |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for n in sorted({row["n"] for row in rows.where(part=PART)}):
        measured = rows.where(part=PART, n=n)
        best = best_known(measured)
        times = [time_to_best(row["history"], best) for row in measured]
        ours = next(seconds for row, (seconds, _) in zip(measured, times, strict=True) if row["method"] == "ours")
        for row, (seconds, reached) in zip(measured, times, strict=True):
            efforts = [J for _, _, J in row["history"]]
            feasible = sum(J is not None for J in efforts) / len(efforts)
            trees = len({key for key, _, _ in row["history"]})
            cells = [f"{trees}, {len(best)}", row["method"], f"{len(efforts)}", f"{feasible:.1%}"]
            cells += [f"{row['peak_mb']:.0f}", f"{'' if reached else '> '}{seconds:.1f}"]
            lines.append(f"| {n} | {' | '.join(cells)} | {'' if reached else '> '}{seconds / ours:.1f} |")
    return "\n".join(lines)


def best_known(rows: list[Row]) -> dict[str, float]:
    """Return the least effort of every tree with a design, by either method."""
    best: dict[str, float] = {}
    for row in rows:
        for key, _, J in row["history"]:
            if J is not None:
                best[key] = min(J, best.get(key, math.inf))
    return best


def time_to_best(history: list[tuple[str, float, float | None]], best: dict[str, float]) -> tuple[float, bool]:
    """Return the CPU time until enough trees were done [s] and True; otherwise the whole time and False."""
    finished: set[str] = set()
    for key, seconds, J in history:
        if J is not None and J - best[key] <= WITHIN * best[key]:
            finished.add(key)
            if len(finished) >= SHARE * len(best):
                return seconds, True
    return history[-1][1], False
