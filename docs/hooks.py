"""Parts of the site that are generated at build time: pictures, gallery, commands, tables, schemas."""

from __future__ import annotations

import ast
import inspect
import json
import tomllib
from functools import partial
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any

import pandas as pd
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from topo_search.cli import GROUPS
from topo_search.compose.binding import BACKENDS
from topo_search.compose.referee import best_known, tightest_bound
from topo_search.limits import LIMITS, Limits
from topo_search.model.largest_value import objective_of
from topo_search.model.task_file import examples, read_task, task_template
from topo_search.simulation.result import FlightResult, ScenarioResult, word

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "notebooks/pictures"
RESULTS = ROOT / "notebooks/results"
BENCHMARKS = ROOT / "tests/benchmarks/README.md"
SCHEMAS = ROOT / "topo_search/schemas"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pictures that notebooks draw, and the JSON schemas."""
    for picture in sorted((*PICTURES.glob("*.png"), *PICTURES.glob("*.webp"))):
        files.append(File.generated(config, f"pictures/{picture.name}", abs_src_path=str(picture)))
    for schema in sorted(SCHEMAS.glob("*.json")):
        files.append(File.generated(config, f"schemas/{schema.name}", abs_src_path=str(schema)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Replace comments that name generated content, `<!-- commands -->`, by that content."""
    for mark, generate in GENERATED.items():
        if f"<!-- {mark} -->" in markdown:
            markdown = markdown.replace(f"<!-- {mark} -->", generate())
    return markdown


def _benchmarks() -> str:
    return BENCHMARKS.read_text(encoding="utf-8").partition("\n")[2]


def _reading_path() -> str:
    """Return a table of the core's files in the order of its contract, with the first lines of their docstrings."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    (contract,) = (each for each in settings["contracts"] if each["name"] == "core imports no feature")
    rows = ["| file | |", "|---|---|"]
    for module in contract["source_modules"]:
        path = ROOT / module.replace(".", "/")
        file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        docstring = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
        rows.append(f"| `{file.relative_to(ROOT)}` | {docstring.partition(chr(10))[0]} |")
    return "\n".join(rows)


def _commands() -> str:
    """Return a table per group of commands, in the order of work."""
    tables = []
    for title, commands in GROUPS.items():
        summaries = {command.name: (command.help or "").partition("\n\n")[0] for command in commands}
        rows = [f"| `topo-search {name}` | {summary} |" for name, summary in summaries.items()]
        tables.append("\n".join([f"| {title} | |", "|---|---|", *rows]))
    return "\n\n".join(tables)


def _limits() -> str:
    """Return a table of the limits, each with its docstring."""
    (limits,) = (node for node in ast.parse(inspect.getsource(Limits)).body if isinstance(node, ast.ClassDef))
    rows = ["| limit | at most | |", "|---|---|---|"]
    for field, docstring in pairwise(limits.body):
        if isinstance(field, ast.AnnAssign) and isinstance(docstring, ast.Expr):
            name, values = ast.unparse(field.target), getattr(LIMITS, ast.unparse(field.target))
            shown = ", ".join(f"{value:,}" for value in (values if isinstance(values, tuple) else [values]))
            rows.append(f"| `{name}` | {shown} | {' '.join(ast.literal_eval(docstring.value).split())} |")
    return "\n".join(rows)


def _task_file() -> str:
    return f"```toml\n{task_template('my-task', full=True)}```"


def _gallery() -> str:
    results = json.loads((RESULTS / "gallery.json").read_text(encoding="utf-8"))
    return "\n".join(_example(name, results.get(name)) for name in examples())


def _benchmark() -> str:
    """Return a table of the best known designs of the shipped tasks, and their proven bounds."""
    rows = [
        "| task | modules | best known | tree | proven of all platforms of that size |",
        "|---|---|---|---|---|",
    ]
    folder = resources.files("topo_search") / "examples" / "best"
    for file in sorted(entry.name for entry in folder.iterdir()):
        name, _, n = file.removesuffix(".json").rpartition("-")
        known = best_known(name, int(n))
        assert known is not None
        task, rated = read_task(name, (f"modules={n}",)).resolve(int(n)), objective_of(known.task)
        closed_form = BACKENDS.lower_bound(task.with_closures(len(known.topology.closures)))
        bound = rated.claim(tightest_bound(known, closed_form))
        rows.append(f"| `{name}` | {n} | {rated.words(known, 5)} | `{known.topology.key}` | {bound} |")
    return "\n".join(rows)


def _example(name: str, result: dict[str, Any] | None) -> str:
    """Return an example's lesson (its first comment), command, CPU time, answer, picture and file."""
    text = (resources.files("topo_search") / "examples" / f"{name}.toml").read_text(encoding="utf-8")
    lesson = text.splitlines()[0].removeprefix("# ")
    parts = [f"## {name}", lesson, f"```sh\ntopo-search run {name}{result['options'] if result else ''}\n```"]
    if result is not None:
        parts.append(
            f"{result['modules']} modules, {result['candidates']} candidates, {result['cpu_seconds']} s of CPU "
            f"time. Best design: `{result['key']}`, audit {result['audit']}; "
            f"no platform of that size {result['claim']}."
        )
        alt = f"The best platform found for {name}: its airflow, a close-up and its tree"
        parts.append(f"![{alt}](pictures/gallery-{name}.png)")
    file = f"```toml\n{text}```".splitlines()
    parts.append(f'??? note "{name}.toml"\n\n' + "\n".join(f"    {line}" for line in file))
    return "\n\n".join(parts) + "\n"


