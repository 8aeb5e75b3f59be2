"""`topo-search export`: a design for other eyes and tools."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from topo_search.cli import options
from topo_search.cli.errors import explained

PICTURES = ("png", "svg")


@click.command(epilog="Example: topo-search export runs/push-*/best.json --out push.png")
@click.argument("design", metavar="DESIGN.json")
@click.option(
    "--format", "kind", type=click.Choice(PICTURES), help="Kind of file (default: by the end of --out's name)."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    metavar="FILE",
    help="Where to write it; a file that is there is replaced.",
)
def export(design: str, kind: Any, out: Path) -> None:
    """Draw a design: the platform with its airflow, a close-up, and the tree of its modules.

    Needs matplotlib, the extra `viz`. The design need not be audited, nor pass its audit.

    Exit status: 0 written; 2 bad input.
    """
    with explained():
        from topo_search.model import BadInput, Design, Fault
        from topo_search.model.files import read_json

        asked: Any = kind or out.suffix.removeprefix(".").lower()
        if asked not in PICTURES:
            rule = f"must end in .png or .svg, or --format be given, but got {out.name}"
            raise BadInput("--out", [Fault("", rule)])
        options.require_writable(out)
        read = read_json(Design, design)
        try:
            from topo_search.export.picture import draw
        except ModuleNotFoundError as error:
            if error.name != "matplotlib":
                raise
            how = 'needs matplotlib, which is not installed; type: pip install "topo-search[viz]"'
            raise BadInput(f"--format {asked}", [Fault("", how)]) from None
        draw(read, out, format=asked)
        click.echo(f"the picture is in {out}")
