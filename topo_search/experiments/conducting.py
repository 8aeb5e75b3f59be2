"""Running an experiment: cells solved, audited and timed in worker processes, and the folder of their results.

`results.csv` has a row per cell, `about.json` the conditions of the rows. Both must be regular files, not symbolic
links. Rows are appended to one open file; after each row it is checked that the file is still in its folder.
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
from topo_search.engine import Backends, Failed, Job, Workers, audit_deadline, merge, record_of, solve_deadline
from topo_search.experiments.plan import IDENTITY, Cell, Settings
from topo_search.limits import LIMITS
from topo_search.model import Audit, BadInput, Design, Fault, Infeasible, Status, Topology
from topo_search.model.files import load_json, read_task
from topo_search.model.text import decode, escape_formula, read_regular
from topo_search.model.value import as_bad_input, show
from topo_search.study import Observer, Phase, SilentObserver
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
class CellResult:
    """A row of `results.csv`; None is an empty cell."""

    variant: str
    """Name of the problem variant."""
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
    """CPU time of all starts, including building the program unless `build_s` has that [s]."""
    build_s: float | None = None
    """CPU time of building the program before the first start, if the method does so [s]."""
    audit_s: float | None = None
    """CPU time of the audit [s]."""
    iterations: int = 0
    """Ipopt iterations; if all starts are solved at once, those of the best start."""
    peak_mb: float | None = None
    """Peak memory of the worker process so far [MB]; cells are solved by ascending size."""
    objective: float | None = None
    """J [rad^4/s^4]."""
    lower_bound: float | None = None
    """[rad^4/s^4]"""
    gap: float | None = None
    offset_m: float | None = None
    """Distance of the end-effector from the centre of mass [m]."""
    verdict: str | None = None
    """Verdict of the audit."""
    colliding_pairs: int | None = None
    """Pairs of airflow envelopes proven to overlap."""
    largest_cluster: int | None = None
    """Modules in the largest cluster of overlapping envelopes; 0 without overlap."""
    deepest_percent: float | None = None
    """Deepest overlap as a percentage of the deepest possible."""
    depths_percent: str | None = None
    """Depths of all colliding pairs, likewise, deepest first, separated by spaces."""
    worst_constraint: str | None = None
    """Constraint that the best start violates most; if the cell failed, the reason."""
    violation: float | None = None
    unit: str | None = None


COLUMNS = tuple(field.name for field in fields(CellResult))


class Results:
    """The rows of one experiment; this process has locked the folder."""

    def __init__(self, path: Path, handle: int, identities: set[tuple[str, ...]]) -> None:
        """Wrap a file that is open for appending, with the identities of its rows."""
        self._path, self._handle, self._identities = path, handle, identities
        self._size = os.fstat(handle).st_size

    @classmethod
    @contextmanager
    def open(cls, folder: Path, about: dict[str, Any]) -> Iterator[Self]:
        """Make an experiment's folder, or resume one.

        Args:
            folder: the folder.
            about: the conditions, from `identify`. A folder with rows of other conditions is refused.

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
                machine = {  # measured times depend on it
                    "date": datetime.now(UTC).strftime("%Y-%m-%d"),
                    "python": platform.python_version(),
                    "machine": platform.machine(),
                    "cores": os.cpu_count(),
                }
                directory.write(ABOUT, f"{json.dumps({**about, **machine}, indent=1)}\n".encode())
            if not (folder / RESULTS).exists():
                directory.write(RESULTS, f"{','.join(COLUMNS)}\n".encode())
            path = folder / RESULTS
            size, identities = _rows(path)
            handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                os.ftruncate(handle, size)  # drop a row that was cut off by a kill
                yield cls(path, handle, identities)
            finally:
                os.close(handle)

    def has(self, cell: Cell) -> bool:
        """Return whether a cell has a row."""
        return _identity(cell.identity) in self._identities

    def add(self, row: CellResult) -> None:
        """Append a row and flush it to disk.

        Raises:
            LedgerLost: the file has vanished.
            OSError: the row cannot be written; the error names the file.
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
        self._identities.add(_identity(vars(row)))

    def require(self) -> None:
        """Raise LedgerLost unless the file is still in its folder, with all rows."""
        open_file = os.fstat(self._handle)
        with suppress(OSError):
            if os.path.samestat(open_file, os.lstat(self._path)) and open_file.st_size == self._size:
                return
        rule = "truncated while the experiment ran; it stopped, and only the rows still in that file are kept"
        raise LedgerLost(self._path, rule)


def identify(name: str, settings: dict[str, Any], command: str) -> dict[str, Any]:
    """Return the conditions of an experiment's rows, with the command that makes them."""
    return {
        "format": "topo-search/experiment",
        "version": 1,
        "experiment": name,
        "command": command,
        "settings": settings,
        "versions": installed_versions(),
    }


