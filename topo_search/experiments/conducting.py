"""An experiment, and how it is conducted."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import nlp
from topo_search.compose import BACKENDS, available_cores
from topo_search.engine import Backends, Failed, Workers, audit_deadline, solve_deadline
from topo_search.experiments.cell import Cell
from topo_search.experiments.folder import RESULTS, Results, identify
from topo_search.experiments.measured import failure_row, measure
from topo_search.experiments.settings import Settings
from topo_search.limits import RESULT_BYTES
from topo_search.model import BadInput, Fault
from topo_search.model.regular_file import NotReadable, read_regular
from topo_search.study import Observer, Phase, Silent
from topo_search.study.ledger_file import KEPT

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Experiment:
    """A question, the cells that answer it, and how their rows are read."""

    name: str
    question: str
    full: Settings
    """What is measured without options."""
    small: Settings
    """Done in seconds."""
    cells: Callable[[Settings], list[Cell]]
    """The plan, by ascending size."""
    summary: Callable[[pd.DataFrame], pd.DataFrame]
    """The rows summed up."""
    findings: Callable[[pd.DataFrame], list[str]]
    """What the rows say, in sentences."""
    figure: Callable[[pd.DataFrame], Figure]
    """The rows drawn; needs matplotlib."""


def experiment(name: str) -> Experiment:
    """Return an experiment: `scaling`, `ablation`, `placement`, `root` or `body`."""
    found: Experiment = import_module(f"topo_search.experiments.{name}").EXPERIMENT
    return found


def conduct(
    asked: Experiment,
    settings: Settings,
    out: str | Path,
    *,
    workers: int | None = None,
    observer: Observer | None = None,
    backends: Backends = BACKENDS,
) -> pd.DataFrame:
    """Measure the cells that have no row yet, and return all rows.

    Call it from under `if __name__ == "__main__":` in a script, for it starts worker processes.

    Args:
        asked: the experiment.
        settings: its conditions.
        out: its folder; taken up again if it holds the same experiment with the same settings.
        workers: worker processes; default: the cores available. Times are CPU times, but cores share caches.
        observer: is told of the progress.
        backends: solver and audit.

    Raises:
        BadInput: settings or folder cannot be used.
        KeyboardInterrupt: after Ctrl-C; all rows are kept, and a note (PEP 678) says so.
        ResultsLost: the folder or its rows vanished meanwhile.
    """
    folder, told = Path(out), observer or Silent()
    cells = asked.cells(settings)
    for cell in {(cell.task, cell.variant, cell.distance_m): cell for cell in cells}.values():
        cell.resolve()  # what does not fit together is refused before any work is done
    command = f"topo-search experiment {asked.name} {settings.as_options()}"
    fixed = identify(asked.name, settings.as_json(), command)
    with Results.open(folder, fixed) as rows, Workers(workers or available_cores()) as pool:
        for n, size in groupby(cells, key=lambda cell: cell.n):
            todo = [cell for cell in size if not rows.has(cell)]
            if not todo:
                continue
            nlp.prepare(todo[0].resolve(), told.note)
            told.phase(Phase("searching", n, len(todo), settings.starts))
            try:
                for cell, row in pool.run(partial(measure, backends), todo, deadline=_deadline):
                    rows.add(failure_row(cell, row) if isinstance(row, Failed) else row)
                    told.settled(None)
            except KeyboardInterrupt as stop:
                rows.require()
                stop.add_note(KEPT)
                raise
        rows.require()
    return results(folder)


def results(folder: str | Path) -> pd.DataFrame:
    """Return the rows of an experiment's folder, or of its `results.csv`, with the columns of `Measured`.

    Raises:
        BadInput: that is no regular file, is too large or no table.
    """
    import pandas as pd

    path = Path(folder) / RESULTS if Path(folder).is_dir() else Path(folder)
    kinds = {"key": "str", "task_seed": "Int64", "colliding_pairs": "Int64", "largest_cluster": "Int64"}
    kinds |= dict.fromkeys(("verdict", "depths_percent", "worst_constraint", "unit"), "str")
    try:
        content = read_regular(path, most_bytes=RESULT_BYTES)
        frame = pd.read_csv(io.BytesIO(content), dtype=kinds, keep_default_na=False, na_values=[""])
    except (NotReadable, UnicodeDecodeError, pd.errors.ParserError) as error:
        raise BadInput(str(path), [Fault("", str(error))]) from None
    return frame.sort_values(["n", "distance_m", "task", "variant"], kind="stable", ignore_index=True)


def _deadline(cell: Cell) -> float:
    """Return the time after which a cell counts as hung [s]."""
    return cell.time_limit + solve_deadline(cell.n, len(cell.rounds[0])) + audit_deadline(cell.n)
