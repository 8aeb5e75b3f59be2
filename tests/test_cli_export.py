"""`topo-search export`: what it writes, and what it says when it cannot."""

import io
import math
import re
import shutil
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from functools import partial
from pathlib import Path

import matplotlib.image
import pandas
import pytest
import trimesh
from commands import invoke, refused
from report_cases import design as drawn
from toy_problem import toy_run

from topo_search import compose
from topo_search.model import Design, Status, Topology
from topo_search.model.bracket import Bracket
from topo_search.model.files import read_json, to_json
from topo_search.model.proven import lower_text
from topo_search.model.topology import PORT_NAMES
from verify import audit

DESIGNS = Path(__file__).parent / "designs"
CLEAR = str(DESIGNS / "survives-a-rotor.json")


@pytest.fixture(scope="module")
def kit(tmp_path_factory):
    """The kit of a clear design, and what writing it says."""
    folder = tmp_path_factory.mktemp("clear") / "kit"
    return folder, invoke("export", CLEAR, "--format", "kit", "--out", folder)


@pytest.fixture
def command(tmp_path, monkeypatch):
    """The command in an empty folder with a design of two modules and with half of its file."""
    monkeypatch.chdir(tmp_path)
    given = {"root_orientation_rad": (0.1, 0.2, 0.3), "hinge_angles_rad": (0.4,), "end_effector_m": (0.5, 0.0, 0.2)}
    design = drawn(Topology.from_key("a20"), **given, rotor_speeds_squared=((1e6,) * 8,) * 3)
    (tmp_path / "design.json").write_text(to_json(design))
    (tmp_path / "half.json").write_text(to_json(design)[:300])
    return partial(invoke, "export")


def test_the_kind_of_picture_is_told_by_the_name_or_by_the_option(command, tmp_path):
    for words in (
        ["--out", "a.PNG"],
        ["--out", "deep/a.dat", "--format", "svg"],
        ["--out", "a.pdf", "--format", "pdf"],
    ):
        assert command("design.json", *words).stdout == f"the picture is in {words[1]}\n"
    assert matplotlib.image.imread(tmp_path / "a.PNG", format="png").shape == (1500, 2148, 4)
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")
    assert ElementTree.parse(tmp_path / "deep/a.dat").getroot().tag.endswith("svg")


def test_a_design_that_is_not_clear_is_exported_with_a_warning(command, tmp_path):
    assert "warning: the audit of this design is violated: " in command("design.json", "--out", "a.urdf").stderr
    clear = str(DESIGNS / "push-a70010.json")
    assert "warning" not in command(clear, "--out", "b.urdf").stderr


@pytest.mark.parametrize("words", [["a.mjcf"], ["a.xml"], ["a.dat", "--format", "mjcf"], ["a.urdf"]])
def test_models_for_simulators_are_written(command, tmp_path, words):
    assert command("design.json", "--out", *words).stdout == f"the design is in {words[0]}\n"
    assert ElementTree.parse(tmp_path / words[0]).getroot().tag == ("robot" if words == ["a.urdf"] else "mujoco")


def test_what_a_simulator_has_beyond_the_model_is_an_option_of_its_kinds(command, tmp_path):
    command("design.json", "--out", "a.mjcf", "--motor-lag", "0.05", "--contacts")
    text = (tmp_path / "a.mjcf").read_text()
    assert 'dyntype="filterexact"' in text
    assert 'name="tip"' in text
    command(CLEAR, "--format", "kit", "--out", "kit", "--motor-lag", "0.05")
    assert "filterexact" in (tmp_path / "kit/platform.xml").read_text()
    told = refused("export", "design.json", "--out", "a.urdf", "--rod-mass")
    assert "applies only to mjcf, kit, but got --format urdf" in told


@pytest.mark.parametrize(
    ("words", "solids"),
    [
        (["a.glb"], {"frame", "rotors", "airflow", "end_effector", "centre_of_mass"}),
        (["a.glb", "--parts", "airflow"], {"airflow"}),
        (["a.stl"], {"a"}),
        (["a.dat", "--format", "stl", "--parts", "all"], {"a"}),
    ],
)
def test_solids_are_written(command, tmp_path, words, solids):
    assert command("design.json", "--out", *words).stdout == f"the design is in {words[0]}\n"
    kind = "glb" if words[0] == "a.glb" else "stl"
    content = io.BytesIO((tmp_path / words[0]).read_bytes())
    loaded = trimesh.load_scene(content, file_type=kind)
    assert len(loaded.geometry) == len(solids)
    assert kind == "stl" or set(loaded.geometry) == solids


