"""`topo-search audit`: the exact audit of designs, from their files alone."""

from __future__ import annotations

import click

from topo_search.cli import options
from topo_search.cli.errors import BAD_INPUT, explained


@click.command(epilog="Example: topo-search audit runs/push-*/best.json")
@click.argument("designs", nargs=-1, required=True, metavar="DESIGN.json...")
@options.as_json
def audit(designs: tuple[str, ...], as_json: bool) -> None:
    """Audit designs exactly, whoever made them: everything is derived again from the file alone.

    Exit status: 0 all clear; 1 one is violated, undecided or inconsistent;
    2 a file cannot be read (the others are audited all the same).
    """
    with explained():
        from topo_search.cli.tables import print_audit
        from topo_search.compose import audits
        from topo_search.engine import Failed
        from topo_search.model import BadInput, Design
        from topo_search.model.files import read_json

        readable: list[tuple[str, Design]] = []
        status = 0
        for path in designs:
            try:
                readable.append((path, read_json(Design, path)))
            except BadInput as error:
                click.echo(str(error), err=True)
                status = BAD_INPUT
        found = []
        for (path, _), result in zip(readable, audits([design for _, design in readable]), strict=True):
            if isinstance(result, Failed):
                click.echo(f"{path}: the audit failed: {result.reason}", err=True)
            else:
                found.append(result.model_dump(mode="json"))
                if not as_json:
                    print_audit(path, result)
            if isinstance(result, Failed) or result.verdict != "clear":
                status = status or 1
        if as_json:
            options.echo_json(found[0] if len(designs) == 1 and found else found)
        raise SystemExit(status)
