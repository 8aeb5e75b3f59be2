"""Options that several commands share, and the task that they define."""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import topo_search as ts
from topo_search.cli.errors import needs_extras, note
from topo_search.limits import LIMITS

if TYPE_CHECKING:
    from topo_search.report.task_warnings import TaskWarning

SYMMETRIES = ("none", "c2", "d2", "c4", "d4")


class Real(click.FloatRange):
    """A range of numbers; NaN, which lies in every range, is refused."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert a text to a number."""
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail("must be a number, but got nan", param, ctx)
        return number


def real_number(
    option: str, within: tuple[float, float | None], text: str, *names: str, above: bool = False, **settings: Any
) -> Callable[..., Any]:
    """Return an option for a number in a range; `above` excludes the lower limit."""
    return click.option(option, *names, type=Real(*within, min_open=above), help=text, **settings)


def whole_number(
    option: str, within: tuple[int, int | None], text: str, *names: str, **settings: Any
) -> Callable[..., Any]:
    """Return an option for a whole number in a range."""
    return click.option(option, *names, type=click.IntRange(*within), help=text, **settings)


def choice(option: str, values: Sequence[str], text: str, **settings: Any) -> Callable[..., Any]:
    """Return an option for one of several words."""
    return click.option(option, type=click.Choice(values), help=text, **settings)


def flag(option: str, text: str, *names: str) -> Callable[..., Any]:
    """Return an option that is given or not."""
    return click.option(option, *names, is_flag=True, help=text)


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
    "--connectors", ["aligned", "any"], "Ports by which a child may be attached: only the opposite one, or any."
)
root = choice("--root", ["free", "paper"], "Root orientation: free, or limited to the paper's two angles.")
paper = flag("--paper", "The paper's literal problem: its root, no margin, no body clearance, no rod.")
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
    help="Also start from this design of any tree, written by a run or `solve` (repeatable).",
)
topologies = click.option(
    "--topologies",
    metavar="FILE",
    help="Solve only the trees in this file, one key per line as `topologies` prints them; each as given.",
)


def starts(text: str) -> Callable[..., Any]:
    """Return the option for the number of starts; `text` states the command's default."""
    return whole_number("--starts", (1, LIMITS.starts), text)


def time_limit(
    text: str = "Stop after this time with the best design so far, audited; every tree gets a few starts first.",
) -> Callable[..., Any]:
    """Return the option for the time after which a command stops."""
    return real_number("--time-limit", (0, LIMITS.seconds), text, above=True, metavar="SECONDS")


def out(option: str, name: str, text: str, **settings: Any) -> Callable[..., Any]:
    """Return an option for a file to write in addition to the printed output."""
    return click.option(option, name, type=FILE, metavar="FILE", help=text, **settings)


