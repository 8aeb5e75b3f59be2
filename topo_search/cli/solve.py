"""`topo-search solve`: one topology."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from topo_search.cli import options
from topo_search.cli.errors import explain_errors, note
from topo_search.limits import LIMITS

if TYPE_CHECKING:
    from topo_search.model import Task, Topology


@click.command(epilog="Example: topo-search solve push --topology af0000 --out design.json")
@click.argument("task")
@click.option(
    "--topology", "key", metavar="KEY", help="Key of the topology, as `topo-search topologies` prints it."
)
@click.option(
    "--sample-seed",
    type=click.IntRange(0, LIMITS.largest_integer),
    metavar="S",
    help="The tree of `topologies N --sample 1 --seed S`, with the root and the connectors of the task.",
)
@options.modules
@options.set_field
@options.paper
@options.starts("Number of starts (default: until more starts no longer help, or time is up).")
@options.seed
@options.time_limit
@options.near
@click.option("--out", type=options.FILE, help="Output file for the design.")
@options.as_json
def solve(
    task: str,
    key: str | None,
    sample_seed: int | None,
    modules: str | None,
    settings: tuple[str, ...],
    paper: bool,
    near: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    **option_values: Any,
) -> None:
    """Solve TASK for one topology and audit the design.

    Without --starts and --time-limit it stops when more starts no longer help. Warnings about the task (see
    `check`) go to stderr first.

    --json prints the design, or why there is none. If --out cannot be written, the design is printed instead, so
    nothing is lost. Exit status as for `run`.
    """
    with explain_errors():
        from topo_search import compose
        from topo_search.cli.tables import print_solved, progress_line
        from topo_search.engine import Failed
        from topo_search.model import Design
        from topo_search.model.files import to_json, write_atomically

        problem = options.task_of(task, settings, paper=paper, modules=modules)
        topology = _topology(problem, key, sample_seed, sized=modules is not None)
        designs = options.read_near(near)
        options.require_writable(out)
        options.warn(problem.model_copy(update={"modules": topology.n}))
        solved = compose.solve(
            problem,
            topology,
            near=designs,
            progress=lambda best: note(progress_line(best)),
            note=note,
            **option_values,
        )
        if out is not None and isinstance(solved.outcome, Design):
            text = to_json(solved.outcome)
            try:
                write_atomically(out, text)
            except OSError:
                click.echo(text, nl=False)  # so that the design is not lost
                raise
        if not as_json:
            print_solved(solved, out)
        elif isinstance(solved.outcome, Failed):
            options.echo_json({"status": "failed", "reason": solved.outcome.reason})
        else:
            click.echo(to_json(solved.outcome), nl=False)
        raise SystemExit(solved.exit_status)


def _topology(task: Task, key: str | None, sample_seed: int | None, *, sized: bool) -> Topology:
    """Return the tree that the options name."""
    from topo_search.model import BadInput, Topology
    from topo_search.topologies import sample

    if key is not None and sample_seed is None:
        try:
            topology = Topology.from_key(key)
        except ValueError as error:
            raise BadInput("--topology", str(error)) from None
        if sized and topology.n not in task.sizes:
            rule = f"must have the number of modules of --modules, but got {topology.n} in {key}"
            raise BadInput("--topology", rule)
        return topology
    if key is None and sample_seed is not None:
        if len(task.sizes) > 1:
            raise BadInput("--sample-seed", "needs one number of modules: choose it with --modules N")
        search = task.search
        (topology,) = sample(task.sizes[0], 1, sample_seed, connectors=search.connectors, root=search.root)
        return topology
    raise click.UsageError("give either --topology or --sample-seed")
