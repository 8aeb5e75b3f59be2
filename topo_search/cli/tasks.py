"""`topo-search init`, `examples`, `check` and `topologies`: task files, their requirements, trees of a size."""

import re
from itertools import chain, islice
from pathlib import Path
from typing import Any

import click

import topo_search as ts
from topo_search.cli import options
from topo_search.cli.errors import command
from topo_search.limits import LIMITS


@command(epilog="Example: topo-search init window.toml && topo-search check window.toml")
@click.argument("file", type=options.FILE, metavar="[FILE]", default="task.toml")
@options.flag("--full", "Write every field with its default, unit and meaning.")
@options.flag("--force", "Overwrite an existing file.")
def init(file: Path, full: bool, force: bool) -> None:
    """Write a task file to start from, FILE (default: task.toml): a platform that pushes while it hovers.

    Exit status: 0 written; 2 bad input.
    """
    from topo_search.model.files import write_atomically
    from topo_search.model.task_file import task_template

    if file.exists() and not force:
        raise ts.BadInput(str(file), "already exists; --force overwrites it")
    options.require_writable(file, "FILE")
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", file.stem).lstrip("._-")[:64]
    write_atomically(file, task_template(name or "task", full=full))
    click.echo(f"wrote {file}; explain it with: topo-search check {file}")


@command(epilog='Example: topo-search run "$(topo-search examples | head -n 1)"')
@options.as_json
def examples() -> None:
    """List the names of the shipped tasks, which `run` and `solve` take."""
    from topo_search.model.task_file import examples

    names = examples()
    options.echo_answer(names, names)


@command(epilog="Example: topo-search check push-local --picture push-local.png")
@click.argument("task")
@options.modules
@options.set_field
@options.paper
@options.picture("Draw forces and exposure regions as a .png, .svg or .pdf")
@options.as_json
def check(task: str, modules: str | None, settings: tuple[str, ...], paper: bool, picture: Path | None) -> None:
    """Explain a task in words, and warn about suspicious values.

    TASK is a file, or the name of a shipped example.

    Exit status: 0 valid task, with or without warnings; 2 bad input.
    """
    user_task = options.task_of(task, settings, paper=paper, modules=modules)
    if picture is not None:
        options.require_drawable(picture)
        from topo_search.export.picture import save
        from topo_search.export.task_picture import task_figure

        save(task_figure(user_task.resolve(user_task.sizes[0])), picture)
    checked = ts.check(user_task)
    first = user_task.resolve(user_task.sizes[0]).model_dump(mode="json")
    warnings = [warning._asdict() for warning in checked.warnings]
    value = {"task": first, "sizes": checked.sizes, "warnings": warnings}
    picture_line = [] if picture is None else [f"\nthe picture is in {picture}"]
    options.echo_answer(value, chain([str(checked)], picture_line))


@command(epilog="Example: topo-search topologies 8 --count")
@click.argument("n", type=click.IntRange(1, LIMITS.listed_modules), metavar="N")
@options.flag("--count", "Print only the number of topologies.", "only_count")
@options.whole_number(
    "--sample", (1, LIMITS.drawn_trees), "Print M topologies, drawn uniformly.", "size", metavar="M"
)
@options.seed
@options.choice("--symmetry", options.SYMMETRIES, "Symmetries under which trees count as one.", default="c2")
@options.connectors
@options.root
@options.types
@options.choice("--lattice", ["flat"], "Flat lattices, neighbours bolted and cycles allowed, instead of trees.")
@options.as_json
def topologies(
    n: int,
    only_count: bool,
    size: int | None,
    seed: int,
    symmetry: Any,
    connectors: Any,
    root: Any,
    types: tuple[int, ...],
    lattice: Any,
) -> None:
    """Print the keys of all topologies of N modules, one per line."""
    from topo_search.topologies import family_of
    from topo_search.topologies.lattices import Lattices

    if lattice and (n > LIMITS.lattice_modules or connectors == "any" or types):
        rule = f"takes at most {LIMITS.lattice_modules} modules, of one type and with aligned connectors"
        raise ts.BadInput("--lattice", rule)
    if types and sum(types) != n:
        got = " + ".join(map(str, types))
        raise ts.BadInput("--types", f"must add up to N = {n}, but got {got} = {sum(types)}")
    names = {"symmetry": symmetry, "connectors": connectors or "aligned", "root": root or "free"}
    family = Lattices(n, **names) if lattice else family_of(n, counts=types, **names)
    if only_count:
        click.echo(family.count())
        return
    if size is None:
        keys = (candidate.key for candidate in family.candidates())
    else:
        keys = (topology.key for topology in islice(family.draws(seed), size))
    options.echo_answer([*keys] if options.is_json() else None, keys)
