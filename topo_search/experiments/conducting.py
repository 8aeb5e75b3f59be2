"""An experiment: cells solved, audited and timed in worker processes, and the folder that holds what came of them.

`results.csv` has a row per cell, `about.json` the conditions that made it. Both are regular files, and no symbolic
link is followed to them. Rows are appended to one file, held open; after each row the file is checked to be still
there.
"""

from __future__ import annotations

import csv
import functools
import io
import json
import math
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import astuple, dataclass, fields, replace
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import nlp
from topo_search.compose import BACKENDS, available_cores
from topo_search.engine import Backends, Failed, Workers, audit_deadline, merge, record_of, solve_deadline
from topo_search.experiments.plan import IDENTITY, Cell, Settings
from topo_search.limits import LIMITS
from topo_search.model import Audit, BadInput, Design, Fault, Infeasible, Status, Topology
from topo_search.model.files import load_json, read_task
from topo_search.model.text import decode, escape_formula, read_regular
from topo_search.model.value import naming, show
from topo_search.study import Observer, Phase, Silent
from topo_search.study.directory import Directory
from topo_search.study.folder import make_folder, refusal
from topo_search.study.ledger_file import KEPT, LedgerLost
from topo_search.study.request import installed_versions
from topo_search.supervisor import Clock, peak_mb
from topo_search.topologies import sample
from verify import kinematics

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

RESULTS, ABOUT = "results.csv", "about.json"
METHOD = "topo-search"
"""The method of this package; rows made by `tests/benchmarks/direct_scaling.py` say `direct`."""


@dataclass(frozen=True)
class Measured:
    """A row of `results.csv`; a missing value is an empty cell."""

    variant: str
    """The problem, where an experiment compares several."""
    task: str
    distance_m: float
    """Connector distance [m]."""
    n: int
    key: str
    task_seed: int | None
    """Seed of the ten wrenches."""
    status: str
    """feasible, infeasible, impossible (proven) or failed."""
    method: str = METHOD
    starts: int = 0
    """Starts that were solved."""
    solve_s: float = 0.0
    """CPU seconds of all starts, building included unless `build_s` has it."""
    build_s: float | None = None
    """CPU seconds of building the program before the first start, for a method that does."""
    audit_s: float | None = None
    """CPU seconds of the audit."""
    iterations: int = 0
    """Ipopt iterations; only of the best start where all starts are solved at once."""
    peak_mb: float | None = None
    """Peak memory of the worker process so far [MB]. It solves small platforms before large ones."""
    objective: float | None = None
    """J [rad^4/s^4]."""
    lower_bound: float | None = None
    """[rad^4/s^4]"""
    gap: float | None = None
    offset_m: float | None = None
    """Distance of the end-effector from the centre of mass [m]."""
    verdict: str | None = None
    """Verdict of the audit; without one `failed`, with the reason in `worst_constraint`."""
    colliding_pairs: int | None = None
    """Pairs of airflow envelopes proven to overlap."""
    largest_cluster: int | None = None
    """Modules in the largest cluster of overlapping envelopes; 0 without overlap."""
    deepest_percent: float | None = None
    """Deepest overlap in percent of the deepest possible."""
    depths_percent: str | None = None
    """Depths of all colliding pairs in the same percent, deepest first, separated by spaces."""
    worst_constraint: str | None = None
    """The constraint missed by the start that came closest; the reason if the cell failed."""
    violation: float | None = None
    unit: str | None = None


COLUMNS = tuple(field.name for field in fields(Measured))


