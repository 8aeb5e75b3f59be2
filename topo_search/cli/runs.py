"""`topo-search list`, `show` and `open`: the runs that there are, their answers and pages."""

from __future__ import annotations

from pathlib import Path

import click

from topo_search.cli import options
from topo_search.cli.errors import explain_errors

RUN = click.argument("run", type=click.Path(path_type=Path, exists=True, file_okay=False))


@click.command("list", epilog="Example: topo-search list")
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False), default=Path("runs"))
@options.as_json
def list_runs(folder: Path, as_json: bool) -> None:
    """List the runs in a folder (default: runs), with their best designs.

    Exit status: 0 listed; 2 bad input.
    """
    with explain_errors():
        from topo_search.cli.tables import print_runs
        from topo_search.study import RunFolder, answer_of
        from topo_search.study.folder import LEDGER

        runs = []
        for ledger in sorted(folder.glob(f"*/{LEDGER}")):
            with RunFolder.load(ledger.parent) as opened:
                runs.append((ledger.parent, answer_of(opened)))
        if as_json:
            from topo_search.cli.run import answer_as_json

            options.echo_json([answer_as_json(answer, ()) for _, answer in runs])
        else:
            print_runs(runs)


@click.command(epilog="Example: topo-search show runs/push-*/")
@RUN
@options.as_json
def show(run: Path, as_json: bool) -> None:
    """Print the answer of a RUN again, as far as it has come.

    Exit status: as `run` ends with this answer; 2 bad input.
    """
    with explain_errors():
        from topo_search.study import RunFolder, answer_of

        with RunFolder.load(run) as folder:
            answer = answer_of(folder)
        if as_json:
            from topo_search.cli.run import answer_as_json

            options.echo_json(answer_as_json(answer, ()))
        else:
            from topo_search.cli.tables import print_answer

            print_answer(answer)
        raise SystemExit(answer.exit_status)


@click.command("open", epilog="Example: topo-search open runs/push-*/")
@RUN
def open_page(run: Path) -> None:
    """Open the page of a RUN in the browser.

    Exit status: 0 opened; 2 bad input, or no browser.
    """
    with explain_errors():
        from topo_search.model import BadInput, Fault
        from topo_search.study import REPORT

        page = run / REPORT
        if not page.is_file():
            raise BadInput(str(run), [Fault("", f"has no {REPORT} yet: topo-search report {run} writes it")])
        if click.launch(str(page)):
            raise BadInput(str(page), [Fault("", "no program on this machine opens it")])
