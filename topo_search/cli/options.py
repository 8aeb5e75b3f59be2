"""Options that several commands share, and how they change a task."""

from __future__ import annotations

import functools
import json
import math
import re
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from topo_search.cli.errors import needs_extras, note
from topo_search.limits import LIMITS

if TYPE_CHECKING:
    from topo_search.model import Design, Task
    from topo_search.model.task_warnings import TaskWarning

SYMMETRIES = ("none", "c2", "d2", "c4", "d4")


class Real(click.FloatRange):
    """A range of numbers; NaN, which lies in every range, is refused."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number that a text stands for."""
        read = super().convert(value, param, ctx)
        if math.isnan(read):
            self.fail("must be a number, but got nan", param, ctx)
        return read


def real_number(
    option: str, within: tuple[float, float | None], text: str, *names: str, above: bool = False, **rest: Any
) -> Callable[..., Any]:
    """Return the option for a number in a range; `above`: its lower end is not allowed."""
    return click.option(option, *names, type=Real(*within, min_open=above), help=text, **rest)


def whole_number(
    option: str, within: tuple[int, int | None], text: str, *names: str, **rest: Any
) -> Callable[..., Any]:
    """Return the option for a whole number in a range."""
    return click.option(option, *names, type=click.IntRange(*within), help=text, **rest)


def choice(option: str, values: Sequence[str], text: str, **rest: Any) -> Callable[..., Any]:
    """Return the option for one of some words."""
    return click.option(option, type=click.Choice(values), help=text, **rest)


PATH = click.Path(path_type=Path)
FILE = click.Path(path_type=Path, dir_okay=False)


set_field = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="FIELD=VALUE",
    help="Override a field of the task, e.g. search.margin=1e-3 (repeatable).",
)
seed = whole_number("--seed", (0, LIMITS.largest_integer), "Seed of all random numbers.", default=0)
workers = whole_number("--workers", (1, LIMITS.workers), "Worker processes (default: the cores available).")
connectors = choice(
    "--connectors", ["aligned", "any"], "Ports by which a child may be joined: the opposite one only, or any."
)
root = choice("--root", ["free", "paper"], "Root orientation: free, or limited to the paper's two angles.")
paper = click.option(
    "--paper", is_flag=True, help="The paper's literal problem: its root, no margin, no body clearance, no rod."
)
as_json = click.option(
    "--json",
    is_flag=True,
    expose_value=False,
    callback=lambda context, _, chosen: context.meta.update(json=chosen),
    help="Print the answer as JSON.",
)


near = click.option(
    "--near",
    multiple=True,
    metavar="DESIGN.json",
    help="Add starts from this design of any tree, written by a run or `solve` (repeatable).",
)
topologies = click.option(
    "--topologies",
    metavar="FILE",
    help="Solve only the trees in this file, one key per line as `topologies` prints them; each as given.",
)


def starts(text: str) -> Callable[..., Any]:
    """Return the option for the number of starts; its default is not the same everywhere."""
    return whole_number("--starts", (1, LIMITS.starts), text)


def time_limit(
    text: str = "Stop after this time with the best design so far, audited; every tree gets a few starts first.",
) -> Callable[..., Any]:
    """Return the option for the time after which a command stops."""
    return real_number("--time-limit", (0, LIMITS.seconds), text, above=True, metavar="SECONDS")


def out(option: str, name: str, text: str, **rest: Any) -> Callable[..., Any]:
    """Return an option for a file to write beside what is printed."""
    return click.option(option, name, type=FILE, metavar="FILE", help=text, **rest)