class Results:
    """The rows of one experiment, held by this process alone."""

    def __init__(self, path: Path, handle: int, done: set[tuple[str, ...]]) -> None:
        """Take a file that is open for appending, and the identities of its rows."""
        self._path, self._handle, self._done = path, handle, done
        self._size = os.fstat(handle).st_size

    @classmethod
    @contextmanager
    def open(cls, folder: Path, about: dict[str, Any]) -> Iterator[Self]:
        """Make an experiment's folder, or resume one.

        Args:
            folder: its path.
            about: the conditions of `identify`; a folder with rows of other conditions is refused.

        Raises:
            BadInput: the folder cannot be used; it is left unchanged.
        """
        make_folder(folder)
        for name in (RESULTS, ABOUT):
            if (folder / name).is_symlink():
                raise refusal(folder, f"has a symbolic link in place of its {name}")
        if (folder / RESULTS).exists() and not (folder / ABOUT).exists():
            raise refusal(folder, f"has a {RESULTS} but no {ABOUT}: it is not an experiment folder")
        with Directory.open(folder) as directory, directory.lock():
            directory.remove_partial()
            if (folder / ABOUT).exists():
                _compare(folder, load_json(folder / ABOUT), about)
            else:
                machine = {  # it has a part in the measured times
                    "date": datetime.now(UTC).strftime("%Y-%m-%d"),
                    "python": platform.python_version(),
                    "machine": platform.machine(),
                    "cores": os.cpu_count(),
                }
                directory.write(ABOUT, f"{json.dumps({**about, **machine}, indent=1)}\n".encode())
            if not (folder / RESULTS).exists():
                directory.write(RESULTS, f"{','.join(COLUMNS)}\n".encode())
            path = folder / RESULTS
            size, done = _rows(path)
            handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                os.ftruncate(handle, size)  # a row that a kill tore
                yield cls(path, handle, done)
            finally:
                os.close(handle)

    def has(self, cell: Cell) -> bool:
        """Return whether a cell has its row."""
        return _identity(cell.identity) in self._done

    def add(self, row: Measured) -> None:
        """Append a row; it is on the disk when this returns.

        Raises:
            LedgerLost: it is not: the file is gone.
            OSError: it cannot be written; names the file.
        """
        line = io.StringIO()
        csv.writer(line, lineterminator="\n").writerow(map(escape_formula, astuple(row)))
        content = memoryview(line.getvalue().encode())
        self._size += len(content)
        try:
            while content:
                content = content[os.write(self._handle, content) :]
            os.fsync(self._handle)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error
        self.require()
        self._done.add(_identity(vars(row)))

    def require(self) -> None:
        """Make sure that the file is still there with all rows; LedgerLost if not."""
        held = os.fstat(self._handle)
        with suppress(OSError):
            if os.path.samestat(held, os.lstat(self._path)) and held.st_size == self._size:
                return
        ended = "truncated while the experiment ran; it stopped, and only the rows still in that file are kept"
        raise LedgerLost(self._path, ended)


def identify(name: str, settings: dict[str, Any], command: str) -> dict[str, Any]:
    """Return the conditions of an experiment's rows, and the command for them."""
    return {
        "format": "topo-search/experiment",
        "version": 1,
        "experiment": name,
        "command": command,
        "settings": settings,
        "versions": installed_versions(),
    }


def results(folder: str | Path) -> pd.DataFrame:
    """Return the rows of an experiment's folder, or of its `results.csv`, with the columns of `Measured`.

    Raises:
        BadInput: that is no regular file, is too large or no table.
    """
    import pandas as pd

    path = Path(folder) / RESULTS if Path(folder).is_dir() else Path(folder)
    kinds = {"key": "str", "task_seed": "Int64", "colliding_pairs": "Int64", "largest_cluster": "Int64"}
    kinds |= dict.fromkeys(("verdict", "depths_percent", "worst_constraint", "unit"), "str")
    with naming(str(path)):
        content = read_regular(path, most_bytes=LIMITS.result_bytes)
        frame = pd.read_csv(io.BytesIO(content), dtype=kinds, keep_default_na=False, na_values=[""])
    tried_again = frame["status"].eq("failed") & frame.duplicated(list(IDENTITY), keep="last")
    frame = frame[~tried_again]
    return frame.sort_values(["n", "distance_m", "task", "variant"], kind="stable", ignore_index=True)


