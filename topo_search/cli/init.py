"""`topo-search init`: a task file to start from."""

from __future__ import annotations

import re
from pathlib import Path

import click

from topo_search.cli import options
from topo_search.cli.errors import explain_errors


@click.command(epilog="Example: topo-search init window.toml && topo-search check window.toml")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False), metavar="[FILE]", default="task.toml")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def init(file: Path, force: bool) -> None:
    """Write a commented task file to start from.

    FILE (default: task.toml) has every field of a task, with its default, its unit and its meaning.

    Exit status: 0 written; 2 bad input.
    """
    with explain_errors():
        from topo_search.model import BadInput, Fault
        from topo_search.model.files import write_atomically
        from topo_search.model.template import task_template

        if file.exists() and not force:
            raise BadInput(str(file), [Fault("", "already exists; --force overwrites it")])
        options.require_writable(file, "FILE")
        name = re.sub(r"[^A-Za-z0-9._-]+", "-", file.stem).lstrip("._-")[:64]
        write_atomically(file, task_template(name or "task"))
        click.echo(f"wrote {file}; explain it with: topo-search check {file}")
