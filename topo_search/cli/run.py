"""`topo-search run`: the search."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from topo_search.cli import options
from topo_search.cli.errors import INPUT_OUTPUT, explained, needs_extras
from topo_search.limits import TRIALS

if TYPE_CHECKING:
    from topo_search.model.oddities import Oddity
    from topo_search.study import Answer


@click.command(epilog="Example: topo-search run push --paper --out push-paper")
@click.argument("task")
@options.modules
@options.set_field
@options.paper
@click.option(
    "--symmetry",
    type=click.Choice(["task", *options.SYMMETRIES]),
    default="task",
    show_default=True,
    help="Trees that count as one; `task` is the coarsest exact choice.",
)
@click.option(
    "--strategy",
    type=click.Choice(["exhaustive", "optuna"]),
    default="exhaustive",
    show_default=True,
    help="Solve all candidates, or those that an Optuna sampler proposes.",
)
@click.option(
    "--sampler",
    type=click.Choice(["moves", "tpe", "nsga2", "random"]),
    help="Sampling algorithm: moves on the best trees so far (default), TPE, NSGA-II, or uniform draws.",
)
@click.option(
    "--trials",
    type=click.IntRange(1, TRIALS),
    help="Number of candidates to propose (default: 512); if there are no more, all are solved from all starts.",
)
@click.option(
    "--prune",
    is_flag=True,
    help="Skip candidates that are proven no better than the best so far: all that remain once an audited design "
    "meets the lower bound.",
)
@options.starts("Starts per topology (default: the solver's).")
@options.seed
@options.workers
@options.dask
@click.option("--out", type=click.Path(path_type=Path), help="The run's folder (default: runs/NAME-HASH).")
@options.root
@options.connectors
@options.time_limit
@options.as_json
def run(
    task: str,
    modules: str | None,
    settings: tuple[str, ...],
    paper: bool,
    symmetry: Any,
    strategy: Any,
    sampler: Any,
    trials: int | None,
    prune: bool,
    starts: int | None,
    seed: int,
    workers: int | None,
    dask: str | None,
    dask_ca: Path | None,
    dask_cert: Path | None,
    dask_key: Path | None,
    out: Path | None,
    root: str | None,
    connectors: str | None,
    time_limit: float | None,
    as_json: bool,
) -> None:
    """Search the topologies for TASK (a file, or the name of a shipped example) and audit the best.

    The same command resumes a stopped run, or prints the answer of a finished one.
    Warnings about the task (see `check`) go to stderr first.

    Exit status: 0 audited design found; 1 designs found, but none passed its audit;
    2 bad input; 3 no design found, with the reasons; 70 workers or the Dask scheduler do not start, answer or come
    back (results are kept; the same command resumes); 74 the disk is full or fails, or the folder is gone (the best
    design is then printed).
    """
    if strategy == "exhaustive" and (sampler or trials):
        raise click.UsageError("--sampler and --trials go with --strategy optuna")
    if dask is None and (dask_ca or dask_cert or dask_key):
        raise click.UsageError("--dask-ca, --dask-cert and --dask-key go with --dask")
    if strategy == "optuna" and prune:
        raise click.UsageError("--prune goes with --strategy exhaustive")
    with explained(resumes=True):
        from topo_search.cli.progress import shown_progress
        from topo_search.compose import DEFAULT_TRIALS, search

        asked = options.asked(
            task, settings, paper=paper, modules=modules, search__root=root, search__connectors=connectors
        )
        odd = options.warn(asked)
        with _saved(odd, as_json=as_json), shown_progress() as observer, needs_extras("--dask"):
            answer = search(
                asked,
                out=out,
                symmetry=symmetry,
                strategy=strategy,
                sampler=sampler or "moves",
                trials=trials or DEFAULT_TRIALS,
                prune=prune,
                starts=starts,
                seed=seed,
                workers=workers,
                dask=dask,
                dask_tls=options.certificates(dask_ca, dask_cert, dask_key),
                time_limit=math.inf if time_limit is None else time_limit,
                observer=observer,
            )
        if as_json:
            options.echo_json(answer_as_json(answer, odd))
        else:
            from topo_search.cli.tables import print_answer

            print_answer(answer)
        raise SystemExit(answer.exit_status)


@contextmanager
def _saved(odd: tuple[Oddity, ...], *, as_json: bool) -> Iterator[None]:
    """Print the best design and what else was found if the run's folder is gone, so that it is not lost."""
    from topo_search.study import LedgerLost

    try:
        yield
    except LedgerLost as lost:
        if lost.answer is not None:
            if as_json:
                design = None if lost.design is None else json.loads(lost.design)
                told = answer_as_json(lost.answer, odd)
                options.echo_json({**told, "exit_status": INPUT_OUTPUT, "design": design})
            else:
                from topo_search.cli.tables import print_found

                print_found(lost.answer)
                if lost.design is not None:
                    click.echo(lost.design, nl=False)
        raise


def answer_as_json(answer: Answer, odd: tuple[Oddity, ...]) -> dict[str, Any]:
    """Return an answer, and what is odd about its task, as a JSON value."""
    told = {
        "folder": str(answer.folder),
        "exit_status": answer.exit_status,
        "best": answer.best and asdict(answer.best),
        "note": answer.note,
        "weakest_point": answer.weakest_point,
        "sizes": [asdict(size) for size in answer.sizes],
        "warnings": [asdict(one) for one in odd],
    }
    if not answer.levels:
        return told
    levels = [
        {"number": at.number, "level": at.level._asdict(), "sizes": [asdict(size) for size in at.sizes]}
        for at in answer.levels
    ]
    return {**told, "levels": levels, "front": [point.cells for point in answer.points]}
