"""The page as one file: what it says, handed to a template that escapes every text, with plotly.js inside."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import jinja2
import plotly.graph_objects as go
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from topo_search.export import palette
from topo_search.report.charts import style
from topo_search.report.task_facts import Facts

SCRIPTS = ("figures.js", "labels.js", "view.js", "beside.js", "ranking.js", "page.js")
"""The page's own, in the order in which they run."""


@dataclass(frozen=True)
class Chart:
    """A figure with what it shows in words."""

    name: str
    """Of its element: letters, digits and dashes."""
    caption: str
    figure: go.Figure

    @property
    def data(self) -> Markup:
        """The figure as JSON inside a script element."""
        return in_script(style(self.figure).to_json())


@dataclass(frozen=True)
class View:
    """A design in 3-D, with what can be chosen to be shown of it."""

    name: str
    """Of its element: letters, digits and dashes."""
    caption: str
    value: dict[str, Any]
    """What the page's script draws it from."""
    cases: tuple[str, ...]
    """The load cases."""
    listed: bool
    """Whether they are so many that they are chosen from a list."""
    forces: bool
    """Whether the forces that can be added at the end-effector can be shown."""

    @property
    def data(self) -> Markup:
        """What the page's script draws it from, as JSON inside a script element."""
        return json_in_script(self.value)


@dataclass(frozen=True)
class Table:
    """A table with a heading a column."""

    columns: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    numeric: frozenset[int] = frozenset()
    """Columns of numbers, which are aligned to the right."""


@dataclass(frozen=True)
class Tile:
    """A figure of the headline."""

    name: str
    figure: str
    meaning: str
    """Of the figure, in a few words."""
    status: str = ""
    """A verdict that colours it; empty for none."""


@dataclass(frozen=True)
class TaskPart:
    """The task as understood."""

    facts: tuple[Facts, ...]
    load_cases: Table
    warnings: tuple[str, ...]
    """Warnings about it, a sentence each."""


@dataclass(frozen=True)
class FlightPart:
    """What a design can do beyond its task."""

    summary: str
    cases: Table
    sentences: tuple[str, ...]
    joints: Table | None
    """None for a single module."""


@dataclass(frozen=True)
class SimulatedPart:
    """What a design did in closed-loop simulation."""

    verdict: str
    """Of all flights: held or not held."""
    scenarios: Table
    course: Chart | None
    """None if nothing was flown."""
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class DesignPart:
    """All that is shown of one design."""

    heading: str
    view: View
    tree: Markup
    joints: Table
    rod: str | None
    """What holds the end-effector, in a sentence."""
    clearances: tuple[Chart, ...]
    nearest: Table | None
    findings: tuple[str, ...]
    """What else the audit tells of the clearances, a sentence each."""
    errors: Table | None
    """How much error in building it the clearances survive."""
    residuals: Table | None
    stated: Table | None
    """What the user states of it, which nothing certifies."""
    inputs: Chart
    effort: str
    """J in figures."""
    loads: Table
    flight: FlightPart | None


@dataclass(frozen=True)
class Card:
    """What is shown of a design beside the winner."""

    key: str
    heading: str
    view: View
    tree: Markup
    figures: tuple[Tile, ...]
    nearest: Table | None
    """The least clearances."""
    cases: Table | None
    """What is left in hover and every load case."""


@dataclass(frozen=True)
class NearTies:
    """Designs of one size that cost about the same."""

    caption: str
    designs: Table


@dataclass(frozen=True)
class RelaxedLimits:
    """Which limits give trees of one size a design."""

    caption: str
    limits: Table


@dataclass(frozen=True)
class RunPart:
    """All that is shown of a search."""

    sizes: Table
    near_ties: tuple[NearTies, ...]
    candidates: Markup
    """Columns and rows of the ranking as JSON inside a script element."""
    cards: tuple[Card, ...]
    """Of the best designs, the winner first."""
    progress: tuple[Chart, ...]
    reasons: Table | None
    """Why candidates have no design."""
    relaxed: tuple[RelaxedLimits, ...]
    """What would give them one, of each size without any design."""
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class FrontPart:
    """The front of a run with goals."""

    charts: tuple[Chart, ...]
    """One for each goal."""
    designs: Table
    levels: Table


@dataclass(frozen=True)
class Reproduction:
    """How to get the same again."""

    commands: tuple[str, ...]
    task: str
    """The task's file."""
    versions: dict[str, str]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Page:
    """Everything that a page says."""

    title: str
    """Task and size."""
    key: str | None
    """Of the tree that is shown; None if there is none."""
    verdict: str | None
    """Of its audit; None if there is none."""
    checked: str
    """What the audit checked; empty without one."""
    answer: str
    """In one sentence."""
    tiles: tuple[Tile, ...]
    notes: tuple[str, ...]
    """What limits it."""
    bound: tuple[str, ...]
    """The lower bound and what it means, a paragraph each."""
    task: TaskPart
    design: DesignPart | None
    meshes: Markup
    """What every module has a copy of, as JSON inside a script element."""
    run: RunPart | None
    reproduction: Reproduction
    front: FrontPart | None = None
    """None without goals."""
    simulated: SimulatedPart | None = None
    """None unless flights of the design are given."""


def render(page: Page) -> str:
    """Return the page as the text of an HTML file that needs nothing but itself."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("topo_search.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    template = environment.get_template("page.html.j2")
    return template.render(
        page=page,
        palette=palette,
        style=_own("page.css"),
        script=Markup("\n").join(map(_own, SCRIPTS)),
        plotly=Markup(get_plotlyjs()),
    )


def in_script(text: str) -> Markup:
    """Return JSON that no text in it can end the script element of."""
    return Markup(text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029"))


def json_in_script(value: Any) -> Markup:
    """Return a value as JSON inside a script element."""
    return in_script(json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":")))


def _own(name: str) -> Markup:
    """Return one of the package's own files, which are trusted."""
    return Markup((resources.files("topo_search.report") / "templates" / name).read_text(encoding="utf-8"))
