"""A study: its plan, the measurement of its cells in worker processes, and the folder of their rows.

`about.json` has the conditions of the rows, `results.csv` a row per cell; what does not apply is empty.

| column | meaning |
|---|---|
| `variant`, `task` | name of the problem variant and of the shipped example |
| `distance_m` | connector distance [m] |
| `n`, `key`, `task_seed` | modules, topology, and seed of the ten wrenches |
| `status` | feasible, infeasible, impossible (proven) or failed |
| `method` | `topo-search`; rows of `tests/benchmarks/direct_scaling.py`: `direct` |
| `starts` | starts that were solved |
| `solve_s`, `audit_s` | CPU time of all starts, and of the audit [s] |
| `build_s` | CPU time of building the program before the first start, where `solve_s` does not include it [s] |
| `iterations` | Ipopt iterations; if all starts are solved at once, those of the best start |
| `peak_mb` | peak memory of the worker process so far [MB]; cells are solved by ascending size |
| `objective`, `lower_bound`, `gap` | J and its bound [rad^4/s^4], and the gap between them |
| `offset_m` | distance of the end-effector from the centre of mass [m] |
| `verdict` | verdict of the audit |
| `colliding_pairs`, `largest_cluster` | overlapping pairs of airflow envelopes; modules in their largest cluster |
| `deepest_percent`, `depths_percent` | deepest overlap, and all of them, as percentages of the deepest possible |
| `worst_constraint`, `violation`, `unit` | what the best start violates most; of a failed cell, the reason |
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import nlp
from topo_search.compose import BACKENDS, available_cores
from topo_search.engine import Backends, Failed, Job, Workers
from topo_search.engine.workers import audit_deadline, merge, record_of, solve_deadline
from topo_search.limits import LIMITS
from topo_search.model import Design, Infeasible, ResolvedTask, Status, Topology
from topo_search.model.files import load_json, load_text, write_atomically
from topo_search.model.task_file import read_task
from topo_search.model.value import as_bad_input, show
from topo_search.report.shown import visible_progress
from topo_search.study import Observer, Phase
from topo_search.study.directory import lock
from topo_search.study.folder import make_folder, refusal
from topo_search.study.ledger_file import KEPT
from topo_search.study.request import installed_versions
from topo_search.topologies import Family, candidates, count, sample
from topo_search.topologies.rooted import Rooted, key_of, reroot, rooted_of, text_of, turn
from verify import kinematics

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

AIRFLOW_ALONE = "search.body_clearance=false"
"""The paper's clearances: only airflow keeps modules apart."""
RESULTS, ABOUT = "results.csv", "about.json"
METHOD = "topo-search"
IDENTITY = ("variant", "task", "distance_m", "n", "key", "task_seed")
"""Columns that identify a cell."""
COLUMNS = (
    *(*IDENTITY, "status", "method", "starts", "solve_s", "build_s", "audit_s", "iterations", "peak_mb"),
    *("objective", "lower_bound", "gap", "offset_m", "verdict", "colliding_pairs", "largest_cluster"),
    *("deepest_percent", "depths_percent", "worst_constraint", "violation", "unit"),
)
Row = dict[str, Any]
"""A row of `results.csv` by column."""


@dataclass(frozen=True)
class Settings:
    """Conditions and random seed of a study."""

    few_above: ClassVar = 40
    """Number of modules above which the second number of `topologies` applies."""

    tasks: tuple[tuple[str, tuple[int, ...]], ...]
    """Shipped examples, each with its numbers of modules."""
    topologies: tuple[int, int]
    """Trees per size, up to `few_above` modules and above; all trees if there are fewer."""
    starts: int
    """Largest number of starts per topology."""
    distances: tuple[float, ...] = ()
    """Connector distances [m]; empty: the distance of each task."""
    seed: int = 0
    """Seed of topologies, wrenches and starts."""
    time_limit: float = 600.0
    """CPU time per cell after which no further start begins, if the first design ends a cell [s]."""

    def as_options(self) -> str:
        """Return the command-line options for these settings."""
        options = [f"--task {name}:{_join(sizes)}" for name, sizes in self.tasks]
        options += [f"--topologies {_join(self.topologies)}", f"--starts {self.starts}"]
        options += [f"--distances {_join(self.distances)}"] * bool(self.distances)
        return " ".join([*options, f"--seed {self.seed}", f"--time-limit {_join((self.time_limit,))}"])


