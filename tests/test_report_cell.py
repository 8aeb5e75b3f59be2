"""The 3-D view in a cell of a notebook: one page that works offline, and the flights that it plays."""

import base64
import csv
import gzip
import html
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report_cases import design, flown

import topo_search as ts
from topo_search.model import Topology
from topo_search.report.design_page import read_simulated


def unpack(view: ts.View) -> dict[str, Any]:
    """Return what the page of a view draws, and its code."""
    (packed,) = re.findall(r'id="packed">([^<]+)<', view.html)
    unpacked = json.loads(gzip.decompress(base64.b64decode(packed)))
    return {**{name: json.loads(text) for name, text in unpacked["data"].items()}, "code": unpacked["code"]}


def test_a_design_has_a_view_in_one_page(wall_press, tmp_path) -> None:
    view = wall_press.view()
    content = unpack(view)
    assert len(content["view-data"]["modules"]) == wall_press.topology.n
    assert content["view-data"]["flights"] == []
    assert "rod" in {part["kind"] for part in content["view-data"]["parts"]}  # as the audit mounts it
    assert "Three.js Authors" in content["code"]
    assert not re.search(r"(?:src|href)=.?http", view.html)
    assert len(view.html) < 500_000
    view.write_html(tmp_path / "view.html")
    assert (tmp_path / "view.html").read_text(encoding="utf-8") == view.html
    (frame,) = re.findall(r'^<iframe title="[^"]+" [^>]*srcdoc="([^"]+)"></iframe>$', view._repr_html_())
    assert html.unescape(frame) == view.html
    assert repr(view) == "<3-D view of wall-test: 5 modules, a70010>"


def test_a_view_and_the_page_of_a_design_play_the_flights(tmp_path) -> None:
    made = ts.read_json(ts.Design, Path(__file__).parent / "designs/wall-push.json")
    flight = ts.fly(made, only=("return from +x", "load case 0 (push), wall"), wake=False, out=tmp_path)
    played = unpack(flight.view())["view-data"]["flights"]
    assert played == read_simulated(tmp_path, made)["flights"]
    back, wall = played
    assert [back["name"], wall["name"]] == ["return from +x", "load case 0 (push), wall"]
    assert (back["outcome"], wall["outcome"]) == ("recovered", "recovered")
    moved = np.array(back["rows"])
    assert moved[0, 1:4] == pytest.approx([0.1, 0, 0], abs=0.01)
    assert moved[-1, 1:4] == pytest.approx([0, 0, 0], abs=0.01)
    assert np.diff(moved[:, 0]) == pytest.approx(0.06)
    turned = 2 * np.degrees(np.arcsin(np.linalg.norm(moved[:, 4:7], axis=1)))
    assert turned == pytest.approx(moved[:, 8], abs=0.2)
    touching = np.array(wall["rows"])[-1, 1:4]
    assert np.abs(touching).max() < 0.005  # where the design is drawn, its tip touches the wall
    with (tmp_path / "flight.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["scenario"] == "return from +x"]
    assert [float(rows[3]["time_s"]), float(rows[3]["x_m"])] == pytest.approx(back["rows"][1][:2], abs=1e-4)


def test_flights_of_files_without_poses_are_not_played(tmp_path) -> None:
    made = design(Topology.from_key("a0"))
    assert read_simulated(flown(made, tmp_path), made)["flights"] == []
