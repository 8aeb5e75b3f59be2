"""`topo-search report`: the page of a run or of a design."""

from __future__ import annotations

from pathlib import Path

import click

from topo_search.cli import options
from topo_search.cli.errors import explain_errors, note


@click.command(epilog="Example: topo-search report runs/push-*/")
@click.argument("source", metavar="RUN|DESIGN.json", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Where to write it (default: report.html in the run's folder, or the design's name with .html).",
)
@click.option(
    "--flight",
    type=click.Path(path_type=Path),
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

        if out is not None:
            options.require_writable(out)
        click.echo(f"the page is in {compose.write_report(source, out=out, flight=flight, note=note)}")
