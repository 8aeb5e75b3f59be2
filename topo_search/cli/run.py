"""`topo-search run`: search for the best topology."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Any
from warnings import catch_warnings

import click

import topo_search as ts
from topo_search.cli import options
from topo_search.cli.errors import command, needs_extras, note
from topo_search.limits import LIMITS
from topo_search.supervisor import ExitStatus

if TYPE_CHECKING:
    from topo_search.report.task_warnings import TaskWarning


@command(epilog="Example: topo-search run push --paper --out push-paper", resumes=True)
@click.argument("task")
@options.modules
@options.set_field
@options.paper
@options.choice(
    "--maximize",
    ["force_reserve", "torque_reserve", "load", "payload"],
    "Find the platform with the largest value of a quantity, not of least effort; sets search.maximize.",
)
@options.choice(
    "--symmetry",
    ["task", *options.SYMMETRIES],
    "Symmetries under which trees count as one candidate; `task`: all that are exact for the task.",
    default="task",
)
@options.choice(
    "--strategy",
    ["exhaustive", "randomized", "optuna"],
    "Solve all candidates (default, if it takes less than a day), ask each for more than the best value so far "
    "(default with --maximize), or solve those that a sampler proposes.",
)
@options.choice(
    "--sampler",
    ["moves", "tpe", "nsga2", "random"],
    "Sampling algorithm: moves on the best trees so far (default), TPE, NSGA-II, or uniform draws.",
)
@options.whole_number(
    "--trials",
    (1, LIMITS.trials),
    "Number of candidates to propose (default: 512); if fewer exist, all are solved with all starts.",
)
@options.whole_number(
    "--round",
    (1, LIMITS.round),
    "Proposals that may be pending at a time (default: 8). More keep more workers busy but learn later.",
    "round_size",
)
@options.flag("--prune", "Skip candidates that the lower bound proves no better than the best design so far.")
@options.real_number(
    "--prove",
    LIMITS.gaps,
    "Then prove by branch and bound that no design is better by more than this relative gap; see `prove`.",
    metavar="GAP",
)
@options.real_number(
    "--keep-within",
    (0, LIMITS.percent),
    "Keep clear local optima with up to this much more effort than the best, in the folder `optima`.",
    metavar="PERCENT",
)
@options.starts("Starts per topology (default: by the number of modules).")
@options.seed
@options.workers
@options.dask
@click.option("--out", type=options.PATH, help="The run's folder (default: runs/NAME-HASH).")
@options.root
@options.connectors
@options.time_limit()
@options.topologies
@options.near
@options.flag("--live", "Serve the page while the search runs, to this machine only.")
@options.as_json
def run(
    task: str,
    modules: str | None,
    settings: tuple[str, ...],
    paper: bool,
    maximize: str | None,
    root: str | None,
    connectors: str | None,
    topologies: str | None,
    near: tuple[str, ...],
    **option_values: Any,
) -> None:
    """Search the topologies for TASK (a file, or the name of a shipped example) and audit the best.

    Run the same command again to resume a stopped run, or to print the answer of a finished one.
    Warnings about the task (see `check`) go to stderr first.

    Exit status: 0 audited design found; 1 designs found, but none passed its audit;
    2 bad input; 3 no design found, with the reasons; 4 --prove left some trees open; 70 workers or the Dask
    scheduler do not start, answer or return (results are kept; run the same command to continue); 74 the disk is
    full or fails, or the folder was removed (the best design is then printed).
    """
    sampled, prune = option_values["strategy"] == "optuna", option_values["prune"]
    if not sampled and (option_values["sampler"] or option_values["trials"] or option_values["round_size"]):
        raise click.UsageError("--sampler, --trials and --round require --strategy optuna")
    if prune and sampled:
        raise click.UsageError("--prune requires --strategy exhaustive")
    if prune and option_values["keep_within"] is not None:
        raise click.UsageError("--keep-within solves all candidates and cannot be combined with --prune")
    if topologies and sampled:
        raise click.UsageError("--topologies requires --strategy exhaustive: all listed trees are solved")
    from topo_search.report.shown import visible_progress

    warnings: list[TaskWarning] = []
    with _print_if_lost(warnings), visible_progress(tell=note) as observer, needs_extras("--dask"):
        fields = {"modules": modules, "search__root": root, "search__connectors": connectors}
        fields["search__maximize"] = maximize
        user_task = options.task_of(task, settings, paper=paper, **fields)
        keys = None if topologies is None else options.read_topologies(topologies, user_task)
        designs = options.read_near(near)
        warnings += options.warn(user_task)
        keywords = options.without_none(option_values)
        with catch_warnings(action="ignore", category=ts.SuspiciousTask):  # just printed
            answer = ts.search(user_task, near=designs, topologies=keys, observer=observer, **keywords)
    from topo_search.cli.tables import answer_lines

    options.echo_answer(answer_as_json(answer, warnings), answer_lines(answer))
    unproven = option_values["prove"] is not None and answer.best is not None and not answer.proven
    raise SystemExit(ExitStatus.OPEN if unproven else answer.exit_status)


@contextmanager
def _print_if_lost(warnings: Sequence[TaskWarning]) -> Iterator[None]:
    """Print the results, best design included, if the run's folder vanishes, so that they are not lost."""
    try:
        yield
    except ts.LedgerLost as lost:
        if lost.answer is not None:
            from topo_search.cli.tables import result_lines

            design, lines = lost.design, [*result_lines(lost.answer)]
            if design is not None and lost.answer.best is None:
                lines.append(f"best design so far, not audited: {design.topology.key}")
            value = answer_as_json(lost.answer, warnings) | {
                "exit_status": ExitStatus.INPUT_OUTPUT,
                "design": design and design.model_dump(mode="json"),
            }
            options.echo_answer(value, lines if design is None else [*lines, ts.to_json(design).rstrip("\n")])
        raise


def answer_as_json(answer: ts.Answer, warnings: Sequence[TaskWarning]) -> dict[str, Any]:
    """Return an answer, and the warnings about its task, as a JSON value."""
    value = {
        "folder": str(answer.folder),
        "exit_status": answer.exit_status,
        "best": answer.best and asdict(answer.best),
        "fragile": [entry.model_dump(mode="json") for entry in answer.fragile],
        "note": answer.note,
        "weakest_point": answer.weakest_point,
        "placement": answer.placement,
        "air": answer.air,
        "fast_air": [air.model_dump(mode="json") for air in answer.fast_air],
        "tolerances": answer.tolerances,
        "sizes": [_size_as_json(size) for size in answer.sizes],
        "warnings": [warning._asdict() for warning in warnings],
    }
    if not answer.levels:
        return value
    levels = [
        {
            "number": outcome.number,
            "level": outcome.level._asdict(),
            "sizes": [_size_as_json(size) for size in outcome.sizes],
        }
        for outcome in answer.levels
    ]
    return {**value, "levels": levels, "front": [point.cells for point in answer.points]}


def _size_as_json(size: ts.SizeAnswer) -> dict[str, Any]:
    relaxed = size.relaxed and size.relaxed.model_dump(mode="json")
    return {**asdict(size), "relaxed": relaxed, "objective": size.objective.least}