def _compare(folder: Path, held: Any, about: dict[str, Any]) -> None:
    """Refuse a folder that holds another experiment."""
    if not isinstance(held, dict) or any(held.get(name) != about[name] for name in ("format", "version")):
        raise refusal(folder, f"has an {ABOUT} of another program or version")
    if held.get("experiment") != about["experiment"]:
        raise refusal(folder, f"holds the experiment {held.get('experiment')}, not {about['experiment']}")
    for group in ("settings", "versions"):
        if not isinstance(values := held.get(group), dict):
            raise refusal(folder, f"has an {ABOUT} whose {group} is not a table")
        for name, value in about[group].items():
            if values.get(name) != value:
                kind = "results of version" if group == "versions" else "an experiment with"
                raise refusal(folder, f"holds {kind} {name} {show(values.get(name))}, not {show(value)}")


def _rows(path: Path) -> tuple[int, set[tuple[str, ...]]]:
    """Return the bytes of a file that are whole rows, and what they answer; BadInput names a damaged row."""
    with naming(str(path)):
        content = read_regular(path, most_bytes=LIMITS.result_bytes)
        size = content.rfind(b"\n") + 1
        text = decode(content[:size])
    lines = text.split("\n")[:-1]
    if not lines or tuple(lines[0].split(",")) != COLUMNS:
        raise refusal(path.parent, f"has a {RESULTS} with other columns")
    rows = [_cells(path, number, line) for number, line in enumerate(lines[1:], start=2)]
    return size, {_identity(row) for row in rows if row["status"] != "failed"}  # those are tried again


def _cells(path: Path, number: int, line: str) -> dict[str, str]:
    """Return the cells of a line by their columns; BadInput names the line if it is damaged, and why."""
    try:
        (cells,) = csv.reader([line], strict=True)
    except (csv.Error, ValueError):  # none or several rows
        cells = []
    if len(cells) != len(COLUMNS):
        rule = f"must have {len(COLUMNS)} cells in each row, but has {len(cells)} in line {number}: it is damaged"
        raise BadInput(str(path), rule)
    row = dict(zip(COLUMNS, cells, strict=True))
    readers: dict[str, Callable[[str], object]] = {"int": int, "float": float, "str": str}
    for name, kind in ((field.name, str(field.type)) for field in fields(Measured)):
        try:
            readers[kind.removesuffix(" | None")](row[name])
        except ValueError:
            if row[name] or not kind.endswith(" | None"):
                rule = f"must be of kind {kind}, but got {show(row[name])} in line {number}: it is damaged"
                raise BadInput(str(path), [Fault(name, rule)]) from None
    return row


def _identity(values: dict[str, Any]) -> tuple[str, ...]:
    return tuple("" if values[name] is None else str(escape_formula(values[name])) for name in IDENTITY)


@dataclass(frozen=True)
class Experiment:
    """A question, the cells that answer it, and how their rows are read."""

    name: str
    question: str
    full: Settings
    """The settings without options."""
    small: Settings
    """Settings that finish in seconds."""
    cells: Callable[[Settings], list[Cell]]
    """The plan, by ascending size."""
    summary: Callable[[pd.DataFrame], pd.DataFrame]
    """The rows summed up."""
    findings: Callable[[pd.DataFrame], list[str]]
    """Findings from the rows, in sentences."""
    figure: Callable[[pd.DataFrame], Figure]
    """The rows drawn; needs matplotlib."""


def conduct(
    experiment: Experiment,
    settings: Settings,
    out: str | Path,
    *,
    workers: int | None = None,
    observer: Observer | None = None,
    backends: Backends = BACKENDS,
) -> pd.DataFrame:
    """Measure the cells that have no row yet, and return all rows.

    Args:
        experiment: what to measure.
        settings: its conditions.
        out: its folder; resumed if it holds the same experiment with the same settings.
        workers: worker processes; default: the cores available. Times are CPU times, but cores share caches.
        observer: receives the progress.
        backends: solver and audit.

    Raises:
        BadInput: settings or folder cannot be used.
        KeyboardInterrupt: after Ctrl-C; all rows are kept, and a note (PEP 678) says so.
        LedgerLost: the folder or its rows vanished meanwhile.
    """
    observer = observer or Silent()
    cells = experiment.cells(settings)
    for cell in {(cell.task, cell.variant, cell.distance_m): cell for cell in cells}.values():
        cell.resolve()  # what does not fit together is refused before any work is done
    command = f"topo-search experiment {experiment.name} {settings.as_options()}"
    about = identify(experiment.name, settings.as_json(), command)
    with Results.open(Path(out), about) as rows, Workers(workers or available_cores()) as pool:
        for n, size in groupby(cells, key=lambda cell: cell.n):
            todo = [cell for cell in size if not rows.has(cell)]
            if not todo:
                continue
            nlp.prepare(todo[0].resolve(), observer.note)
            observer.phase(Phase("searching", n, len(todo), settings.starts))
            try:
                for cell, row in pool.run(functools.partial(measure, backends), todo, deadline=_deadline):
                    rows.add(failure_row(cell, row) if isinstance(row, Failed) else row)
                    observer.settled(None)
            except KeyboardInterrupt as stop:
                rows.require()
                stop.add_note(KEPT)
                raise
        rows.require()
    return results(out)


