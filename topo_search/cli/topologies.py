"""`topo-search topologies`: the trees of a size."""

from __future__ import annotations

from itertools import islice
from typing import Any

import click

from topo_search.cli import options
from topo_search.cli.errors import explain_errors
from topo_search.limits import DRAWN_TREES, LISTED_MODULES


@click.command(epilog="Example: topo-search topologies 8 --count")
@click.argument("n", type=click.IntRange(1, LISTED_MODULES), metavar="N")
@click.option("--count", "only_count", is_flag=True, help="Print only the number of topologies.")
@click.option(
    "--sample",
    "size",
    type=click.IntRange(1, DRAWN_TREES),
    metavar="M",
    help="Print M topologies, drawn uniformly.",
)
@options.seed
@click.option(
    "--symmetry",
    type=click.Choice(options.SYMMETRIES),
    default="c2",
    show_default=True,
    help="Trees that count as one.",
)
@options.connectors
@options.root
@options.as_json
def topologies(
    n: int,
    only_count: bool,
    size: int | None,
    seed: int,
    symmetry: Any,
    connectors: Any,
    root: Any,
    as_json: bool,
) -> None:
    """Print the keys of all topologies of N modules, one per line."""
    with explain_errors():
        from topo_search.topologies import candidates, count, draws

        family = {"symmetry": symmetry, "connectors": connectors or "aligned", "root": root or "free"}
        if only_count:
            number = count(n, **family)
            click.echo(number)
            return
        if size is None:
            keys = (candidate.key for candidate in candidates(n, **family))
        else:
            keys = (topology.key for topology in islice(draws(n, seed, **family), size))
        if as_json:
            options.echo_json_list(keys)
            return
        options.echo_lines(keys)
