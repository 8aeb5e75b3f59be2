"""Figures for papers: the one style, plots and platforms on matplotlib axes, vectors with their fonts."""

import io
import itertools
import re
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from toy_problem import toy_run, toy_task

from topo_search import draw, plot_candidates, plot_front, plot_history, plot_platform
from topo_search.export import PAPER, TWO_COLUMNS, palette
from topo_search.export.picture import Drawing, content, figure_of
from topo_search.model import BadInput, Design
from topo_search.model.files import read_json
from topo_search.report.charts import TITLES
from topo_search.study import Answer
from verify.kinematics import platform

DESIGN = read_json(Design, Path(__file__).parent / "designs/wall-push.json")


@pytest.fixture(scope="module")
def answer(tmp_path_factory: Any) -> Answer:
    task = toy_task().replace(goals={"peak_input": [1.0, 0.9]})
    return toy_run(tmp_path_factory.mktemp("plots") / "run", task=task)


@pytest.fixture(autouse=True)
def paper():
    with style.context(PAPER):
        yield
    plt.close("all")


def axes_3d() -> Any:
    return plt.figure().add_subplot(projection="3d")


def drawn(what: Any) -> Axes:
    ax = axes_3d() if isinstance(what, Design) else plt.subplots()[1]
    draw(what, ax)
    return ax


def plots(answer: Answer) -> list[Any]:
    return [plot_front(answer), plot_history(answer), plot_candidates(answer, x="gap"), DESIGN]


def test_the_style_has_the_colours_of_pages_and_the_width_of_a_column() -> None:
    cycle = plt.rcParams["axes.prop_cycle"].by_key()["color"]
    assert [to_hex(colour) for colour in cycle] == list(palette.SERIES)
    assert plt.rcParams["figure.figsize"][0] == 3.5
    with style.context([PAPER, "topo_search.two_columns"]):
        assert plt.rcParams["figure.figsize"][0] == TWO_COLUMNS


def test_every_plot_is_drawn_with_titles_in_words(answer: Answer) -> None:
    front, history, candidates, _ = (drawn(what) for what in plots(answer))
    assert front.get_xlabel() == "largest rotor input over u_max"
    assert (history.get_xlabel(), history.get_ylabel()) == ("solves", "J over lower bound")
    assert candidates.get_ylabel() == "control effort J [rad⁴/s⁴]"
    x, y = candidates.lines[0].get_data()
    rows = answer.candidates.query("level == @answer.level")[["gap", "objective"]].dropna()
    assert sorted(zip(x, y, strict=True)) == sorted(zip(rows["gap"], rows["objective"], strict=True))
    assert set(answer.candidates.select_dtypes("number")) - {"level"} <= set(TITLES)


def test_labels_of_ticks_do_not_overlap(answer: Answer) -> None:
    with style.context([PAPER, "topo_search.two_columns"]):
        third = plt.figure().add_subplot(131, projection="3d")
    draw(DESIGN, third)
    figures = [*(drawn(what).figure for what in plots(answer)), figure_of(DESIGN), third.figure]
    for figure in figures:
        figure.draw_without_rendering()
        for ax in figure.axes:
            axes = [getattr(ax, f"{name}axis") for name in ("xyz" if ax.name == "3d" else "xy")]
            drawn_ticks = [axis.get_major_ticks() if ax.name == "3d" else axis._update_ticks() for axis in axes]
            ticks = itertools.chain(*drawn_ticks)
            boxes = [tick.label1.get_window_extent() for tick in ticks if tick.label1.get_text()]
            assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))


def test_vectors_have_their_fonts(answer: Answer) -> None:
    for what in plots(answer):
        figure = drawn(what).figure
        pdf = content(figure, "pdf")
        assert b"/CIDFontType2" in pdf
        assert b"/FontFile2" in pdf
        assert b"/Type3" not in pdf
        assert b"<text" not in content(figure, "svg")  # drawn as paths
    sizes = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", content(drawn(plots(answer)[0]).figure, "pdf"))
    assert sizes is not None
    assert float(sizes[1]) == pytest.approx(72 * 3.5)


def inked(figure: Figure) -> np.ndarray:
    """The part of a figure that is not transparent: left, right, top, bottom, as shares of its size."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    stream.seek(0)
    ink = plt.imread(stream)[:, :, 3] > 0
    sides = [np.flatnonzero(ink.any(axis=axis))[[0, -1]] / ink.shape[1 - axis] for axis in (0, 1)]
    return np.concatenate(sides)


@pytest.mark.parametrize("parts", [("platform", "load_cases"), ("exposure", "airflow", "platform")])
def test_a_platform_fills_its_figure(parts: Any) -> None:
    ax = axes_3d()
    draw(DESIGN, ax, parts=parts)
    left, right, top, bottom = inked(ax.figure)
    assert max(right - left, bottom - top) > 0.9
    assert min(left, top) > 0.001
    assert max(right, bottom) < 0.999
    assert abs(left + right - 1) < 0.03
    assert abs(top + bottom - 1) < 0.03


def test_the_rod_is_drawn_from_its_connector_to_the_tip(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[Any, Any]] = []
    monkeypatch.setattr(Drawing, "_solid", lambda _, faces, tints: seen.append((faces, tints)))
    drawing, poses = Drawing(axes_3d(), DESIGN, platform(DESIGN)), platform(DESIGN)
    drawing.platform()
    ((faces, tints),) = seen
    rod = faces[(tints == to_rgb(palette.END_EFFECTOR)).all(axis=1)].reshape(-1, 3)
    assert DESIGN.mount is not None
    hub, radius = poses.p[DESIGN.mount.module], DESIGN.task.end_effector.rod_radius
    for point, at_most in ((poses.end_effector, radius), (hub, 2 * radius)):
        assert np.linalg.norm(rod - point, axis=1).min() == pytest.approx(at_most)
    bare = DESIGN.model_copy(update={"mount": None})
    other = Drawing(axes_3d(), bare, poses)
    other.platform()
    assert not (seen[1][1] == to_rgb(palette.END_EFFECTOR)).all(axis=1).any()


def test_what_cannot_be_drawn_on_axes_is_refused() -> None:
    flat = plt.subplots()[1]
    with pytest.raises(BadInput, match="ax: must have the projection 3d for a Design, but got rectilinear"):
        draw(DESIGN, flat)
    with pytest.raises(BadInput, match="what: must be a two-dimensional figure, but has mesh3d"):
        draw(plot_platform(DESIGN), flat)
    with pytest.raises(BadInput, match=r"parts: must be among exposure, .*, but got rod"):
        draw(DESIGN, axes_3d(), parts=("rod",))  # type: ignore[arg-type]
