"""Growth of time and memory with the number of modules, and the distribution of time."""

from __future__ import annotations

import statistics

import numpy as np
from attempts import METHODS, TaskChoice, attempts
from children import Child
from options import AIRFLOW_ALONE, Options, at
from rows import Row, Rows

from topo_search.topologies import sample

PART, SIZES, EXAMPLE = "growth", (3, 5, 7, 10, 20, 40, 60, 100), "ten-wrenches"
DISTANCE = 0.30
"""Connector distance [m] at which a hundred modules can be placed."""
FITTED_FROM = 10
"""Smallest number of modules in the fit; below it constant costs dominate."""
SHARES = {"start": "draw", "build": "build", "evaluation": "evaluation", "linear algebra": "linear_algebra"}
"""Columns with times by name; the rest is checking points and managing rounds."""


def measure(rows: Rows, options: Options) -> None:
    """Measure one start of each topology and method, each in a new process; both get the solver's start."""
    for n in options.sizes:
        for topology in sample(n, options.topologies, 0):
            for method in METHODS:
                identity = {"part": PART, "n": n, "key": topology.key, "method": method}
                if rows.where(**identity) or (method == "direct" and n > options.direct_up_to):
                    continue
                choice = TaskChoice(EXAMPLE, n, (AIRFLOW_ALONE, at(DISTANCE)))
                with Child(attempts, method, "ours", choice, [topology.key], [0], cap=options.cap) as child:
                    answer = next(child, None)
                if answer is not None:
                    answer["seconds"] = answer["draw"] + answer["build"] + answer["solve"]
                    answer["linear_algebra"] = answer["ipopt"] - answer["evaluation"]
                rows.add({**identity, "answer": answer})


def table(rows: Rows) -> str:
    """Return medians by size and method, and the fitted exponents."""
    lines = [
        f"| n | method | CPU s | {' | '.join(f'{name}' for name in SHARES)} | the rest | iterations | peak MB |",
        "|---|---|---|" + "---|" * (len(SHARES) + 3),
    ]
    fits = []
    for method in METHODS:
        curve: list[tuple[int, float, float]] = []
        for n in sorted({row["n"] for row in rows.where(part=PART, method=method)}):
            answers = [row["answer"] for row in rows.where(part=PART, method=method, n=n) if row["answer"]]
            if not answers:
                lines.append(f"| {n} | {method} | stopped by the cap |" + " |" * (len(SHARES) + 3))
                continue
            seconds = _median(answers, "seconds")
            curve.append((n, seconds, _median(answers, "peak_mb")))
            shares = [statistics.median(row[name] / row["seconds"] for row in answers) for name in SHARES.values()]
            cells = [f"{share:.0%}" for share in (*shares, max(0.0, 1 - sum(shares)))]
            cells += [f"{_median(answers, name):.0f}" for name in ("iterations", "peak_mb")]
            lines.append(f"| {n} | {method} | {seconds:.3f} | {' | '.join(cells)} |")
        fitted = np.array([point for point in curve if point[0] >= FITTED_FROM])
        if len(fitted) > 1:
            logs = np.log(fitted)
            time, memory = (np.polyfit(logs[:, 0], logs[:, column], 1)[0] for column in (1, 2))
            fits.append(
                f"{method}, from {FITTED_FROM} modules: time grows as n^{time:.2f}, peak memory as n^{memory:.2f}."
            )
    return "\n".join(lines) + "\n\n" + "\n".join(fits)


def _median(answers: list[Row], name: str) -> float:
    return statistics.median(answer[name] for answer in answers)