def _join(values: tuple[float, ...]) -> str:
    return ",".join(str(value).removesuffix(".0") for value in values)  # all digits, unlike `:g`


@dataclass(frozen=True)
class Variant:
    """One of the problem variants that a study compares."""

    name: str
    overrides: tuple[str, ...] = ()
    """`FIELD=VALUE` changes to the task."""
    every_root: bool = False
    """True if a tree is tried with each of its modules as the root."""


@dataclass(frozen=True)
class Cell:
    """One topology under one condition: a row of the results. Small, to be sent to workers."""

    variant: Variant
    task: str
    distance_m: float
    n: int
    key: str
    task_seed: int | None
    """Seed of the ten wrenches; None for a task with fixed wrenches."""

    @property
    def row(self) -> Row:
        """The row of this cell before it is solved."""
        identity = {name: getattr(self, name) for name in IDENTITY} | {"variant": self.variant.name}
        return identity | {"method": METHOD, "starts": 0, "solve_s": 0.0, "iterations": 0}

    def resolve(self) -> ResolvedTask:
        """Return the cell's task; BadInput if the variant does not fit it."""
        settings = [f"modules={self.n}", f"module.connector_distance={self.distance_m}"]
        if self.task_seed is not None:
            settings.append(f"task_seed={self.task_seed}")
        return read_task(self.task, (*settings, *self.variant.overrides)).resolve(self.n)


@dataclass(frozen=True)
class Study:
    """A question, the conditions under which trees are solved, and functions that evaluate the rows."""

    name: str
    question: str
    full: Settings
    """Settings used without options."""
    small: Settings
    """Settings that finish in seconds."""
    variants: tuple[Variant, ...]
    first: bool
    """True if the first design ends a cell; otherwise the best of all starts counts."""
    summary: Callable[[pd.DataFrame], pd.DataFrame]
    """Table that summarises the rows."""
    figure: Callable[[pd.DataFrame], Figure]
    """Plot of the rows; needs matplotlib."""

    def cells(self, settings: Settings) -> list[Cell]:
        """Return the cells of all combinations, by ascending size.

        As in the paper every topology has its own random wrenches (Sec. IV, "for each trial"). They are the same
        under all conditions, so that conditions can be compared tree by tree.
        """
        tasks = {name: read_task(name) for name, _ in settings.tasks}
        return [
            Cell(variant, name, distance, n, key, None if task.task_seed is None else settings.seed + number)
            for n in sorted({n for _, sizes in settings.tasks for n in sizes})
            for number, tree in enumerate(trees(n, settings.topologies[n > settings.few_above], settings.seed))
            for name, task in tasks.items()
            if n in dict(settings.tasks)[name]
            for distance in settings.distances or (task.module.connector_distance,)
            for variant in self.variants
            for key in (roots(tree) if variant.every_root else [tree])
        ]


def trees(n: int, number: int, seed: int) -> list[str]:
    """Return the keys of all topologies of n modules, or of `number` different ones, drawn uniformly."""
    if count(n) <= number:
        return [candidate.key for candidate in candidates(n)]
    keys, drawn = dict[str, None](), Family(n).draws(seed)
    while len(keys) < number:
        keys[next(drawn).key] = None
    return list(keys)


def roots(key: str) -> list[str]:
    """Return the keys of a tree with each of its modules as the root, unturned and after a half turn."""
    rootings = _rootings(rooted_of(key))
    return sorted({key_of(text_of(turn(tree, quarters))) for tree in rootings for quarters in (0, 2)})


def _rootings(tree: Rooted, entered: int | None = None) -> list[Rooted]:
    beyond = (port for port in range(4) if tree[port] and port != entered)
    return [tree, *(other for port in beyond for other in _rootings(reroot(tree, port), (port + 2) % 4))]


