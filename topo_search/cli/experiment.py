"""`topo-search experiment`: the paper's studies and further ones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

import topo_search as ts
from topo_search.cli import options
from topo_search.cli.errors import command

NAMES = ("scaling", "ablation", "placement", "root", "body", "hinges")


def _numbers(kind: Callable[[str], Any]) -> Callable[..., Any]:
    """Return an option callback that parses `A,B,...` as numbers of one type."""

    def parse(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[Any, ...] | None:
        if value is None:
            return None
        try:
            return tuple(kind(part) for part in value.split(","))
        except ValueError:
            text = value if len(value) <= 80 else f"{value[:80]}..."
            rule = f"must be comma-separated numbers, but got {text!r}"
            raise click.BadParameter(rule, context, parameter) from None

    return parse


@command(
    epilog="Example: topo-search experiment ablation --sizes 10,20 --topologies 5 --out ablation", resumes=True
)
@click.argument("name", type=click.Choice(NAMES))
@click.option("--out", type=options.PATH, required=True, help="The experiment's folder.")
@click.option("--small", is_flag=True, help="Use small settings that finish in seconds.")
@click.option(
    "--task",
    "tasks",
    multiple=True,
    metavar="TASK:N,...",
    help="A shipped example and its sizes (repeatable; default: the experiment's).",
)
@click.option("--sizes", callback=_numbers(int), metavar="N,...", help="Sizes for all tasks.")
@click.option(
    "--topologies",
    callback=_numbers(int),
    metavar="M[,M]",
    help="Trees per size; a second number holds above 40 modules (default: the experiment's).",
)
@click.option(
    "--distances", callback=_numbers(float), metavar="D,...", help="Connector distances in m (default: the task's)."
)
@options.starts("Starts per topology (default: the experiment's).")
@options.seed
@options.workers
@options.time_limit(
    "CPU time per topology after which no further start begins; scaling and ablation only (default: 600)."
)
@options.picture("Draw the results as a .png or .svg")
@options.as_json
def experiment(
    name: str,
    out: Path,
    small: bool,
    tasks: tuple[str, ...],
    sizes: tuple[int, ...] | None,
    topologies: tuple[int, ...] | None,
    workers: int | None,
    picture: Path | None,
    **option_values: Any,
) -> None:
    """Run a study of the paper, or a further one, and write its results to a folder.

    \b
    scaling    time, memory and success against the number of modules
    ablation   how far airflow overlaps if only a minimum distance keeps modules apart
    placement  what an end-effector at the centre of mass costs
    root       what the paper's root orientation costs against a free one
    body       what body clearance costs
    hinges     what hinge angles from a set cost

    Without options a study runs at its full size, which takes hours. Run the same command to resume.

    Exit status: 0 done; 2 bad input; 70 all cells failed.
    """  # noqa: D301 (\b is click's)
    from topo_search.cli.progress import shown_progress
    from topo_search.experiments import Settings, conduct
    from topo_search.experiments import experiment as find_experiment

    study = find_experiment(name)
    settings = study.small if small else study.full
    task_sizes = tuple(Settings.task_of(text) for text in tasks) or settings.tasks
    if sizes is not None:
        task_sizes = tuple((task, sizes) for task, _ in task_sizes)
    if topologies is not None and len(topologies) > 2:
        rule = f"must be one or two numbers, but got {len(topologies)}"
        raise click.BadParameter(rule, param_hint="--topologies")
    tree_counts = None if topologies is None else (topologies[0], topologies[-1])
    settings = settings.override(tasks=task_sizes, topologies=tree_counts, **option_values)
    if picture is not None:
        options.require_drawable(picture)
    with shown_progress(incumbent=False) as observer:
        rows = conduct(study, settings, out, workers=workers, observer=observer)
    failed = rows["status"] == "failed"
    answered = rows[~failed]  # a failed cell does not mean that no design exists
    if answered.empty:
        raise ts.WorkersLost(f"all {len(rows)} cells failed: {rows['worst_constraint'].iloc[0]}")
    findings = study.findings(answered)
    if failed.any():
        number = f"{failed.sum()} of {len(rows)} cells"
        findings.append(f"{number} failed and are left out; run the command again to retry them")
    if picture is not None:
        from topo_search.export.picture import save

        save(study.figure(answered), picture)
    summary = study.summary(answered)
    table = summary.astype(object).where(summary.notna(), None).to_dict(orient="records")
    lines = [
        summary.to_string(index=False, line_width=200, float_format=lambda value: f"{value:.4g}"),
        *findings,
        f"all rows are in {out / 'results.csv'}",
        *([] if picture is None else [f"the picture is in {picture}"]),
    ]
    options.echo_answer({"folder": str(out), "summary": table, "findings": findings}, lines)
