"""Convex target regions in pictures, solids, words, and where the report marks the least clearance."""

import io
from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pytest
import trimesh
from verify_cases import fan

from topo_search.export.picture import figure_of
from topo_search.export.solids import glb
from topo_search.export.task_picture import task_figure
from topo_search.model import Local
from topo_search.report.scene import scene
from topo_search.report.task_facts import requirement
from verify.kinematics import platform

CUBE = np.array(list(product((-1.0, 1.0), repeat=3)))
REGIONS = [
    {"kind": "local", "box": [0.4, 0.3, 0.2]},
    {"kind": "local", "vertices": (0.1 * CUBE[[0, 1, 2, 4, 7]] + [0.3, 0.0, 0.2]).tolist()},
]
DESIGN = fan({"exposure": REGIONS})


def test_the_solid_is_the_region_where_the_end_effector_is() -> None:
    loaded = trimesh.load(io.BytesIO(glb(DESIGN)), file_type="glb")
    box = next(
        loaded.geometry[geometry].copy().apply_transform(transform)
        for transform, geometry in (loaded.graph.get(node) for node in loaded.graph.nodes_geometry)
        if geometry.startswith("exposure_0")
    )
    assert box.is_volume
    assert box.volume == pytest.approx(0.4 * 0.3 * 0.2, rel=1e-6)
    assert sorted(box.extents) == pytest.approx([0.2, 0.3, 0.4], rel=1e-6)


def test_pictures_show_regions() -> None:
    figures = [figure_of(DESIGN), figure_of(fan()), task_figure(DESIGN.task), task_figure(fan().task)]
    try:
        with_regions, without = (len(figure.axes[0].collections) for figure in figures[:2])
        assert with_regions == without + 2 * len(REGIONS)  # faces and edges
        with_regions, without = (len(figure.axes[0].patches) for figure in figures[2:])
        assert with_regions == without + len(REGIONS)
    finally:
        for figure in figures:
            plt.close(figure)
    assert any("keep-out" in part.name for part in scene(DESIGN, platform(DESIGN)))


def test_regions_in_words() -> None:
    ball, box, points = (Local.model_validate(region) for region in ({"radius": 0.2}, *REGIONS))
    assert requirement(ball) == "a ball of radius 20 cm around the end-effector"
    assert requirement(box).startswith("a box of")
    assert requirement(points) == "the convex hull of 5 points about the end-effector"
