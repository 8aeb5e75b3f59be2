"""`topo-search init`, `examples`, `check` and `topologies`: task files, their requirements, trees of a size."""

from __future__ import annotations

import re
import textwrap
from bisect import bisect_left
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from pathlib import Path
from typing import Any

import click

import topo_search as ts
from topo_search.cli import options
from topo_search.cli.errors import command
from topo_search.limits import LIMITS
from topo_search.report.wording import figures, quantity


@command(epilog="Example: topo-search init window.toml && topo-search check window.toml")
@click.argument("file", type=options.FILE, metavar="[FILE]", default="task.toml")
@click.option("--full", is_flag=True, help="Write every field with its default, unit and meaning.")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
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
@options.picture("Draw forces and exposure regions as a .png or .svg")
@options.as_json
def check(task: str, modules: str | None, settings: tuple[str, ...], paper: bool, picture: Path | None) -> None:
    """Explain a task in words, and warn about suspicious values.

    TASK is a file, or the name of a shipped example.

    Exit status: 0 valid task, with or without warnings; 2 bad input.
    """
    from topo_search.report.task_warnings import UNIT_IN_DOUBT, task_warnings

    user_task = options.task_of(task, settings, paper=paper, modules=modules)
    if picture is not None:
        options.require_drawable(picture)
        from topo_search.export.picture import save
        from topo_search.export.task_picture import task_figure

        save(task_figure(user_task.resolve(user_task.sizes[0])), picture)
    sizes = [_size(user_task, n) for n in user_task.sizes]
    warnings = task_warnings(user_task)
    plausible = not any(one.path.startswith("module.") and UNIT_IN_DOUBT in one.words for one in warnings)
    first = user_task.resolve(user_task.sizes[0]).model_dump(mode="json")
    value = {"task": first, "sizes": sizes, "warnings": [warning._asdict() for warning in warnings]}
    searches = [("search, and a bound on control effort if every wrench is met exactly", _expectations(sizes))]
    groups = chain(
        [("warnings", warnings)] * bool(warnings), _requirements(user_task, plausible=plausible), searches
    )
    lines = (line for title, rows in groups for line in _group(title, rows))
    picture_line = [] if picture is None else [f"\nthe picture is in {picture}"]
    options.echo_answer(value, chain([user_task.name], lines, picture_line))


def _requirements(task: ts.Task, *, plausible: bool) -> Iterator[tuple[str, Iterable[tuple[str, str]]]]:
    """Yield the requirements of a task in groups, with the unit of weight for every number of modules.

    The air of a module without plausible sizes is left out: it takes long and means nothing.
    """
    from topo_search.report.task_facts import facts, goals, load_cases

    first, *larger = (task.resolve(n) for n in task.sizes)
    yield from facts(first, *larger)
    if plausible and any(exposure.geometry for exposure in first.exposure):
        from topo_search.cli.hardware import speeds_on
        from verify.air.envelope import envelope_air

        hover = first.module.mass * first.gravity
        speeds = speeds_on(envelope_air(first.module, first.air_density, hover))
        yield "air of one module in hover, on its envelope for regions: at most", speeds
    if free := [f"exposure[{k}].speed" for k, exposure in enumerate(task.exposure) if exposure.speed is None]:
        yield "air speed over regions", [("not limited", f"by envelopes; to limit it, state {', '.join(free)}")]
    if task.goals.names:
        yield goals(task)
    size = f" of {quantity(first.n, 'module')}" if larger else ""
    cases = [(f"load case {k}", f"{wrench}; weight {weight}") for k, wrench, weight in load_cases(first)]
    yield f"load cases{size}, each the total wrench of the rotors", cases


def _expectations(sizes: list[dict[str, Any]]) -> Iterator[tuple[str, str]]:
    """Yield the figures of `_size` in words."""
    from topo_search.model.proven import at_least

    yield from (("trees", quotient) for quotient in dict.fromkeys(size["quotient"] for size in sizes))
    for size in sizes:
        bound = f"J at least {figures(at_least(size['lower_bound'], 3))} rad⁴/s⁴, whatever the topology"
        effort = f"impossible: {size['impossible']}" if size["impossible"] else bound
        if (share := size["defaults_share"]) is not None:
            held = (
                f"{100 * share:.0f} % of the side force, tilt and acceleration that flying tasks ask for by default"
            )
            effort += f"; {held} are not excluded; if no size holds them, the answer is fragile"
        yield quantity(size["modules"], "module"), f"{quantity(size['candidates'], 'candidate')}; {effort}"


def _group(title: str, rows: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Yield the lines of named values below their title, wrapped."""
    yield f"\n{title}"
    for name, value in rows:
        first, rest = f"  {name:38} ", " " * 41
        yield from textwrap.wrap(value, 120, initial_indent=first, subsequent_indent=rest, break_on_hyphens=False)


def _size(task: ts.Task, n: int) -> dict[str, Any]:
    """Return the number of candidates and the bound on effort for n modules; nothing is solved."""
    from nlp import lower_bound, prove_impossible
    from topo_search.model.flying import scaled_defaults
    from topo_search.study import Request
    from topo_search.study.answer import quotient_remark

    request, resolved = Request(task, "task", starts=1, seed=0), task.resolve(n)
    proof, share = prove_impossible(resolved), None
    if proof is not None and task.flight.filled and prove_impossible(scaled_defaults(task, 0.0).resolve(n)) is None:

        def is_excluded(twentieths: int) -> bool:
            return prove_impossible(scaled_defaults(task, twentieths / 20).resolve(n)) is not None

        share = bisect_left(range(1, 20), True, key=is_excluded) / 20
    return {
        "modules": n,
        "candidates": request.space(n).count(),
        "quotient": quotient_remark(request.quotient(n)),
        "lower_bound": lower_bound(resolved),
        "impossible": proof and proof.message,
        "defaults_share": share,
    }


@command(epilog="Example: topo-search topologies 8 --count")
@click.argument("n", type=click.IntRange(1, LIMITS.listed_modules), metavar="N")
@click.option("--count", "only_count", is_flag=True, help="Print only the number of topologies.")
@options.whole_number(
    "--sample", (1, LIMITS.drawn_trees), "Print M topologies, drawn uniformly.", "size", metavar="M"
)
@options.seed
@options.choice("--symmetry", options.SYMMETRIES, "Symmetries under which trees count as one.", default="c2")
@options.connectors
@options.root
@options.as_json
def topologies(
    n: int, only_count: bool, size: int | None, seed: int, symmetry: Any, connectors: Any, root: Any
) -> None:
    """Print the keys of all topologies of N modules, one per line."""
    from topo_search.topologies import Family

    family = Family(n, symmetry=symmetry, connectors=connectors or "aligned", root=root or "free")
    if only_count:
        click.echo(family.count())
        return
    if size is None:
        keys = (candidate.key for candidate in family.candidates())
    else:
        keys = (topology.key for topology in islice(family.draws(seed), size))
    options.echo_answer([*keys] if options.is_json() else None, keys)
