"""Pictures of designs: files of both kinds, every kind of exposure, small and large, and what is drawn where."""

import itertools
import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from report_cases import design, grown

from topo_search.export.picture import Drawing, draw, figure_of, title, wrenches
from topo_search.export.tree_drawing import flat_layout, layered_layout
from topo_search.model import BadInput, Topology
from topo_search.model.mesh import cone_sphere_outline
from topo_search.model.task_file import examples
from verify.kinematics import platform

CROSS = Topology.from_key("af0000")


@pytest.mark.parametrize("name", [name for name in examples() if name.startswith("push")])
def test_the_legend_explains_the_exposure(name: str) -> None:
    texts = [text.get_text() for text in figure_of(design(CROSS, name)).legends[0].get_texts()]
    volumes = "local" in name or "directional" in name or "two-paths" in name
    assert ("keep-out region for airflow" in texts) == volumes
    assert ("cone that must contain all airflow" in texts) == ("exterior-60" in name)
    assert ("half-space that must contain all airflow" in texts) == ("exterior-90" in name)


def test_load_cases_are_arrows_in_their_colours() -> None:
    made = design(CROSS)
    at = platform(made)
    found = wrenches(made, at)
    assert [(k, torque) for k, torque, _, _ in found] == [(0, False), (1, False), (2, False)]
    weight = np.array(made.task.load_cases[2].at_com.force)
    for k, place in ((0, at.end_effector), (1, at.end_effector), (2, at.p_com)):
        case = made.task.load_cases[k]
        force = np.array(case.at_end_effector.force) + np.array(case.at_com.force)
        np.testing.assert_allclose(found[k][2], place)
        np.testing.assert_allclose(found[k][3], force / np.linalg.norm(weight))
    texts = [text.get_text() for text in figure_of(made).legends[0].get_texts()]
    assert texts.count("load case 0") == texts.count("load case 2") == 1


def test_torques_are_drawn_and_what_has_no_colour_is_left_out() -> None:
    made = design(CROSS, "ten-wrenches")
    found = wrenches(made, platform(made))
    assert {k for k, *_ in found} == set(range(5))
    torques = [float(np.linalg.norm(v)) for _, torque, _, v in found if torque]
    assert len(torques) == 5
    assert max(torques) <= 1
    close = Drawing(Figure().add_subplot(projection="3d"), made, platform(made))
    close.load_cases()
    assert len(close.axes.collections) == 5 + 5 + 5  # arrows of forces and torques, rings


SEVERAL = (
    'exposure=[{kind="local"}, {kind="directional", along="end_effector", length=0.5}, '
    '{kind="exterior", axis=[0, 0, -1], half_angle_deg=45}]'
)


@pytest.mark.parametrize(
    "made",
    [
        design(CROSS, "push", SEVERAL),
        design(Topology.from_key("a0"), "push-local", end_effector_m=[0.0, 0.0, 0.0]),  # no direction
    ],
)
def test_several_requirements_and_an_end_effector_at_the_centre_are_drawn(made, tmp_path: Path) -> None:
    draw(made, tmp_path / "drawn.png")
    assert (tmp_path / "drawn.png").stat().st_size > 100_000


@pytest.mark.parametrize("n", [1, 30])
def test_any_size(tmp_path: Path, n: int) -> None:
    path = tmp_path / "picture.svg"
    draw(design(grown(n), "push-local"), path)
    root = ElementTree.parse(path).getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert len(list(root.iter("{http://www.w3.org/2000/svg}path"))) > 150 * n


def test_the_same_design_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.svg", "b.svg"):
        draw(design(CROSS), tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_the_title_names_size_objective_and_gap() -> None:
    assert title(design(CROSS)) == r"push   $n$ = 5   $J$ = 1.234$\times$10$^{13}$ rad$^4$/s$^4$   gap 9.32 %"
    assert "gap" not in title(design(CROSS, gap=None))


@pytest.mark.parametrize("n", [1, 5, 30])
def test_all_axes_have_one_scale_and_hold_everything(n: int) -> None:
    figure = figure_of(design(grown(n), "push-two-paths"))
    for axes in figure.axes[:2]:
        limits: Any = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])  # type: ignore[attr-defined]
        per_metre = axes._box_aspect / np.ptp(limits, axis=1)  # type: ignore[attr-defined]
        np.testing.assert_allclose(per_metre, per_metre[0])
        labels = axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()  # type: ignore[attr-defined]
        assert labels == ("$x$ [m]", "$y$ [m]", "$z$ [m]")