def _sizes(context: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    """Convert `5` or `4-6` to a value of the field `modules` of a task."""
    if value is None:
        return None
    match = re.fullmatch(r"(\d+)(?:-(\d+))?", value)
    if match is None:
        raise click.BadParameter(f"must be N or LO-HI, but got {value!r}", context, parameter)
    return match[1] if match[2] is None else f"[{match[1]}, {match[2]}]"


def _counts(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[int, ...]:
    """Convert `5,1` to numbers of modules."""
    if value is None:
        return ()
    if not re.fullmatch(r"[1-9]\d{0,8}(,[1-9]\d{0,8}){0,25}", value):
        rule = "must be 1 to 26 numbers of modules, each at least 1, separated by commas"
        raise click.BadParameter(f"{rule}, but got {value!r}", context, parameter)
    return tuple(map(int, value.split(",")))


types = click.option(
    "--types",
    callback=_counts,
    metavar="N,N,...",
    help="Numbers of modules of each type: 5,1 for five of type a and one of type b.",
)
modules = click.option("--modules", callback=_sizes, metavar="N|LO-HI", help="Number of modules.")


dask = click.option(
    "--dask", metavar="tcp|tls://HOST:PORT", help="Dask scheduler whose workers solve the candidates."
)


def without_none(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options that have a value, so that a function called with them keeps its other defaults."""
    return {name: value for name, value in options.items() if value is not None}


def task_of(task: str, settings: tuple[str, ...], *, paper: bool = False, **fields: str | None) -> ts.Task:
    """Return the task named on the command line, with the changes that options make to it.

    Args:
        task: a file, or the name of a shipped example.
        settings: values of `--set`, each FIELD=VALUE.
        paper: True for the paper's literal problem.
        fields: values of fields that other options set; two underscores in a name stand for a dot.

    Raises:
        BadInput: the task is invalid, or another option sets a field that `--paper` sets.
    """
    from topo_search.compose.binding import enclose_speed
    from topo_search.model.task_file import PAPER, read_task

    changes = (*settings, *(f"{name.replace('__', '.')}={value}" for name, value in without_none(fields).items()))
    if not paper:
        return enclose_speed(read_task(task, changes))
    if conflicts := [setting for setting in changes if _conflicts(setting, PAPER)]:
        faults = [ts.Fault("", f"sets this field itself, but got {setting}") for setting in conflicts]
        raise ts.BadInput("--paper", faults)
    literal = enclose_speed(read_task(task, (*changes, *PAPER)))
    if literal.goals.clearance:
        rule = f"must be left out with --paper, whose margin is 0, but got {list(literal.goals.clearance)}"
        raise ts.BadInput(task, [ts.Fault("goals.clearance", rule)])
    return literal


def read_near(files: tuple[str, ...]) -> list[ts.Design]:
    """Return the designs in some files; BadInput names every fault of the first file that holds none."""
    from topo_search.compose import read_completed

    return [read_completed(file) for file in files]


def read_topologies(file: str, task: ts.Task) -> tuple[str, ...]:
    """Return the topology keys in a file, which become the candidates of a task.

    Raises:
        BadInput: the file cannot be read or is too long, or some lines hold no key of a topology of the task.
    """
    from topo_search.model.files import load_text
    from topo_search.topologies.own_topologies import own_candidates

    lines = enumerate(load_text(file, most_bytes=LIMITS.keys_bytes).splitlines(), start=1)
    keys = [(number, key) for number, line in lines if (key := line.strip())]
    line_names = {k: f"line {number}" for k, (number, _) in enumerate(keys)}
    return own_candidates([key for _, key in keys], task, source=file, places=line_names)


def warn(task: ts.Task) -> tuple[TaskWarning, ...]:
    """Print the warnings about a task, those of `check`, on stderr, and return them."""
    from topo_search.report.task_warnings import task_warnings

    warnings = task_warnings(task)
    for warning in warnings:
        note(f"warning: {warning}")
    return warnings


def _conflicts(setting: str, settings: tuple[str, ...]) -> bool:
    """True if a setting sets the same field as one of `settings`, or a table that contains it."""
    from topo_search.model.task_file import field_of

    path = field_of(setting)
    return bool(path) and any(all(a == b for a, b in zip(path, field_of(each), strict=False)) for each in settings)


def is_json() -> bool:
    """True if the command was given `--json`."""
    return bool(click.get_current_context().meta["json"])


def echo_answer(value: Any, lines: Iterable[str]) -> None:
    """Print an answer: with `--json` as a JSON value, otherwise as lines."""
    echo_lines([json.dumps(value, indent=1, allow_nan=False)] if is_json() else lines)


def echo_lines(lines: Iterable[str]) -> None:
    """Print lines, each as soon as it is computed."""
    for line in lines:
        click.echo(line)


def picture(text: str) -> Callable[..., Any]:
    """Return the option for a picture; check its value with `require_drawable`."""
    return click.option("--picture", type=FILE, metavar="FILE", help=f"{text}; needs the extra `viz`.")


def require_drawable(out: Path) -> None:
    """Raise BadInput if a picture could not be drawn, before any other work."""
    if out.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise ts.BadInput("--picture", f"must end in .png, .svg or .pdf, but got {out.name}")
    require_writable(out, "--picture")
    with needs_extras("--picture"):
        import matplotlib  # noqa: F401 (optional, unlike pandas and numpy)


def require_writable(out: Path | None, option: str = "--out") -> None:
    """Raise BadInput if an output file could not be written, before any other work; leave no file behind."""
    if out is None:
        return
    folder = out.parent
    try:
        if out.exists() and not out.is_file():  # writing would replace a device by a file
            raise ts.BadInput(option, f"must be a regular file if it exists, but got {out}")
        while not folder.exists():
            folder = folder.parent
        with tempfile.NamedTemporaryFile(dir=folder, prefix=f".{out.name}."):  # as in `write_atomically`
            pass
    except OSError as error:
        raise ts.BadInput(option, f"must be writable, but got {out} ({folder}: {error.strerror})") from None