def _flight(name: str) -> str:
    """Return the table and plot of a stored flight, and its reserves in hover."""
    result = _read_flight(name)
    columns = ("scenario", "outcome", "error", "tilt", "force error", "at largest thrust", "reason")
    head = f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|"
    rows = "\n".join(_scenario_row(scenario) for scenario in result.scenarios)
    summary = (
        f"In hover the platform can push sideways with {100 * result.weakest_force_share:.3g} % of its weight in "
        f"the weakest direction; it {result.statics}."
    )
    plot = f"![Error, tilt and largest thrust of every flight](../pictures/flight-{name}.png)"
    return f"{head}\n{rows}\n\n{summary}\n\n{plot}"


def _flights(*names: str) -> str:
    """Return a table with a row per design: the worst of all its flights."""
    columns = (
        "design",
        "side force",
        "return takes",
        "drift in hover",
        "force error",
        "at largest thrust",
        "rotor dies",
    )
    head = f"| {' | '.join(columns)} | |\n{'|---' * (len(columns) + 1)}|"
    return "\n".join([head, *(_design_row(name, _read_flight(name)) for name in names)])


def _design_row(name: str, result: FlightResult) -> str:
    by_name = {flight.name: flight for flight in result.scenarios}
    return_times = [flight.settled_s for flight in result.scenarios if flight.name.startswith("return")]
    counting = [flight for flight in result.scenarios if flight.counts]
    force_errors = [flight.force_error_share for flight in counting if flight.force_error_share is not None]
    saturation = max(flight.saturated_share or 0.0 for flight in counting)
    cells = (
        *(name, f"{100 * result.weakest_force_share:.2g} % of the weight"),
        "never" if None in return_times else f"{max(s or 0.0 for s in return_times):.2g} s",
        f"{100 * (by_name['hover'].drift_m or 0.0):.2f} cm",
        f"{100 * max(force_errors):.1f} %" if force_errors else "not flown",
        *(f"{100 * saturation:.1f} % of the time", word(result.scenarios[-1]), f"**{word(result)}**"),
    )
    return f"| {' | '.join(cells)} |"


def _requirements() -> str:
    """Return two tables of the best designs of flying tasks: certified figures, and simulated flights."""
    rows = pd.read_csv(RESULTS / "flights.csv", dtype=str, keep_default_na=False).to_dict("records")
    lines = ["| task, modules | required | effort | tip | centre of mass | tilt | turn |", f"|{'---|' * 7}"]
    for row in rows:
        cells = [_task_cells(row), row["effort"].replace("e+", "e") or "no design"]
        for column in ("tip", "com", "tilt_deg", "angular_acceleration_rad_s2"):
            pair = [row[f"{column}{suffix}"] for suffix in ("", "_pseudo_inverse")]
            cells.append("; ".join(f"{float(x):.2g}" for x in pair if x))
        lines.append(f"| {' | '.join(cells)} |")
    lines += [
        "",
        "| task, modules | required | least squares: gusts, tilts | PX4's rule: gusts, tilts |",
        "|---|---|---|---|",
    ]
    for row in rows:
        cells = [f"{row[f'{rule}_gust']}, {row[f'{rule}_tilt']}" for rule in ("bounded", "px4") if row["tree"]]
        lines.append(f"| {' | '.join([_task_cells(row), *(cells or ['', ''])])} |")
    return "\n".join(lines)


def _task_cells(row: dict[Any, Any]) -> str:
    return f"`{row['task']}`, {row['modules']} | {REQUIREMENTS[row['required']]}"


def _read_flight(name: str) -> FlightResult:
    return FlightResult.model_validate_json((RESULTS / f"flight-{name}.json").read_text(encoding="utf-8"))


def _scenario_row(scenario: ScenarioResult) -> str:
    numbers = (
        (scenario.drift_m, 100.0, " cm"),
        (scenario.tilt_deg, 1.0, " deg"),
        (scenario.force_error_share, 100.0, " %"),
        (scenario.saturated_share, 100.0, " %"),
    )
    cells = ["" if value is None else f"{scale * value:.2f}{unit}" for value, scale, unit in numbers]
    return f"| {' | '.join((scenario.name, word(scenario), *cells, scenario.reason or ''))} |"


REQUIREMENTS = {
    "reserves": "reserves at the tip",
    "centred": "as shipped, without `com_error`",
    "task": "as shipped",
    "pseudo-inverse": "as shipped, with the pseudo-inverse",
}
GENERATED = {
    "reading path": _reading_path,
    "flights of requirements": _requirements,
    "benchmarks": _benchmarks,
    "commands": _commands,
    "limits": _limits,
    "task file": _task_file,
    "benchmark": _benchmark,
    "gallery": _gallery,
    "flight of push": partial(_flight, "push-a70010"),
    "flight of wall-push": partial(_flight, "wall-push"),
    "flights without reserves": partial(_flights, "push-a70010", "wall-push-without-reserves"),
    "flights of examples": partial(_flights, "wall-push", "window-cleaning", "survives-a-rotor"),
}