def test_numbers_of_modules_do_not_overlap() -> None:
    figure = figure_of(design(grown(30)))
    figure.draw_without_rendering()
    close: Any = figure.axes[1]
    boxes = [Text.get_window_extent(text) for text in close.texts]  # of an annotation without its line
    assert [text.get_text() for text in close.texts] == [str(i) for i in range(30)]
    assert sum(bool(one.overlaps(other)) for one, other in itertools.combinations(boxes, 2)) == 0


@pytest.mark.parametrize("r_1", [0.1, 0.2])
@pytest.mark.parametrize("length", [0.0, 0.05, 1.2])
def test_the_outline_is_the_edge_of_all_balls(r_1: float, length: float) -> None:
    rng = np.random.default_rng(3)
    v = rng.normal(size=3)
    v /= np.linalg.norm(v)
    P_0, axis = rng.normal(size=3), rng.normal(size=3)
    P_1 = P_0 + length * axis / np.linalg.norm(axis)
    outline = cone_sphere_outline(P_0, 0.1, P_1, r_1, v)
    eta = np.linspace(0, 1, 2001)[:, None]
    centres, radii = P_0 + eta * (P_1 - P_0), 0.1 + eta[:, 0] * (r_1 - 0.1)
    across = np.eye(3) - np.outer(v, v)
    for point in outline:
        gaps = np.linalg.norm((point - centres) @ across, axis=1) - radii
        assert gaps.min() == pytest.approx(0, abs=1e-4)


def test_the_flat_layout_follows_the_ports() -> None:
    cells, turns = flat_layout(CROSS)
    np.testing.assert_array_equal(cells, [[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1]])
    assert turns == [0] * 5
    # the child is bolted by its own +y port to the parent's +x: it is a quarter turn round, and its +y points back
    quarter = Topology(((-1, -1, -1), (0, 0, 1), (1, 0, 2)))
    cells, turns = flat_layout(quarter)
    assert turns == [0, 1, 1]
    np.testing.assert_array_equal(cells, [[0, 0], [1, 0], [1, 1]])


@pytest.mark.parametrize("n", [1, 2, 7, 40])
def test_the_layered_layout_keeps_modules_apart(n: int) -> None:
    topology = grown(n)
    place = layered_layout(topology)
    gaps = np.linalg.norm(place[:, None] - place, axis=-1)[~np.eye(n, dtype=bool)]
    assert gaps.min(initial=1.0) >= 1.0 - 1e-12
    for h, i, _, _ in topology.edges():
        assert place[i, 1] < place[h, 1]


def test_overlapping_trees_are_laid_in_layers() -> None:
    square = Topology(((-1, -1, -1), (0, 0, 2), (1, 1, 3), (0, 1, 3), (3, 0, 2)))
    cells, _ = flat_layout(square)
    assert len(np.unique(cells, axis=0)) < 5
    words = [text.get_text() for text in figure_of(design(square)).axes[2].texts]
    assert words.count("+x") == 2
    assert words.count("−y") == 2


@pytest.mark.parametrize("angle_deg", range(0, 360, 60))
def test_the_viewer_looks_across_the_offset(angle_deg: int) -> None:
    angle = math.radians(angle_deg)
    sideways = design(Topology.from_key("a0"), end_effector_m=[math.cos(angle), math.sin(angle), 0.0])
    scene = Drawing(Figure().add_subplot(projection="3d"), sideways, platform(sideways))
    assert np.linalg.norm(scene.v) == pytest.approx(1)
    assert abs(scene.v @ sideways.end_effector_m) < 0.75


def test_only_faces_towards_the_viewer_are_drawn(tmp_path: Path) -> None:
    draw(design(CROSS), tmp_path / "picture.svg")
    assert (tmp_path / "picture.svg").stat().st_size < 350_000


def test_an_end_effector_out_of_sight_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"end_effector_m: must be within .* m of the root module to be drawn"):
        draw(design(CROSS, end_effector_m=[0.0, -1e5, 0.0]), tmp_path / "picture.png")
    assert list(tmp_path.iterdir()) == []