def results(folder: str | Path) -> pd.DataFrame:
    """Return the rows in an experiment's folder, or in its `results.csv`, with the columns of `CellResult`.

    Raises:
        BadInput: the file is not a regular file, is too large or is not a table.
    """
    import pandas as pd

    path = Path(folder) / RESULTS if Path(folder).is_dir() else Path(folder)
    kinds = {"key": "str", "task_seed": "Int64", "colliding_pairs": "Int64", "largest_cluster": "Int64"}
    kinds |= dict.fromkeys(("verdict", "depths_percent", "worst_constraint", "unit"), "str")
    with as_bad_input(str(path)):
        content = read_regular(path, most_bytes=LIMITS.result_bytes)
        frame = pd.read_csv(io.BytesIO(content), dtype=kinds, keep_default_na=False, na_values=[""])
    retried = frame["status"].eq("failed") & frame.duplicated(list(IDENTITY), keep="last")
    frame = frame[~retried]
    return frame.sort_values(["n", "distance_m", "task", "variant"], kind="stable", ignore_index=True)


def _compare(folder: Path, stored: Any, about: dict[str, Any]) -> None:
    """Raise BadInput if a folder holds another experiment."""
    if not isinstance(stored, dict) or any(stored.get(name) != about[name] for name in ("format", "version")):
        raise refusal(folder, f"has an {ABOUT} of another program or version")
    if stored.get("experiment") != about["experiment"]:
        raise refusal(folder, f"holds the experiment {stored.get('experiment')}, not {about['experiment']}")
    for group in ("settings", "versions"):
        if not isinstance(values := stored.get(group), dict):
            raise refusal(folder, f"has an {ABOUT} whose {group} is not a table")
        for name, value in about[group].items():
            if values.get(name) != value:
                kind = "results of version" if group == "versions" else "an experiment with"
                raise refusal(folder, f"holds {kind} {name} {show(values.get(name))}, not {show(value)}")


def _rows(path: Path) -> tuple[int, set[tuple[str, ...]]]:
    """Return the length of the complete rows of a file, and the cells they answer; BadInput names a damaged row."""
    with as_bad_input(str(path)):
        content = read_regular(path, most_bytes=LIMITS.result_bytes)
        size = content.rfind(b"\n") + 1
        text = decode(content[:size])
    lines = text.split("\n")[:-1]
    if not lines or tuple(lines[0].split(",")) != COLUMNS:
        raise refusal(path.parent, f"has a {RESULTS} with other columns")
    rows = [_cells(path, number, line) for number, line in enumerate(lines[1:], start=2)]
    return size, {_identity(row) for row in rows if row["status"] != "failed"}  # failed cells are retried


def _cells(path: Path, number: int, line: str) -> dict[str, str]:
    """Return the cells of a line by column; BadInput names a damaged line and the fault."""
    try:
        (cells,) = csv.reader([line], strict=True)
    except (csv.Error, ValueError):  # none or several rows
        cells = []
    if len(cells) != len(COLUMNS):
        rule = f"must have {len(COLUMNS)} cells in each row, but has {len(cells)} in line {number}: it is damaged"
        raise BadInput(str(path), rule)
    row = dict(zip(COLUMNS, cells, strict=True))
    readers: dict[str, Callable[[str], object]] = {"int": int, "float": float, "str": str}
    for name, kind in ((field.name, str(field.type)) for field in fields(CellResult)):
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
    """A question, the cells that answer it, and functions that evaluate their rows."""

    name: str
    question: str
    full: Settings
    """Settings used without options."""
    small: Settings
    """Settings that finish in seconds."""
    cells: Callable[[Settings], list[Cell]]
    """The plan, by ascending size."""
    summary: Callable[[pd.DataFrame], pd.DataFrame]
    """Table that summarises the rows."""
    findings: Callable[[pd.DataFrame], list[str]]
    """Findings from the rows, in sentences."""
    figure: Callable[[pd.DataFrame], Figure]
    """Plot of the rows; needs matplotlib."""


