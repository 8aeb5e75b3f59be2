"""Kits of small, usual and large modules, opened cold: every part against the parts list, from the files alone."""

import csv
import json
import math
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from commands import invoke
from export_cases import random_design, rod_ends, with_rod
from test_export_brackets import mating_face, read

from topo_search.export.brackets import mount
from topo_search.export.kit import write_kit
from topo_search.export.sheet import mass_note, struts_note
from topo_search.model import BadInput, Design, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.files import read_json, to_json
from topo_search.model.flying import with_defaults
from topo_search.model.joint_mass import joint_mass
from topo_search.model.task_file import read_task
from verify.kinematics import platform

HOVER = {"units": "SI", "carries_weight": True}
SMALL = {"mass": 0.035, "arm_length": 0.046, "connector_distance": 0.065}
SMALL_BODY = {"rotor_radius": 0.023, "hub": (0.03, 0.03, 0.02), "arm_width": 0.007, "rotor_height": 0.006}
LARGE = {"mass": 1.2, "arm_length": 0.19, "connector_distance": 0.29}
MODULES: dict[str, dict[str, Any]] = {
    "35 g": {**SMALL, "body": SMALL_BODY},
    "250 g": {"mass": 0.25},
    "1.2 kg": {**LARGE, "body": {"rotor_radius": 0.1, "hub": (0.15, 0.13, 0.08), "arm_width": 0.03}},
}
BOLTS = {"35 g": "M1.6", "250 g": "M3", "1.2 kg": "M6"}


def drawn(module: dict[str, Any]) -> Design:
    """A design of three modules with the rod that a new task gives them, or one of 3 mm; its joints have mass."""
    rod = with_defaults({"module": module, "load_cases": [HOVER]})["end_effector"]
    design = with_rod(random_design(Topology.from_key("a120"), 3, {"module": module, "end_effector": rod}))
    i, port = design.mount.module, design.mount.port
    away = platform(design).poses.R[i] @ (PORT_DIRECTIONS[port] + [0.1, 0.2, 0.3])
    length = 2 * design.task.module.connector_distance
    tip = tuple((rod_ends(design)[0] + length * away / np.linalg.norm(away)).tolist())
    task = design.task.with_fields("module", joint_mass=joint_mass(design.task.module))
    return design.model_copy(update={"end_effector_m": tip, "task": task})


@pytest.fixture(scope="module", params=MODULES)
def kit(request, tmp_path_factory):
    """Folder of a kit, its notes and the module's name."""
    folder = tmp_path_factory.mktemp("kits") / "kit"
    return folder, write_kit(drawn(MODULES[request.param]), folder).notes, request.param


def rows_of(folder: Path) -> list[dict[str, str]]:
    return [*csv.DictReader((folder / "parts.csv").read_text().splitlines())]


def solid(folder: Path, file: str) -> trimesh.Trimesh:
    mesh = trimesh.load_mesh(folder / file)
    assert mesh.is_watertight
    return mesh.apply_scale(1e-3)


def test_every_file_is_listed_and_every_mass_is_that_of_its_solid(kit) -> None:
    folder, *_ = kit
    rows = rows_of(folder)
    printed = {row["file"]: row for row in rows if row["file"]}
    assert {str(path.relative_to(folder)) for path in (folder / "brackets").iterdir()} == set(printed)
    for file, row in printed.items():
        volume = solid(folder, file).volume
        assert float(row["mass_kg"]) == pytest.approx(1240 * volume, rel=1e-3)
        assert float(row["size"].removesuffix(" cm^3")) == pytest.approx(volume * 1e6, abs=0.051)
    *parts, total, _ = rows
    for row in parts:
        assert float(row["total_kg"]) == pytest.approx(int(row["count"]) * float(row["mass_kg"]), rel=1e-3)
    assert float(total["total_kg"]) == pytest.approx(sum(float(row["total_kg"]) for row in parts), abs=2e-4)
    module = json.loads((folder / "design.json").read_text())["task"]["module"]
    assert float(parts[0]["total_kg"]) == pytest.approx(3 * module["mass"])
    sheet = (folder / "assembly.html").read_text()
    assert all(row["size"] in sheet and Path(row["file"]).name in sheet for row in parts)


def test_the_kit_weighs_what_the_search_counts(kit) -> None:
    folder, notes, _ = kit
    *_, total, model = rows_of(folder)
    more = float(total["total_kg"]) / float(model["total_kg"]) - 1
    (told,) = (note for note in notes if "all parts weigh" in note)
    assert (abs(more) > 0.05) == ("search again with --set module.joint_mass=" in told)
    assert abs(more) < 0.07