def conduct(
    study: Study,
    settings: Settings,
    out: str | Path,
    *,
    workers: int | None = None,
    observer: Observer | None = None,
    backends: Backends = BACKENDS,
) -> pd.DataFrame:
    """Measure the cells of a study that have no row yet, and return all rows.

    Args:
        study: the study.
        settings: its conditions.
        out: its folder; cells that have a row there are skipped, failed ones are tried again.
        workers: worker processes; default: the cores available. Times are CPU times, but cores share caches.
        observer: receives progress; default: as for `search`.
        backends: solver and audit.

    Raises:
        BadInput: a variant does not fit its task, or the folder holds rows of other conditions.
        KeyboardInterrupt: Ctrl-C was pressed; all rows are kept, and a note (PEP 678) says so.
    """
    cells = study.cells(settings)
    for cell in {(cell.task, cell.variant, cell.distance_m): cell for cell in cells}.values():
        cell.resolve()  # refuse task and variant that do not fit before any work
    command = f"topo-search experiment {study.name} {settings.as_options()}"
    measured = partial(measure, backends, settings, study.first)

    def deadline(cell: Cell) -> float:
        return settings.time_limit + solve_deadline(cell.n, settings.starts) + audit_deadline(cell.n)

    with (
        open_record(Path(out), study.name, settings, command) as (done, add),
        Workers(workers or available_cores()) as pool,
        visible_progress(observer, incumbent=False) as shown,
    ):
        for n, size in groupby((cell for cell in cells if identity(cell.row) not in done), key=lambda cell: cell.n):
            missing = list(size)
            nlp.prepare(missing[0].resolve(), shown.note)
            shown.phase(Phase("searching", n, len(missing), settings.starts))
            try:
                for cell, row in pool.run(measured, missing, deadline=deadline):
                    if isinstance(row, Failed):
                        add(cell.row | {"status": "failed", "worst_constraint": row.reason})
                    else:
                        add(row)
                    shown.settled(None)
            except KeyboardInterrupt as stop:
                stop.add_note(KEPT)
                raise
    return results(out)


@contextmanager
def open_record(
    out: Path, name: str, settings: Settings, command: str
) -> Iterator[tuple[set[tuple[str, ...]], Callable[[Row], None]]]:
    """Open a study's folder; yield the identities of its finished cells and a function that appends a row.

    Raises:
        BadInput: the folder holds rows of other conditions, or is in use.
    """
    about = {
        "format": "topo-search/experiment",
        "version": 1,
        "experiment": name,
        "command": command,
        "settings": json.loads(json.dumps(asdict(settings) | {"tasks": dict(settings.tasks)})),
        "versions": installed_versions(),
    }
    make_folder(out)
    with lock(out):
        if (out / ABOUT).exists():
            held = _conditions(load_json(out / ABOUT))
            for condition, value in _conditions(about).items():
                if held.get(condition) != value:
                    what = f"has rows with {condition} {show(held.get(condition))}, not {show(value)}"
                    raise refusal(out, what)
        else:
            machine = {  # measured times depend on it
                "date": datetime.now(UTC).strftime("%Y-%m-%d"),
                "python": platform.python_version(),
                "machine": platform.machine(),
                "cores": os.cpu_count(),
            }
            write_atomically(out / ABOUT, f"{json.dumps(about | machine, indent=1)}\n")
        text = load_text(out / RESULTS, most_bytes=LIMITS.result_bytes) if (out / RESULTS).exists() else ""
        text = text[: text.rfind("\n") + 1]  # without a row that was cut off by a kill
        with (out / RESULTS).open("a", encoding="utf-8", newline="") as stream:
            stream.truncate(len(text.encode()))
            writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
            if not text:
                writer.writeheader()

            def add(row: Row) -> None:
                writer.writerow(row)
                stream.flush()

            rows = csv.DictReader(io.StringIO(text))
            yield {identity(row) for row in rows if row["status"] != "failed"}, add


def _conditions(about: Any) -> dict[str, Any]:
    try:
        return {"experiment": about["experiment"], **about["settings"], **about["versions"]}
    except (KeyError, TypeError):  # the file of another program
        return {}


