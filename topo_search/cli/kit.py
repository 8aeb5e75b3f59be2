"""`topo-search kit`: one drawer of brackets for several tasks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from topo_search.cli import options
from topo_search.cli.errors import explain_errors, note
from topo_search.limits import LIMITS


@click.command(epilog="Example: topo-search kit push wall-push --out kit")
@click.argument("tasks", metavar="TASK|RUN...", nargs=-1, required=True)
@options.modules
@options.set_field
@click.option(
    "--within",
    type=options.Real(0, LIMITS.percent),
    default=2.0,
    show_default=True,
    metavar="PERCENT",
    help="Largest extra effort over the best design of a task.",
)
@click.option(
    "--bracket-tolerance",
    "tolerance_deg",
    type=options.Real(0, 10),
    default=0.0,
    show_default=True,
    metavar="DEG",
    help="Range of hinge angles that one bracket may serve, where designs with its middle are clear.",
)
@options.workers
@click.option("--out", type=options.PATH, required=True, metavar="DIR", help="A new or empty folder.")
@options.as_json
def kit(
    tasks: tuple[str, ...],
    modules: str | None,
    settings: tuple[str, ...],
    out: Path,
    as_json: bool,
    **option_values: Any,
) -> None:
    """Choose one design per task so that a few brackets build them all.

    TASK is a file or the name of a shipped example, which `run TASK --keep-within` searches first; RUN is the
    folder of a finished run. Candidates are clear designs with as many modules as the best one, within --within of
    its effort. The drawer has the fewest brackets; among those choices the fewest joints change from task to task,
    in the order given; then effort decides. A kind of bracket is the size of a hinge angle, to a thousandth of a
    degree; the drawer holds as many as the task that needs most of them. DIR gets `kit.json`, the page
    `index.html`, the drawer's `brackets` to print, a sheet per change and a kit per task, as from
    `export --format kit`.

    Exit status: 0; 2 bad input; 3 no common kit, because a run has no clear design.
    """
    folders = [task for task in tasks if Path(task).is_dir()]
    if folders and (modules or settings):
        raise click.UsageError(f"--modules and --set are for tasks, but {folders[0]} is the folder of a run")
    with explain_errors(resumes=True):
        from topo_search.cli.progress import shown_progress
        from topo_search.compose.drawer import NoCommonKit
        from topo_search.compose.drawer import kit as make_kit

        try:
            with shown_progress() as observer:
                shared = make_kit(
                    [
                        task if task in folders else options.task_of(task, settings, modules=modules)
                        for task in tasks
                    ],
                    out=out,
                    observer=observer,
                    note=note,
                    **option_values,
                )
        except NoCommonKit as error:
            note(str(error))
            raise SystemExit(3) from None
        if as_json:
            options.echo_json(shared.model_dump(mode="json"))
        else:
            options.echo_lines((*shared.lines, f"the kits are in {out}"))