def test_bolts_fit_their_holes_and_hold_both_flanges(kit) -> None:
    folder, _, name = kit
    rows = rows_of(folder)
    counts = Counter[str]()
    for row in rows[:-2]:
        counts[row["part"]] += int(row["count"])
    assert counts["bracket"] == 2
    struts = counts["strut"] + counts["tube"]
    assert (struts, counts["rod mount"], counts["tube end"]) == (5, 1, 2 * counts["tube"])
    assert counts["bolt with nut"] == 4 * (2 * 2 + struts + 1)
    (size,) = (row["size"] for row in rows if row["part"] == "bolt with nut")
    thread, length = (float(number) for number in re.findall(r"[\d.]+", size))
    assert f"M{thread:g}" == BOLTS[name]
    for row in rows:
        if row["part"] in ("bracket", "strut", "tube end", "rod mount"):
            mesh = solid(folder, row["file"])
            hole = {1.6: 0.0017, 3.0: 0.0032, 6.0: 0.0064}[thread]
            marks = 1 if row["part"] != "bracket" else 2
            centre, normal, _ = mating_face(mesh, marks, hole)
            flange = thickness(mesh, centre, normal)
            grip = 2000 * flange + 0.8 * thread
            assert grip < length < grip + 5.1, row


def thickness(mesh: trimesh.Trimesh, centre: np.ndarray, normal: np.ndarray) -> float:
    """Thickness of the flange behind a face, at a corner, where it is nothing but flange [m]."""
    depths = (centre - mesh.vertices) @ normal
    across = np.linalg.norm(mesh.vertices - centre + depths[:, None] * normal, axis=1)
    corners = depths[(across > 0.98 * across[depths < 1e-6].max()) & (depths > 1e-6)]
    return float(corners.min())


def test_brackets_struts_and_hub_add_up_to_the_connector_and_the_bore_is_the_rods(kit) -> None:
    folder, _, name = kit
    task = json.loads((folder / "design.json").read_text())["task"]
    module, rows = task["module"], rows_of(folder)
    hole = {"M1.6": 0.0017, "M3": 0.0032, "M6": 0.0064}[BOLTS[name]]
    bracket = next(row for row in rows if row["part"] == "bracket")
    centre, normal, _ = mating_face(solid(folder, bracket["file"]), 2, hole)
    set_back = float(centre @ normal)
    assert set_back < 0.2 * module["connector_distance"]
    assert 0.02 < float(bracket["mass_kg"]) / module["mass"] < 0.1
    spans = set[float]()
    for row in rows:
        if row["part"] == "strut":
            spans.add(round(float(np.ptp(solid(folder, row["file"]).vertices[:, 0])), 4))
            assert max(spans) <= 0.08
        if row["part"] == "tube":
            end = solid(folder, next(one["file"] for one in rows if one["part"] == "tube end"))
            long, wide = (float(number) / 1000 for number in re.findall(r"([\d.]+) mm (?:long|thick)", row["size"]))
            spans.add(round(long + 2 * thickness(end, np.zeros(3), np.array([-1.0, 0.0, 0.0])), 4))
            assert min(spans) > 0.08
            assert wide / 2 < np.abs(end.vertices[:, 1]).max()
    hubs = {edge / 2 for edge in module["body"]["hub"][:2]}
    assert spans <= {round(module["connector_distance"] - set_back - half, 4) for half in hubs}
    rod = next(row for row in rows if row["part"] == "rod")
    long, wide = (float(number) / 1000 for number in re.findall(r"[\d.]+", rod["size"])[:2])
    assert wide == pytest.approx(2 * task["end_effector"]["rod_radius"])
    assert long == pytest.approx(2 * module["connector_distance"], abs=1e-4)
    mount = solid(folder, next(row["file"] for row in rows if row["part"] == "rod mount"))
    axis = rod_direction(json.loads((folder / "design.json").read_text()), folder)
    off = np.linalg.norm(mount.vertices - (mount.vertices @ axis)[:, None] * axis, axis=1)
    bore = mount.vertices[np.abs(off - wide / 2 - 1e-4) < 2e-6] @ axis
    assert len(bore) >= 64
    assert bore.min() == pytest.approx(0, abs=1e-5)


def rod_direction(design: dict[str, Any], folder: Path) -> np.ndarray:
    """Direction of the rod in the mount's frame, as the sheet has it."""
    text = " ".join(re.sub("<[^>]*>", " ", (folder / "assembly.html").read_text()).split())
    found = re.search(
        r"tip is (\S+) mm (out|in)wards, (\S+) mm to the (left|right) \(looking outwards\), and (\S+) mm (up|down)",
        text,
    )
    assert found is not None
    signs = [-1 if word in ("in", "right", "down") else 1 for word in found.groups()[1::2]]
    v = np.array([float(number) for number in found.groups()[::2]]) * signs
    return np.asarray(v / np.linalg.norm(v))