def test_the_assembly_sheet_of_a_design_or_of_an_audit_is_a_table(command, tmp_path):
    result = command("design.json", "--format", "assembly", "--out", "assembly.csv")
    assert result.stdout == "the table is in assembly.csv\n"
    audited = audit(read_json(Design, tmp_path / "design.json"))
    (tmp_path / "audit.json").write_text(to_json(audited))
    command("audit.json", "--format", "assembly", "--out", "again.csv")
    texts = {(tmp_path / name).read_text() for name in ("assembly.csv", "again.csv")}
    assert texts == {audited.assembly.csv()}


def test_a_design_is_audited_for_the_table_of_its_clearances_and_an_audit_is_not(command, tmp_path):
    assert command("design.json", "--out", "pairs.csv").stdout == "the table is in pairs.csv\n"
    pairs = pandas.read_csv(tmp_path / "pairs.csv")
    kinds = {"airflow": 1, "exclusion": 2, "body": 1, "rod": 2, "rotor-airflow": 10, "rod-airflow": 2}
    assert list(pairs.kind) == [kind for kind, count in kinds.items() for _ in range(count)]
    (tmp_path / "audit.json").write_text(to_json(audit(read_json(Design, tmp_path / "design.json"))))
    for name in ("again.csv", "pairs.parquet"):
        command("audit.json", "--out", name)
    assert (tmp_path / "again.csv").read_text() == (tmp_path / "pairs.csv").read_text()
    assert list(pandas.read_parquet(tmp_path / "pairs.parquet").analytic_m) == list(pairs.analytic_m)


def test_the_table_of_a_run_is_that_of_its_candidates(command, tmp_path):
    toy_run(tmp_path / "run")
    command("run", "--out", "all.csv")
    assert (tmp_path / "all.csv").read_text() == (tmp_path / "run" / "candidates.csv").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["half.json", "--out", "new.png"], "half.json: is not a JSON file, or only a part of one"),
        (["none.json", "--out", "new.png"], "none.json: no such file"),
        ([".", "--out", "new.csv"], ".: is not a run folder"),
        ([".", "--out", "new.png"], ".: must be a regular file, but is a folder"),
        (["design.json", "--out", "new.doc"], "new.doc: must end in .csv, .glb, .html, .mjcf, .npz"),
        (["design.json", "--out", "new.png", "--format", "eps"], "must be one of air, allocation"),
        (["design.json", "--out", "new.png", "--parts", "all"], "--parts: applies only to"),
        (["design.json", "--out", "."], ".: must end in .csv, .glb, .html, .mjcf, .npz"),
        (["design.json", "--out", ".", "--format", "png"], "--out: must be a regular file if it exists, but got ."),
        (["design.json", "--out", ".", "--format", "kit"], "or that of a kit, but . holds half.json"),
        (["design.json", "--out", "half.json", "--format", "kit"], "must be a folder for this format"),
        (["design.json", "--out", ".", "--format", "brackets"], "or one of STL files, but . holds design.json"),
        (["design.json", "--out", "new", "--format", "kit", "--angle-step", "0"], "is not in the range 0.1<=x<=45"),
        (["design.json"], "Missing option '--out'"),
    ],
)
def test_bad_input_is_status_two_and_writes_nothing(command, tmp_path, words, said):
    assert said in refused("export", *words)
    assert {path.name for path in tmp_path.iterdir()} == {"design.json", "half.json"}


@pytest.mark.parametrize(("library", "name"), [("matplotlib", "new.png"), ("pyarrow", "new.parquet")])
def test_without_a_library_the_answer_is_how_to_install_it(command, tmp_path, library, name):
    """In a process that never had it: pandas loads parts of pyarrow where it is first of use."""
    code = f"import sys; sys.modules[{library!r}] = None; from topo_search.__main__ import main; main()"
    words = [sys.executable, "-c", code, "export", "design.json", "--out", name]
    result = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 2
    assert result.stderr.endswith(f'needs {library}, which is not installed; run: pip install "topo-search[viz]"\n')
    assert not (tmp_path / name).exists()