def conduct(
    experiment: Experiment,
    settings: Settings,
    out: str | Path,
    *,
    workers: int | None = None,
    observer: Observer | None = None,
    backends: Backends = BACKENDS,
) -> pd.DataFrame:
    """Measure the cells of an experiment that have no row yet, and return all rows.

    Args:
        experiment: the experiment.
        settings: its conditions.
        out: its folder; resumed if it holds the same experiment with the same settings.
        workers: worker processes; default: the cores available. Times are CPU times, but cores share caches.
        observer: receives progress.
        backends: solver and audit.

    Raises:
        BadInput: the settings or the folder cannot be used.
        KeyboardInterrupt: Ctrl-C was pressed; all rows are kept, and a note (PEP 678) says so.
        LedgerLost: the folder or its rows vanished during the experiment.
    """
    observer = observer or SilentObserver()
    cells = experiment.cells(settings)
    for cell in {(cell.task, cell.variant, cell.distance_m): cell for cell in cells}.values():
        cell.resolve()  # refuse task and variant that do not fit before any work
    command = f"topo-search experiment {experiment.name} {settings.as_options()}"
    about = identify(experiment.name, settings.as_json(), command)
    with Results.open(Path(out), about) as rows, Workers(workers or available_cores()) as pool:
        for n, size in groupby(cells, key=lambda cell: cell.n):
            missing = [cell for cell in size if not rows.has(cell)]
            if not missing:
                continue
            nlp.prepare(missing[0].resolve(), observer.note)
            observer.phase(Phase("searching", n, len(missing), settings.starts))
            try:
                for cell, row in pool.run(functools.partial(measure, backends), missing, deadline=_deadline):
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


def measure(backends: Backends, cell: Cell) -> CellResult:
    """Solve and audit one cell; runs in a worker."""
    _load(backends, cell.task, cell.distance_m, min(cell.n, 8))  # eight modules load all compiled code
    task, topology = cell.resolve(), Topology.from_key(cell.key)
    clock, solve_s, iterations = Clock(), 0.0, 0
    best: Design | Infeasible | None = None
    for starts in cell.rounds:
        outcome = backends.solve(Job(task, topology, starts, cell.settings.seed))
        best = outcome if best is None else merge(best, outcome, task)
        solve_s += clock.lap()
        record = record_of(outcome)
        iterations += 0 if record is None else record.iterations
        if isinstance(outcome, Design) or outcome.status == "impossible" or solve_s > cell.settings.time_limit:
            break
    assert best is not None  # `Settings` guarantees a start
    record = record_of(best)
    row = CellResult(
        **cell.identity,
        status="feasible" if isinstance(best, Design) else best.status,
        starts=0 if record is None else record.starts,
        solve_s=round(solve_s, 4),
        iterations=iterations,
        peak_mb=round(peak_mb(), 1),
    )
    if not isinstance(best, Design):
        return replace(row, worst_constraint=best.worst_constraint, violation=best.violation, unit=best.unit)
    offset = round(math.hypot(*kinematics.platform(best).p_e), 6)
    row = replace(row, objective=best.objective, lower_bound=best.lower_bound, gap=best.gap, offset_m=offset)
    audit = backends.audit(best)
    return replace(row, audit_s=round(clock.lap(), 4), peak_mb=round(peak_mb(), 1), **_audit_columns(audit))


def failure_row(cell: Cell, failure: Failed) -> CellResult:
    """Return the row of a cell whose worker failed."""
    return CellResult(**cell.identity, status="failed", worst_constraint=failure.reason)


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
    """Solve and audit a small platform once per process, to load compiled code before anything is timed."""
    resolved = read_task(task, (f"modules={n}", f"module.connector_distance={distance_m}")).resolve(n)
    design = backends.solve(Job(resolved, sample(n, 1, 0)[0], range(1), 0))
    if isinstance(design, Design):
        backends.audit(design)