@pytest.mark.parametrize("name", MODULES)
def test_mounts_are_closed_whatever_the_direction_of_the_rod(name: str) -> None:
    """Half of them were not where ball and socket of a mount were equally thick."""
    rng, design = np.random.default_rng(0), drawn(MODULES[name])
    i, port = design.mount.module, design.mount.port
    for _ in range(8):
        away = platform(design).poses.R[i] @ (PORT_DIRECTIONS[port] + rng.uniform(-0.9, 0.9, 3))
        turned = design.model_copy(update={"end_effector_m": tuple((rod_ends(design)[0] + 0.2 * away).tolist())})
        (part,) = mount(turned)
        assert read(part).volume > 0


def test_the_rod_of_small_modules_is_as_thin_as_their_brackets_require() -> None:
    def rod(module: dict[str, Any], **stated: Any) -> dict[str, Any]:
        return dict(
            with_defaults({"module": module, "load_cases": [HOVER], "end_effector": stated})["end_effector"]
        )

    assert rod(SMALL)["rod_radius"] == 0.002
    assert rod(SMALL)["rod_linear_density"] == pytest.approx(0.045 * 0.4**2)
    for module in ({}, {"mass": 0.25}, LARGE, {"mass": "heavy"}, {"mass": math.inf}):
        assert "rod_radius" not in rod(module)
    assert "rod_radius" not in rod(SMALL, rod="none")
    assert "rod_radius" not in rod(SMALL, rod_linear_density=0.01)


def test_modules_too_small_for_any_bolt_get_no_kit(tmp_path: Path) -> None:
    module = {"mass": 0.002, "arm_length": 0.0018, "connector_distance": 0.003}
    design = drawn({**module, "body": {"rotor_radius": 0.001, "hub": (0.001, 0.001, 0.001), "arm_width": 0.0005}})
    (tmp_path / "tiny.json").write_text(to_json(design))
    for words in (("kit", "kit"), ("brackets", "kit"), ("sheet", "sheet.pdf"), ("parts", "parts.csv")):
        told = invoke(
            "export", tmp_path / "tiny.json", "--format", words[0], "--out", tmp_path / words[1], status=2
        )
        rule = "module.bracket: must be stated: the module is too small for its own brackets, whose M1.6 bolts"
        assert f"{rule} are the smallest; they take 3.6 mm of a connector_distance of 3 mm" in told.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.json"]


def test_a_rod_that_hides_the_bolts_of_its_mount_is_refused(tmp_path: Path) -> None:
    thick = drawn(MODULES["35 g"])
    thick = thick.model_copy(update={"task": thick.task.with_fields("end_effector", rod_radius=0.005)})
    with pytest.raises(BadInput, match=r"end_effector.rod_radius: must be at most 0\.0022, .* but got 0\.005"):
        write_kit(thick, tmp_path / "kit")
    assert not (tmp_path / "kit").exists()


def test_a_kit_without_struts_says_what_is_missing() -> None:
    """Rotors of 60 mm radius leave no room between the arms."""
    design = read_json(Design, Path(__file__).parent / "designs/wall-push.json")
    wide = design.task.module.replace(body=design.task.module.body.replace(rotor_radius=0.069))
    crowded = design.model_copy(update={"task": design.task.model_copy(update={"module": wide})})
    assert list(struts_note(design)) == []
    (told,) = struts_note(crowded)
    assert told.startswith("rotors leave no room for straight struts: nothing in the kit joins a hub")


SUMS = (("all parts", "1.2"), ("model of the search", "1"))


def test_the_advice_on_mass_is_a_task_that_can_be_stated() -> None:
    """A task without a rod cannot count one."""
    parts = [("bracket", 2, "", "0.1", "0.2", ""), *((name, "", "", "", mass, "") for name, mass in SUMS)]
    with_rod = read_task("wall-push", ("modules=3", 'end_effector.rod_mass="ignored"')).resolve(3)
    without = read_task("push", ("modules=3",)).resolve(3)
    assert without.end_effector.rod == "none"
    assert "rod_mass" in mass_note(with_rod, parts)
    assert "rod_mass" not in mass_note(without, parts)


def test_a_kit_whose_stated_brackets_are_in_the_way_says_which_are_not(tmp_path: Path) -> None:
    design = json.loads((Path(__file__).parent / "designs/wall-push.json").read_text())
    design["task"]["module"]["bracket"] = {
        "bolt_circle": 0.08, "bolt_diameter": 0.0032, "thickness": 0.004, "wall": 0.003
    }  # fmt: skip
    (tmp_path / "wide.json").write_text(json.dumps(design))
    said = invoke("export", tmp_path / "wide.json", "--format", "kit", "--out", tmp_path / "kit", status=1).stderr
    assert "Smaller ones are: search again with module.bracket = {" in said
    assert not (tmp_path / "kit").exists()
