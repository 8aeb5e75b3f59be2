"""`topo-search list`, `show`, `open`, `report` and `compare`: runs, their answers and pages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from topo_search.cli import options
from topo_search.cli.errors import explain_errors, note
from topo_search.cli.run import answer_as_json, echo_answer

if TYPE_CHECKING:
    from topo_search.report.design_page import Compared

run_folder = click.argument("run", type=click.Path(path_type=Path, exists=True, file_okay=False))


@click.command("list", epilog="Example: topo-search list")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False), default=Path("runs"))
@options.as_json
def list_runs(folder: Path, as_json: bool) -> None:
    """List the runs in a folder (default: runs), with their best designs.

    Exit status: 0 listed; 2 bad input.
    """
    with explain_errors():
        from topo_search.cli.tables import print_runs
        from topo_search.model import BadInput
        from topo_search.study import RunFolder, answer_of
        from topo_search.study.directory import RunFile

        if not folder.is_dir():
            raise BadInput(str(folder), "no such folder: `topo-search run push` makes a first run in ./runs")

        runs = []
        for ledger in sorted(folder.glob(f"*/{RunFile.LEDGER}")):
            with RunFolder.load(ledger.parent) as opened:
                runs.append((ledger.parent, answer_of(opened)))
        if as_json:
            options.echo_json([answer_as_json(answer, ()) for _, answer in runs])
        else:
            print_runs(runs)


@click.command(epilog="Example: topo-search show runs/push-*/")
@run_folder
@options.as_json
def show(run: Path, as_json: bool) -> None:
    """Print the answer of a RUN again, as far as it has come.

    Exit status: as `run` ends with this answer; 2 bad input.
    """
    with explain_errors():
        from topo_search.study import RunFolder, answer_of

        with RunFolder.load(run) as folder:
            answer = answer_of(folder)
        echo_answer(answer, as_json=as_json)
        raise SystemExit(answer.exit_status)


@click.command("open", epilog="Example: topo-search open runs/push-*/")
@run_folder
def open_page(run: Path) -> None:
    """Open the page of a RUN in the browser.

    Exit status: 0 opened; 2 bad input, or no browser.
    """
    with explain_errors():
        from topo_search.model import BadInput
        from topo_search.study import REPORT

        page = run / REPORT
        if not page.is_file():
            raise BadInput(str(run), f"has no {REPORT} yet: topo-search report {run} writes it")
        if click.launch(str(page)):
            raise BadInput(str(page), "no program on this machine opens it")


@click.command(epilog="Example: topo-search report runs/push-*/")
@click.argument("source", metavar="RUN|DESIGN.json", type=options.PATH)
@click.option(
    "--out",
    type=options.FILE,
    metavar="FILE",
    help="Where to write it (default: report.html in the run's folder, or the design's name with .html).",
)
@click.option(
    "--flight",
    type=options.PATH,
    metavar="DIR",
    help="Folder from `fly DESIGN.json --out DIR`, whose flights the page of that design shows.",
)
def report(source: Path, out: Path | None, flight: Path | None) -> None:
    """Write the report of a run, or of a design after auditing it, as one offline HTML file.

    `run` writes its report itself; this writes it again, from the ledger, with a warning for each other file that
    somebody changed.

    Exit status: 0 written, whatever the verdict; 2 bad input.
    """
    with explain_errors():
        from topo_search import compose

        options.require_writable(out)
        click.echo(f"the page is in {compose.write_report(source, out=out, flight=flight, note=note)}")


@click.command(epilog="Example: topo-search compare runs/push-1 runs/push-2")
@click.argument("first", metavar="RUN|DESIGN.json", type=options.PATH)
@click.argument("second", metavar="RUN|DESIGN.json", type=options.PATH)
@click.option(
    "--out",
    type=options.FILE,
    default=Path("compare.html"),
    show_default=True,
    metavar="FILE",
    help="Where to write the page.",
)
@options.as_json
def compare(first: Path, second: Path, out: Path, as_json: bool) -> None:
    """Compare two runs or designs, as a table and a page.

    The table compares the best designs; the page shows any two of the best of each run in linked views.

    Exit status: 0 compared; 2 bad input.
    """
    with explain_errors():
        from topo_search import compose
        from topo_search.cli.tables import print_figures

        options.require_writable(out)
        figures = {side[0].name: _figures(side[0]) for side in compose.compare(first, second, out=out)}
        if as_json:
            options.echo_json(figures)
        else:
            print_figures(figures)
            click.echo(f"the page is in {out}")


def _figures(design: Compared) -> dict[str, object]:
    """Return the figures of a design by their columns in `candidates.csv`."""
    from topo_search.study.row import figures_of, flight_of

    audit = design.audit
    return {
        "key": design.design.topology.key,
        "modules": design.design.topology.n,
        "objective": design.design.objective,
        "gap": design.gap,
        "audit": None if audit is None else str(audit.verdict),
        **({} if audit is None else {**flight_of(audit), **figures_of(audit)}),
    }
