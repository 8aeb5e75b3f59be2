"""`topo-search compare`: two runs or designs side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from topo_search.cli import options
from topo_search.cli.errors import explain_errors

if TYPE_CHECKING:
    from topo_search.report.compare_page import Compared


@click.command(epilog="Example: topo-search compare runs/push-1 runs/push-2")
@click.argument("first", metavar="RUN|DESIGN.json", type=click.Path(path_type=Path))
@click.argument("second", metavar="RUN|DESIGN.json", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
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
