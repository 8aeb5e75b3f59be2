"""All trees of a small size: how soon nearly every feasible tree stands at its best known effort."""

from __future__ import annotations

import math

from attempts import Stated, attempts
from children import Child
from rows import Row, Rows

from topo_search.topologies import candidates

PART = "five"
METHODS = ("ours", "direct")
WITHIN = 1e-3
"""A tree is done within this relative distance of its best known effort."""
SHARE = 0.95
"""Share of the feasible trees that must be done."""


def measure(rows: Rows, *, example: str, n: int, seconds: float) -> None:
    """Let both methods go round all trees, start after start, until each has spent its CPU seconds.

    The one that has spent less goes next. What a method does after it is done is the long run that tells the best
    known efforts.
    """
    if rows.where(part=PART, example=example, n=n, seconds=seconds):
        return
    trees = candidates(n, symmetry="c2", connectors="aligned", root="free")
    keys = [candidate.topology.key for candidate in trees]
    spent = dict.fromkeys(METHODS, 0.0)
    peak = dict.fromkeys(METHODS, 0.0)
    history: dict[str, list[tuple[str, float, float | None]]] = {method: [] for method in METHODS}
    stated = Stated(example, n)
    with (
        Child(attempts, "ours", "ours", stated, keys, range(10**6)) as ours,
        Child(attempts, "direct", "direct", stated, keys, range(10**6)) as direct,
    ):
        children = {"ours": ours, "direct": direct}
        while min(spent.values()) < seconds:
            method = min(METHODS, key=lambda method: spent[method])
            row = next(children[method])
            spent[method] += cost(row)
            peak[method] = row["peak_mb"]
            history[method].append((row["key"], round(spent[method], 4), row["J"]))
    for method in METHODS:
        identity = {"part": PART, "example": example, "n": n, "seconds": seconds, "method": method}
        rows.add({**identity, "trees": len(keys), "peak_mb": peak[method], "history": history[method]})


def cost(row: Row) -> float:
    """Return the CPU seconds of an attempt."""
    return float(row["build"] + row["draw"] + row["solve"])


def table(rows: Rows) -> str:
    """Return the table of all measured examples."""
    lines = [
        "| example | trees, feasible | method | solves | feasible solves | CPU s to 95 % | ratio |",
        "|---|---|---|---|---|---|---|",
    ]
    groups: dict[tuple[str, int], dict[str, Row]] = {}
    for row in rows.where(part=PART):
        groups.setdefault((row["example"], row["n"]), {})[row["method"]] = row
    for (example, n), methods in groups.items():
        best = best_known(rows.where(part=PART, example=example, n=n))
        times = {method: time_to_best(row["history"], best) for method, row in methods.items()}
        for method, row in methods.items():
            efforts = [J for _, _, J in row["history"]]
            found = sum(J is not None for J in efforts) / len(efforts)
            seconds, reached = times[method]
            ratio = ""
            if method == "direct":
                ratio = f"{'' if reached else '>= '}{seconds / times['ours'][0]:.1f}"
            lines.append(
                f"| {example}, n = {n} | {row['trees']}, {len(best)} | {method} | {len(efforts)} | {found:.1%} "
                f"| {'' if reached else '> '}{seconds:.1f} | {ratio} |"
            )
    return "\n".join(lines)


def best_known(rows: list[Row]) -> dict[str, float]:
    """Return the least effort of every tree with a design, whoever found it."""
    best: dict[str, float] = {}
    for row in rows:
        for key, _, J in row["history"]:
            if J is not None:
                best[key] = min(J, best.get(key, math.inf))
    return best


def time_to_best(history: list[tuple[str, float, float | None]], best: dict[str, float]) -> tuple[float, bool]:
    """Return when enough trees were done [CPU s], or the whole time and False if they never were."""
    done: set[str] = set()
    for key, seconds, J in history:
        if J is not None and J - best[key] <= WITHIN * best[key]:
            done.add(key)
            if len(done) >= SHARE * len(best):
                return seconds, True
    return history[-1][1], False
