"""`topo-search list`, `show`, `open`, `report`, `compare` and `audit`: runs, their pages, and designs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import topo_search as ts
from topo_search.cli import options
from topo_search.cli.errors import command, note
from topo_search.cli.run import answer_as_json
from topo_search.limits import LIMITS
from topo_search.supervisor import ExitStatus

if TYPE_CHECKING:
    from topo_search.report.headline import Compared

run_folder = click.argument("run", type=click.Path(path_type=Path, exists=True, file_okay=False))


@command("list", epilog="Example: topo-search list")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False), default=Path("runs"))
@options.as_json
def list_runs(folder: Path) -> None:
    """List the runs in a folder (default: runs), with their best designs.

    Exit status: 0 listed; 2 bad input.
    """
    from topo_search.cli.tables import run_lines
    from topo_search.study import RunFile

    if not folder.is_dir():
        raise ts.BadInput(str(folder), "no such folder: `topo-search run push` makes a first run in ./runs")

    ledgers = sorted(folder.glob(f"*/{RunFile.LEDGER}"))
    runs = [(ledger.parent, ts.read_answer(ledger.parent)) for ledger in ledgers]
    options.echo_answer([answer_as_json(answer, ()) for _, answer in runs], run_lines(runs))


@command(epilog="Example: topo-search show runs/push-*/")
@run_folder
@options.as_json
def show(run: Path) -> None:
    """Print the answer of a RUN, finished or not.

    Exit status: as for `run`.
    """
    from topo_search.cli.tables import answer_lines

    answer = ts.read_answer(run)
    options.echo_answer(answer_as_json(answer, ()), answer_lines(answer))
    raise SystemExit(answer.exit_status)


@command("open", epilog="Example: topo-search open runs/push-*/")
@run_folder
def open_page(run: Path) -> None:
    """Open the page of a RUN in the browser.

    Exit status: 0 opened; 2 bad input, or no browser.
    """
    from topo_search.study import RunFile

    page = run / RunFile.REPORT
    if not page.is_file():
        raise ts.BadInput(str(run), f"has no {RunFile.REPORT} yet: topo-search report {run} writes it")
    if click.launch(str(page)):
        raise ts.BadInput(str(page), "no program on this machine opens it")


@command(epilog="Example: topo-search report runs/push-*/")
@click.argument("source", metavar="RUN|DESIGN.json", type=options.PATH)
@options.out(
    "--out", "out", "Output file (default: report.html in the run's folder, or the design's name with .html)."
)
@click.option(
    "--flight",
    type=options.PATH,
    metavar="DIR",
    help="Folder written by `fly DESIGN.json --out DIR`; the page of that design shows its flights.",
)
def report(source: Path, out: Path | None, flight: Path | None) -> None:
    """Write the report of a run, or of a design after auditing it, as one offline HTML file.

    `run` writes the report of a run itself. This command rewrites it from the ledger, and warns of every other file
    in the folder that has been changed.

    Exit status: 0 written, whatever the verdict; 2 bad input.
    """
    options.require_writable(out)
    click.echo(f"the page is in {ts.write_report(source, out=out, flight=flight, note=note)}")


@command(epilog="Example: topo-search compare runs/push-1 runs/push-2")
@click.argument("first", metavar="RUN|DESIGN.json", type=options.PATH)
@click.argument("second", metavar="RUN|DESIGN.json", type=options.PATH)
@options.out("--out", "out", "Output file for the page.", default=Path("compare.html"))
@options.as_json
def compare(first: Path, second: Path, out: Path) -> None:
    """Compare two runs or designs, as a table and a page.

    The table compares the best designs; the page shows any two of the runs' best designs in linked views.

    Exit status: 0 compared; 2 bad input.
    """
    from topo_search.cli.tables import table_lines
    from topo_search.report.design_page import figure_table

    options.require_writable(out)
    best = [side[0] for side in ts.compare(first, second, out=out)]
    lines = table_lines(*figure_table(*best)[:2])
    options.echo_answer({design.name: _figures(design) for design in best}, (*lines, f"the page is in {out}"))


def _figures(design: Compared) -> dict[str, object]:
    """Return the figures of a design, named like columns of `candidates.csv`."""
    from topo_search.study.columns import figures_of
    from topo_search.study.ledger import flight_of

    audit = design.audit
    return {
        "key": design.design.topology.key,
        "modules": design.design.topology.n,
        "value": design.design.value,
        "objective": design.design.objective,
        "gap": design.gap,
        "audit": None if audit is None else str(audit.verdict),
        **({} if audit is None else {**flight_of(audit), **figures_of(audit)}),
    }


@command(epilog="Example: topo-search audit runs/push-*/best.json --details")
@click.argument("designs", nargs=-1, required=True, metavar="DESIGN.json|FOLDER...")
@options.as_json
@options.out("--csv", "table", "Write all clearances to a CSV table.")
@options.flag("--details", "Print every figure.")
@options.workers
@click.option("--against", metavar="TASK", help="Judge the designs by this task in place of their own.")
def audit(
    designs: tuple[str, ...], table: Path | None, details: bool, workers: int | None, against: str | None
) -> None:
    """Audit designs exactly, from the design files alone.

    Given a folder, every .json file below it is audited; audits in a run's folder are skipped. With `--against` a
    design of any program may leave out `task` and `objective`; its effort is beside the best known and the bound.

    Exit status: 0 all clear; 1 a design is violated, undecided or inconsistent, or its audit failed;
    2 a file cannot be read, is not a design, or has other numbers of modules or load cases than the task of
    `--against` (the others are still audited).
    """
    from topo_search.cli.tables import audit_lines, tally_lines
    from topo_search.compose import audits, available_cores
    from topo_search.compose.referee import Judged, judge
    from topo_search.engine import Failed
    from topo_search.export.audits import clearances_of, csv
    from topo_search.model.files import to_geometry, write_atomically
    from topo_search.model.task_file import read_task

    options.require_writable(table, "--csv")
    if against is None:
        loaded, refused, skipped = _read_designs(designs, to_geometry)
    else:
        loaded, refused, skipped = _read_designs(designs, partial(judge, name=against, task=read_task(against)))
    judged, values = list[tuple[str, ts.Audit]](), list[dict[str, object]]()
    failures, files = 0, len(loaded) + refused + skipped
    processes = min(workers or available_cores(), files) if files > 1 else 0
    subjects = (design for _, design in loaded)
    results = audits(subjects, workers=processes) if against is None else (each.audit for each in subjects)
    for (name, design), result in zip(loaded, results, strict=True):
        if isinstance(result, Failed):
            failures += 1
            note(f"{name}: the audit failed: {result.reason}")
            continue
        judged.append((name, result))
        beside = design if isinstance(design, Judged) else None
        if options.is_json():
            values.append({"file": name, **result.model_dump(mode="json"), **(beside.figures() if beside else {})})
        else:
            lines = audit_lines(name, result, details=details)
            options.echo_lines(chain(lines, beside.lines() if beside else ()))
    verdicts = [audit.verdict for _, audit in judged]
    if options.is_json():
        single = len(designs) == len(values) == 1 and not Path(designs[0]).is_dir()
        options.echo_answer(values[0] if single else values, ())
    elif files > 1:
        options.echo_lines(tally_lines(verdicts, failures, refused, skipped))
    if table is not None:
        write_atomically(table, csv(clearances_of(judged)))
    if refused:
        raise SystemExit(ExitStatus.BAD_INPUT)
    if failures or any(verdict != ts.Status.CLEAR for verdict in verdicts):
        raise SystemExit(1)


def _read_designs(
    sources: Sequence[str], read: Callable[[Any, str], Any]
) -> tuple[list[tuple[str, Any]], int, int]:
    """Return designs with their file names, and the numbers of files refused and of audits skipped.

    A folder stands for all `*.json` below it, sorted; audits that a run keeps beside its designs are skipped.
    A symbolic link to a folder is followed only if it is one of the arguments.
    """
    from topo_search.model.files import is_audit, load_json
    from topo_search.model.value import to_printable

    loaded = list[tuple[str, Any]]()
    refused = skipped = 0
    for source in sources:
        in_folder = Path(source).is_dir()
        for path, fault in _find_files(source) if in_folder else [(source, None)]:
            name = to_printable(path)
            try:
                if fault is not None:
                    raise ts.BadInput(name, fault)
                data = load_json(path, most_bytes=LIMITS.design_bytes)
                if in_folder and is_audit(data):
                    skipped += 1
                else:
                    loaded.append((name, read(data, name)))
            except ts.BadInput as error:
                refused += 1
                note("\n".join(f"{name}: {each}" for each in error.faults))
    return loaded, refused, skipped


def _find_files(folder: str) -> Iterator[tuple[str, str | None]]:
    """Yield the files below a folder, and with a fault each folder that cannot be read or has no file."""
    errors: list[OSError] = []
    empty = True
    for parent, folders, files in os.walk(folder, onerror=errors.append):
        folders.sort()
        for name in sorted(files):
            if name.endswith(".json"):
                empty = False
                yield str(Path(parent) / name), None
    for error in errors:
        yield str(error.filename), f"cannot be read: {error.strerror}"
    if empty and not errors:
        yield folder, "must contain designs, but no file below it ends in .json"