def _deadline(cell: Cell) -> float:
    return cell.settings.time_limit + solve_deadline(cell.n, len(cell.rounds[0])) + audit_deadline(cell.n)


def measure(backends: Backends, cell: Cell) -> Measured:
    """Solve and audit one cell (in a worker)."""
    _load(backends, cell.task, cell.distance_m, min(cell.n, 8))  # with eight all of the compiled code is used
    task, topology = cell.resolve(), Topology.from_key(cell.key)
    clock, spent, iterations = Clock(), 0.0, 0
    best: Design | Infeasible | None = None
    for starts in cell.rounds:
        outcome = backends.solve(task, topology, starts=starts, seed=cell.settings.seed)
        best = outcome if best is None else merge(best, outcome, task)
        spent += clock.lap()
        record = record_of(outcome)
        iterations += 0 if record is None else record.iterations
        if isinstance(outcome, Design) or outcome.status == "impossible" or spent > cell.settings.time_limit:
            break
    assert best is not None  # as `Settings` has a start
    record = record_of(best)
    row = Measured(
        **cell.identity,
        status="feasible" if isinstance(best, Design) else best.status,
        starts=0 if record is None else record.starts,
        solve_s=round(spent, 4),
        iterations=iterations,
        peak_mb=round(peak_mb(), 1),
    )
    if not isinstance(best, Design):
        return replace(row, worst_constraint=best.worst_constraint, violation=best.violation, unit=best.unit)
    offset = round(math.hypot(*kinematics.platform(best).p_e), 6)
    row = replace(row, objective=best.objective, lower_bound=best.lower_bound, gap=best.gap, offset_m=offset)
    audit = backends.audit(best)
    return replace(row, audit_s=round(clock.lap(), 4), peak_mb=round(peak_mb(), 1), **_audit_columns(audit))


def failure_row(cell: Cell, failure: Failed) -> Measured:
    """Return the row of a cell whose process ended without an answer."""
    return Measured(**cell.identity, status="failed", worst_constraint=failure.reason)


def _audit_columns(audit: Audit) -> dict[str, Any]:
    """Return the columns that an audit fills."""
    overlaps = audit.interference
    if overlaps is None:
        return {"verdict": str(audit.verdict)}
    depths = [
        -pair.percent
        for pair in audit.pairs
        if pair.kind == "airflow" and pair.status == Status.VIOLATED and pair.percent is not None
    ]
    return {
        "verdict": str(audit.verdict),
        "colliding_pairs": overlaps.colliding_pairs,
        "largest_cluster": len(overlaps.clusters[0]) if overlaps.clusters else 0,
        "deepest_percent": overlaps.deepest_percent,
        "depths_percent": " ".join(f"{depth:.1f}" for depth in sorted(depths, reverse=True)) or None,
    }


@functools.cache
def _load(backends: Backends, task: str, distance_m: float, n: int) -> None:
    """Solve and audit a small platform once per process: it loads compiled code, which no row should count."""
    resolved = read_task(task, (f"modules={n}", f"module.connector_distance={distance_m}")).resolve(n)
    design = backends.solve(resolved, sample(n, 1, 0)[0], starts=range(1), seed=0)
    if isinstance(design, Design):
        backends.audit(design)