def _sizes(context: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    """Turn `5` or `4-6` into the value of a task's field."""
    if value is None:
        return None
    match = re.fullmatch(r"(\d+)(?:-(\d+))?", value)
    if match is None:
        raise click.BadParameter(f"must be N or LO-HI, but got {value!r}", context, parameter)
    return match[1] if match[2] is None else f"[{match[1]}, {match[2]}]"


modules = click.option("--modules", callback=_sizes, metavar="N|LO-HI", help="Number of modules.")


def dask(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options for a Dask cluster; the command gets the certificates as `dask_tls`."""

    @functools.wraps(command)
    def with_certificates(
        *, dask: str | None, dask_ca: Path | None, dask_cert: Path | None, dask_key: Path | None, **others: Any
    ) -> None:
        tls = None
        if dask_ca or dask_cert or dask_key:
            if dask is None:
                raise click.UsageError("--dask-ca, --dask-cert and --dask-key require --dask")
            if not (dask_ca and dask_cert and dask_key):
                raise click.UsageError("--dask-ca, --dask-cert and --dask-key must be given together")
            from topo_search.engine import Certificates

            tls = Certificates(dask_ca, dask_cert, dask_key)
        command(dask=dask, dask_tls=tls, **others)

    function: Callable[..., Any] = with_certificates
    for name, text in (
        ("key", "client private key (PEM)"),
        ("cert", "client certificate (PEM)"),
        ("ca", "certificate (PEM) of the signing authority"),
    ):
        function = click.option(f"--dask-{name}", type=PATH, metavar="FILE", help=f"With tls://: {text}.")(function)
    return click.option(
        "--dask", metavar="tcp|tls://HOST:PORT", help="Dask scheduler whose workers solve the candidates."
    )(function)


def without_none(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options that have a value: a function called with them has its own defaults for the others."""
    return {name: value for name, value in options.items() if value is not None}


def task_of(task: str, settings: tuple[str, ...], *, paper: bool = False, **fields: str | None) -> Task:
    """Return the task that the command line names, with everything that its options set.

    Args:
        task: a file, or the name of a shipped example.
        settings: those of `--set`.
        paper: whether the paper's literal problem is asked for.
        fields: what other options stand for; dots are written as two underscores.

    Raises:
        BadInput: the task is wrong, or something else sets what `--paper` sets.
    """
    from topo_search.compose.binding import enclose_speed
    from topo_search.model import BadInput, Fault
    from topo_search.model.files import read_task
    from topo_search.model.text import PAPER

    changes = (*settings, *(f"{name.replace('__', '.')}={value}" for name, value in without_none(fields).items()))
    if not paper:
        return enclose_speed(read_task(task, changes))
    if twice := [setting for setting in changes if _meets(setting, PAPER)]:
        raise BadInput("--paper", [Fault("", f"sets this field itself, but got {setting}") for setting in twice])
    posed = enclose_speed(read_task(task, (*changes, *PAPER)))
    if posed.goals.clearance:
        rule = f"must be left out with --paper, whose margin is 0, but got {list(posed.goals.clearance)}"
        raise BadInput(task, [Fault("goals.clearance", rule)])
    return posed


def read_near(files: tuple[str, ...]) -> list[Design]:
    """Return the designs of some files; BadInput names every fault."""
    from topo_search.compose import read_completed

    return [read_completed(file) for file in files]


def read_topologies(file: str, task: Task) -> tuple[str, ...]:
    """Return the keys of a file that lists the candidates of a task.

    Raises:
        BadInput: it cannot be read or is too long; or names every line that is no key, or not one of the task.
    """
    from topo_search.model.files import load_text
    from topo_search.topologies import own_candidates

    lines = enumerate(load_text(file, most_bytes=LIMITS.keys_bytes).splitlines(), start=1)
    keys = [(number, key) for number, line in lines if (key := line.strip())]
    places = {k: f"line {number}" for k, (number, _) in enumerate(keys)}
    return own_candidates([key for _, key in keys], task, source=file, places=places)


def warn(task: Task) -> tuple[TaskWarning, ...]:
    """Print the warnings about a task, as `check` does, on stderr; and return them."""
    from topo_search.model.task_warnings import task_warnings

    warnings = task_warnings(task)
    for warning in warnings:
        note(f"warning: {warning}")
    return warnings


def _meets(setting: str, others: tuple[str, ...]) -> bool:
    """True if a setting sets a field that one of others sets too, or a table with it."""
    from topo_search.model.text import field_of

    mine = field_of(setting)
    return bool(mine) and any(all(a == b for a, b in zip(mine, field_of(other), strict=False)) for other in others)


def is_json() -> bool:
    """True if the command was given `--json`."""
    return bool(click.get_current_context().meta["json"])


def echo_answer(value: Any, lines: Iterable[str]) -> None:
    """Print an answer: with `--json` as a JSON value, otherwise as lines."""
    echo_lines([json.dumps(value, indent=1, allow_nan=False)] if is_json() else lines)


def echo_lines(lines: Iterable[str]) -> None:
    """Print lines, each as soon as it is there."""
    for line in lines:
        click.echo(line)


def echo_json_list(values: Iterable[Any]) -> None:
    """Print values as a JSON list, each as soon as it is there."""
    before = "[\n "
    for value in values:
        click.echo(f"{before}{json.dumps(value, allow_nan=False)}", nl=False)
        before = ",\n "
    click.echo("[]" if before.startswith("[") else "\n]")


def picture(text: str) -> Callable[..., Any]:
    """Return the option for a picture; `require_drawable` refuses what cannot be drawn."""
    return click.option("--picture", type=FILE, metavar="FILE", help=f"{text}; needs the extra `viz`.")


def require_drawable(out: Path) -> None:
    """Refuse a picture that cannot be drawn, before any work is done for it."""
    from topo_search.model import BadInput

    if out.suffix.lower() not in (".png", ".svg"):
        raise BadInput("--picture", f"must end in .png or .svg, but got {out.name}")
    require_writable(out, "--picture")
    with needs_extras("--picture"):
        import matplotlib  # noqa: F401 (pandas and numpy are always there, it is not)


def require_writable(out: Path | None, option: str = "--out") -> None:
    """Refuse a file that cannot be written, if one is asked for, before any work is done for it; none is left."""
    from topo_search.model import BadInput

    if out is None:
        return
    folder = out.parent
    try:
        if out.exists() and not out.is_file():  # a device: its name would be taken by a file
            raise BadInput(option, f"must be a regular file if it exists, but got {out}")
        while not folder.exists():
            folder = folder.parent
        with tempfile.NamedTemporaryFile(dir=folder, prefix=f".{out.name}."):  # as `write_atomically` names it
            pass
    except OSError as error:
        raise BadInput(option, f"must be writable, but got {out} ({folder}: {error.strerror})") from None
