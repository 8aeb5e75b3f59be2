"""`topo-search experiment`: the paper's studies and further ones."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

import topo_search as ts
from topo_search.cli import options
from topo_search.cli.errors import command, note
from topo_search.limits import LIMITS

NAMES = ("scaling", "ablation", "placement", "root", "body", "hinges")


def _parse(kind: Callable[[str], Any], largest: float, text: str) -> tuple[Any, ...]:
    """Return different positive numbers of one type from `A,B,...`; ValueError if it is anything else."""
    numbers = tuple(dict.fromkeys(map(kind, text.split(","))))
    if not all(0 < number <= largest for number in numbers):
        raise ValueError
    return numbers


def _numbers(option: str, kind: Callable[[str], Any], largest: float, text: str, form: str) -> Callable[..., Any]:
    """Return an option for positive comma-separated numbers of one type."""

    def parse(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[Any, ...] | None:
        try:
            return None if value is None else _parse(kind, largest, value)
        except ValueError:
            rule = f"must be {form}, each above 0 and at most {largest:,}, but got {value!r:.80}"
            raise click.BadParameter(rule, context, parameter) from None

    return click.option(option, callback=parse, metavar=form, help=text)


def _tasks(texts: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
    """Return the sizes of each task from texts such as `ten-wrenches:10,20`."""
    tasks: dict[str, tuple[int, ...]] = {}
    for text in texts:
        name, _, sizes = text.partition(":")
        try:
            tasks[name] = tasks.get(name, ()) + _parse(int, LIMITS.modules, sizes)
        except ValueError:
            rule = f"must be TASK:N,N,..., each N at most {LIMITS.modules}, but got {text:.80}"
            raise ts.BadInput("--task", rule) from None
    return tasks


@command(
    epilog="Example: topo-search experiment ablation --sizes 10,20 --topologies 5 --out ablation", resumes=True
)
@click.argument("name", type=click.Choice(NAMES))
@click.option("--out", type=options.PATH, required=True, help="The experiment's folder.")
@options.flag("--small", "Use small settings that finish in seconds.")
@click.option(
    "--task",
    "tasks",
    multiple=True,
    metavar="TASK:N,...",
    help="A shipped example and its sizes (repeatable; default: the experiment's).",
)
@_numbers("--sizes", int, LIMITS.modules, "Sizes for all tasks.", "N,...")
@_numbers(
    "--topologies",
    int,
    LIMITS.trees,
    "Trees per size; a second number holds above 40 modules (default: the experiment's).",
    "M[,M]",
)
@_numbers("--distances", float, 1e6, "Connector distances in m (default: the task's).", "D,...")
@options.starts("Starts per topology (default: the experiment's).")
@options.seed
@options.workers
@options.time_limit(
    "CPU time per topology after which no further start begins; scaling and ablation only (default: 600)."
)
@options.picture("Draw the results as a .png, .svg or .pdf")
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
    from dataclasses import replace

    from topo_search.experiments import conduct
    from topo_search.experiments import experiment as find_experiment
    from topo_search.report.shown import visible_progress

    study = find_experiment(name)
    settings = study.small if small else study.full
    if topologies is not None and len(topologies) > 2:
        raise ts.BadInput("--topologies", f"must be one or two numbers, but got {len(topologies)}")
    task_sizes = _tasks(tasks) or dict(settings.tasks)
    option_values["tasks"] = tuple((task, sizes or its_own) for task, its_own in task_sizes.items())
    option_values["topologies"] = topologies and (topologies[0], topologies[-1])
    settings = replace(settings, **options.without_none(option_values))
    if picture is not None:
        options.require_drawable(picture)
    with visible_progress(incumbent=False, tell=note) as observer:
        rows = conduct(study, settings, out, workers=workers, observer=observer)
    failed = rows["status"] == "failed"
    answered = rows[~failed]  # a failed cell does not mean that no design exists
    if answered.empty:
        raise ts.WorkersLost(f"all {len(rows)} cells failed: {rows['worst_constraint'].iloc[0]}")
    lines = [f"all rows are in {out / 'results.csv'}"]
    if failed.any():
        number = f"{failed.sum()} of {len(rows)} cells"
        lines.append(f"{number} failed and are left out; run the command again to retry them")
    if picture is not None:
        from matplotlib import style

        from topo_search.export import PAPER
        from topo_search.export.picture import save

        with style.context(PAPER):
            save(study.figure(answered), picture)
        lines.append(f"the picture is in {picture}")
    summary = study.summary(answered)
    table = summary.astype(object).where(summary.notna(), None).to_dict(orient="records")
    text = summary.to_string(index=False, line_width=200, float_format=lambda value: f"{value:.3g}")
    value = {"folder": str(out), "summary": table, "failed": int(failed.sum())}
    options.echo_answer(value, [text, *lines])
