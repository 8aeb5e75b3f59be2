"""Assembly sheet and parts list, for someone who has only the kit."""

import csv
import io
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from topo_search.export.allocation import allocation
from topo_search.export.brackets import printed_parts
from topo_search.export.mjcf import mjcf
from topo_search.export.sheet import bolt_of, mass_note, parts_csv, parts_list, sheet
from topo_search.export.urdf import urdf
from topo_search.model import Design
from topo_search.model.files import read_json
from verify.kinematics import platform

DESIGN = read_json(Design, Path(__file__).parent / "designs" / "wall-push.json")
SVG = "{http://www.w3.org/2000/svg}"
SOLIDS = printed_parts(DESIGN)
ROWS = parts_list(DESIGN, SOLIDS)


def test_the_parts_list_has_every_mass_and_the_total_beside_the_models() -> None:
    rows = {row["part"]: row for row in csv.DictReader(io.StringIO(parts_csv(ROWS)))}
    listed = [row for row in ROWS if row[1] != ""]
    total = sum(int(row[1]) * float(row[3]) for row in listed)
    assert float(rows["all parts"]["total_kg"]) == pytest.approx(total, abs=1e-4)
    assert float(rows["model of the search"]["total_kg"]) == 0.768
    assert (rows["strut"]["count"], rows["strut"]["file"]) == ("5", "brackets/strut_86.4mm.stl")
    assert (rows["bolt with nut"]["count"], rows["bolt with nut"]["size"]) == ("40", "M3 x 12")
    assert (rows["clamp bolt with nut"]["count"], rows["clamp bolt with nut"]["size"]) == ("1", "M3 x 12")
    struts_and_their_bolts = float(rows["strut"]["total_kg"]) + 20 * float(rows["bolt with nut"]["mass_kg"])
    assert total - struts_and_their_bolts - 0.768 == pytest.approx(0.1, abs=3e-3)  # 13 % of the model
    assert bolt_of(0.0055, 0.012) == (5.0, 20)
    joined = total - float(rows["module"]["total_kg"]) - float(rows["rod"]["total_kg"]) - 0.048
    (mass,) = re.findall("joint_mass=([0-9.]+)", mass_note(DESIGN.task, ROWS))
    assert float(mass) == pytest.approx(joined / 2, abs=5e-4)


def test_the_sheet_tells_where_modules_rotors_and_the_autopilot_are() -> None:
    page = ElementTree.fromstring(sheet(DESIGN, SOLIDS, ()).split("\n", 1)[1])
    text = " ".join("".join(page.itertext()).split())
    at = platform(DESIGN)
    tables = [[[cell.text or "" for cell in row] for row in table.iter("tr")] for table in page.iter("table")]
    head, *rows = next(one for one in tables if one[0][-1] == "to the tip [mm]")
    assert head[1:] == ["to module 0 [mm]", "to module 1 [mm]", "to module 2 [mm]", "to the tip [mm]"]
    places = np.vstack([at.p, at.end_effector])
    expected = 1000 * np.linalg.norm(at.p[:, None] - places, axis=2)
    np.testing.assert_allclose([[float(cell) for cell in row[1:]] for row in rows], expected, atol=0.051)
    _, *lie = next(one for one in tables if one[0][-1] == "upper side points to")
    for row, place, R in zip(lie, at.p - at.p_com, at.R, strict=True):
        np.testing.assert_allclose([float(x) for x in row[1:4]], 1000 * place, atol=0.051)
        axes = [[float(x) for x in cell[1:-1].split(",")] for cell in row[4:]]
        np.testing.assert_allclose(axes, R.T, atol=1e-3)
    forward, left, up = (float(cell) / 1000 for cell in lie[0][1:4])  # module 0 from the centre of mass
    (hub,) = re.findall(r"EKF2_IMU_POS_X, Y, Z = (\S+), (\S+), (\S+) m;", text)
    assert [float(x) for x in hub] == pytest.approx([forward, -left, -up], abs=6e-4)
    drawing = next(svg for svg in page.iter(SVG + "svg") if svg.get("aria-label") == "strut of 86.4 mm")
    assert [words.text for words in drawing.iter(SVG + "text")] == ["40.00", "126.40"]
    com, arrow, upper = (
        np.array([float(x) for x in re.search(rf"{words} \[([^]]+)\]", text)[1].split(",")])  # type: ignore[index]
        for words in ("mass is at", "arrow along", "side along")
    )
    np.testing.assert_allclose(at.R[0] @ com, 1000 * at.p_com, atol=0.1)
    np.testing.assert_allclose(at.R[0] @ arrow, [1, 0, 0], atol=1e-3)
    np.testing.assert_allclose(at.R[0] @ upper, [0, 0, 1], atol=1e-3)
    _, *motors = next(one for one in tables if one[0][0] == "motor of PX4")
    for j, (row, one) in enumerate(zip(motors, allocation(DESIGN).rotors, strict=True)):
        turns = "CCW" if one.spin == 1 else "CW"
        assert row[:5] == [str(j + 1), str(j), str(one.module), str(one.rotor), turns]
        np.testing.assert_allclose([float(x) for x in row[5:]], 1000 * np.array(one.position_m), atol=0.051)
    views = [svg for svg in page.iter(SVG + "svg") if svg.get("aria-label", "").startswith("from")]
    assert [[t.text for t in svg.iter(SVG + "text")] for svg in views] == [
        ["0", "1", "2", "E", "+"],
        ["0", "1", "2", "E", "+"],
    ]


def test_rotors_have_one_number_everywhere() -> None:
    names = [f"module_{i}_rotor_{q}" for i in range(3) for q in range(4)]
    assert [one.name for one in allocation(DESIGN).rotors] == names
    assert [(one.module, one.rotor) for one in allocation(DESIGN).rotors] == [
        (i, q) for i in range(3) for q in range(4)
    ]
    model, robot = ElementTree.fromstring(mjcf(DESIGN)), ElementTree.fromstring(urdf(DESIGN))
    assert [motor.get("name") for motor in model.findall("actuator/general")] == names
    links = [str(link.get("name")) for link in robot.findall("link")]
    assert [name for name in links if "rotor" in name] == names