def identity(row: Row) -> tuple[str, ...]:
    """Return the columns that identify a row's cell, as text."""
    return tuple("" if row[name] is None else str(row[name]) for name in IDENTITY)


def results(folder: str | Path) -> pd.DataFrame:
    """Return the rows in a study's folder, or in its `results.csv`; of a cell that was tried again, the last one.

    Raises:
        BadInput: the file is not a regular file, is too large or is not a table.
    """
    import pandas as pd

    path = Path(folder) / RESULTS if Path(folder).is_dir() else Path(folder)
    kinds = {"key": "str", "task_seed": "Int64", "colliding_pairs": "Int64", "largest_cluster": "Int64"}
    kinds |= dict.fromkeys(("verdict", "depths_percent", "worst_constraint", "unit"), "str")
    with as_bad_input(str(path)):
        text = io.StringIO(load_text(path, most_bytes=LIMITS.result_bytes))
        frame = pd.read_csv(text, dtype=kinds, keep_default_na=False, na_values=[""])
    frame = frame[~(frame["status"].eq("failed") & frame.duplicated(list(IDENTITY), keep="last"))]
    return frame.sort_values(["n", "distance_m", "task", "variant"], kind="stable", ignore_index=True)


def measure(backends: Backends, settings: Settings, first: bool, cell: Cell) -> Row:
    """Solve and audit one cell (in a worker) and return its row."""
    _load(backends, cell.task, cell.distance_m, min(cell.n, 8))  # eight modules load all compiled code
    task, topology = cell.resolve(), Topology.from_key(cell.key)
    began, iterations = time.process_time(), 0
    best: Design | Infeasible | None = None
    for s in range(settings.starts) if first else [0]:
        starts = range(s, s + 1) if first else range(settings.starts)  # those of a range share compiled programs
        outcome = backends.solve(Job(task, topology, starts, settings.seed))
        best = outcome if best is None else merge(best, outcome, task)
        solve_s = time.process_time() - began
        iterations += record.iterations if (record := record_of(outcome)) else 0
        if isinstance(outcome, Design) or outcome.status == "impossible" or solve_s > settings.time_limit:
            break
    assert best is not None  # there is a start
    row = cell.row | {"solve_s": round(solve_s, 4), "iterations": iterations, "peak_mb": round(peak_mb(), 1)}
    row["starts"] = record.starts if (record := record_of(best)) else 0
    if isinstance(best, Infeasible):
        return row | {name: getattr(best, name) for name in ("status", "worst_constraint", "violation", "unit")}
    began = time.process_time()
    audit = backends.audit(best)
    row |= {name: getattr(best, name) for name in ("objective", "lower_bound", "gap")} | {"status": "feasible"}
    row |= {"offset_m": round(math.hypot(*kinematics.platform(best).p_e), 6), "verdict": str(audit.verdict)}
    row |= {"audit_s": round(time.process_time() - began, 4), "peak_mb": round(peak_mb(), 1)}
    if (overlaps := audit.interference) is None:
        return row
    collisions = [pair for pair in audit.pairs if pair.kind == "airflow" and pair.status is Status.VIOLATED]
    depths = sorted((-pair.percent for pair in collisions if pair.percent is not None), reverse=True)
    return row | {
        "colliding_pairs": overlaps.colliding_pairs,
        "largest_cluster": len(overlaps.clusters[0]) if overlaps.clusters else 0,
        "deepest_percent": overlaps.deepest_percent,
        "depths_percent": " ".join(f"{depth:.1f}" for depth in depths),
    }


def peak_mb() -> float:
    """Return the peak memory of this process [MB]."""
    with open("/proc/self/status") as status:  # not `ru_maxrss`, which includes the parent's memory
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM:")) / 2**10


@cache
def _load(backends: Backends, task: str, distance_m: float, n: int) -> None:
    """Solve and audit a small platform once per process, to load compiled code before anything is timed."""
    resolved = read_task(task, (f"modules={n}", f"module.connector_distance={distance_m}")).resolve(n)
    design = backends.solve(Job(resolved, sample(n, 1, 0)[0], range(1), 0))
    if isinstance(design, Design):
        backends.audit(design)
