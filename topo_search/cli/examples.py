"""`topo-search examples`: the shipped tasks."""

from __future__ import annotations

import click

from topo_search.cli import options
from topo_search.cli.errors import explain_errors


@click.command(epilog='Example: topo-search run "$(topo-search examples | head -n 1)"')
@options.as_json
def examples(as_json: bool) -> None:
    """List the shipped tasks, by the name that `run` and `solve` take."""
    with explain_errors():
        from topo_search.model import files

        if as_json:
            options.echo_json(files.examples())
            return
        for name in files.examples():
            click.echo(name)