def test_a_kit_is_a_folder_that_is_written_whole_again(command, kit, tmp_path):
    made, result = kit
    assert result.stdout == f"the kit is in {made}\n"
    kit = shutil.copytree(made, tmp_path / "lab/kit")
    names = [str(path.relative_to(kit)) for path in kit.rglob("*") if path.is_file()]
    assert read_json(Design, kit / "design.json") == read_json(Design, CLEAR)
    before = {name: (kit / name).read_bytes() for name in names}
    (kit / "rotors.csv").write_text("old")
    command(CLEAR, "--format", "kit", "--out", "lab/kit")
    assert {name: (kit / name).read_bytes() for name in names} == before


def test_a_kit_says_what_the_audit_found_of_its_brackets(command, kit, tmp_path):
    folder, result = kit
    assert "Brackets" not in result.stderr
    assert "Brackets are audited clear of all airflow and rotors" in (folder / "assembly.html").read_text()
    design = read_json(Design, CLEAR)
    for circle, status, found in (
        (0.12, 1, "the bracket of module 1 and rotors of module"),
        (0.5, 2, "must be smaller"),
    ):
        module = design.task.module.model_copy(update={"bracket": Bracket(bolt_circle=circle)})
        other = design.model_copy(update={"task": design.task.model_copy(update={"module": module})})
        (tmp_path / "large.json").write_text(to_json(other))
        told = command("large.json", "--format", "kit", "--out", "large", status=status)
        assert found in " ".join(told.stderr.split())


def test_no_kit_is_written_whose_brackets_are_not_clear(command, tmp_path, monkeypatch):
    monkeypatch.setattr(compose, "brackets_note", lambda _: ("Brackets are not clear: change them.", False))
    told = command(CLEAR, "--format", "kit", "--out", "new", status=1).stderr
    assert told == "Brackets are not clear: change them.\nnothing is written\n"
    assert not (tmp_path / "new").exists()


def test_brackets_that_are_not_clear_are_told_with_smaller_ones_that_are():
    design = read_json(Design, CLEAR)
    found = {}
    for circle in (0.024, 0.12, 0.2):
        module = design.task.module.model_copy(update={"bracket": Bracket(bolt_circle=circle)})
        other = design.model_copy(update={"task": design.task.model_copy(update={"module": module})})
        found[circle] = compose.brackets_note(other)
    assert found[0.024][1]
    for circle in (0.12, 0.2):
        told, are_clear = found[circle]
        assert not are_clear
        table = re.findall(r"search again with module.bracket = (\{.*\})\.$", told)
        if table:
            sizes = Bracket.model_validate(tomllib.loads(f"bracket = {table[0]}")["bracket"])
            module = design.task.module.model_copy(update={"bracket": sizes})
            smaller = design.model_copy(update={"task": design.task.model_copy(update={"module": module})})
            assert compose.brackets_note(smaller)[1]
        else:
            assert "nor are smaller ones" in told


def test_parts_of_the_kit_are_exported_alone(command, kit, tmp_path):
    for name in ("allocation.json", "allocation.csv", "rotors.csv"):
        command(CLEAR, "--format", name.partition(".")[0], "--out", name)
        assert (tmp_path / name).read_bytes() == (kit[0] / name).read_bytes()


def test_more_rotors_than_px4_takes_are_refused_alone_and_left_out_of_a_kit(command, tmp_path, solved_push):
    (tmp_path / "push.json").write_text(to_json(solved_push))
    why = "PX4 takes at most 12 rotors, but the platform has 20; use allocation.json"
    assert why in refused("export", "push.json", "--out", "push.params")
    assert f"platform.params is left out: {why}" in command("push.json", "--format", "kit", "--out", "kit").stderr
    assert not (tmp_path / "kit/platform.params").exists()


def test_brackets_alone_take_the_place_of_older_ones(command, tmp_path):
    command("design.json", "--format", "brackets", "--out", "stl")
    name = "bracket_22.918deg.stl"
    names = {name, "tube-end_10mm.stl"}
    assert {path.name for path in (tmp_path / "stl").iterdir()} == names
    (tmp_path / "stl" / "bracket_02_old.stl").write_text("")
    again = command("design.json", "--format", "brackets", "--out", "stl")
    assert again.stdout == f"the brackets are in stl: {name}, tube-end_10mm.stl\n"
    assert {path.name for path in (tmp_path / "stl").iterdir()} == names


def test_a_kit_of_rounded_angles_says_what_rounding_changed(command, tmp_path, solved_push):
    (tmp_path / "push.json").write_text(to_json(solved_push))
    result = command("push.json", "--format", "kit", "--out", "kit", "--angle-step", "0.5")
    built = read_json(Design, tmp_path / "kit/design.json")
    steps = [math.degrees(alpha) / 0.5 for alpha in built.hinge_angles_rad]
    assert steps == pytest.approx([round(step) for step in steps], abs=1e-9)
    assert steps != pytest.approx([math.degrees(alpha) / 0.5 for alpha in solved_push.hinge_angles_rad], abs=1e-2)
    found, before = audit(built), audit(solved_push)
    assert all(row.status is Status.CLEAR for row in found.residuals)  # the inputs fit the new angles
    more = 100 * (built.objective / solved_push.objective - 1)
    least = [lower_text(1000 * min(pair.analytic_m for pair in each.pairs), 3) for each in (found, before)]
    said = (
        f"control effort {more:+.3g} %.",
        f"Audit: {found.verdict} (before: clear); smallest clearance {least[0]} mm (before: {least[1]} mm).",
    )
    page = (tmp_path / "kit/assembly.html").read_text()
    for text in said:
        assert text in result.stdout
        assert text in page
    assert {path.name for path in (tmp_path / "kit/brackets").glob("bracket*")} == {
        f"bracket_{abs(0.5 * round(step)):.3f}deg.stl" for step in steps
    }


def test_no_kit_is_written_of_a_design_that_is_not_clear(command, tmp_path):
    command("design.json", "--format", "kit", "--out", "new", status=1)
    assert not (tmp_path / "new").exists()


def test_where_no_rounding_is_clear_the_answer_names_the_largest_smaller_step_that_is(
    command, tmp_path, solved_push
):
    (tmp_path / "push.json").write_text(to_json(solved_push))
    for kind in ("kit", "sheet"):
        result = command("push.json", "--format", kind, "--out", "new", "--angle-step", "45", status=1)
        assert result.stderr.startswith("nothing is written: no rounding to 45 deg is clear: ")
        assert not (tmp_path / "new").exists()
        (step,) = re.findall(r"; choose ([0-9.]+) deg, which is\n$", result.stderr)
    command("push.json", "--format", "kit", "--out", "kit", "--angle-step", step)
    assert (tmp_path / "kit/design.json").exists()


def test_the_sheet_has_a_step_for_every_joint_and_its_numbers(command, tmp_path, solved_push):
    (tmp_path / "push.json").write_text(to_json(solved_push))
    command("push.json", "--out", "sheet.html")
    page = ElementTree.fromstring((tmp_path / "sheet.html").read_text().split("\n", 1)[1])
    text = " ".join("".join(page.itertext()).split())
    for step, ((h, i, a, b), alpha) in enumerate(
        zip(solved_push.topology.edges(), solved_push.hinge_angles_rad, strict=True), start=1
    ):
        assert f"Step {step}. Bolt port {b} ({PORT_NAMES[b]}) of module {i} to port {a}" in text
        assert f"to port {a} ({PORT_NAMES[a]}) of module {h}, at {math.degrees(alpha):+.3f} deg" in text
    rod = audit(solved_push).assembly.end_effector.rod
    assert f"the rod to {1000 * rod.length_m:.1f} mm" in text
    x, y, z = rod.direction_in_module
    out = {0: x, 1: y, 2: -x, 3: -y}[solved_push.mount.port]
    for length, words in ((out, ("outwards", "inwards")), (z, ("up", "down"))):
        assert f"{1000 * rod.length_m * abs(length):.1f} mm {words[length < 0]}" in text
