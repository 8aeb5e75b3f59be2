import csv
import json

import pytest

from topo_search.cli.experiment import NAMES
from topo_search.engine import Failed
from topo_search.experiments import Settings, experiment
from topo_search.experiments.cell import Variant, plan
from topo_search.experiments.folder import ABOUT, RESULTS, Results, about
from topo_search.experiments.measured import COLUMNS, Measured, failed
from topo_search.model import BadInput

SETTINGS = Settings(tasks=(("push", (3,)),), topologies=(3, 3), starts=1)


def asked(**changes):
    settings = SETTINGS.changed(**changes)
    return about("scaling", settings.as_json(), f"topo-search experiment scaling {settings.as_options()}")


def cells():
    return plan(SETTINGS, (Variant("one, two"),), first=True)


def row_of(cell):
    return Measured(**cell.identity, status="feasible", objective=0.1 + 0.2, worst_constraint="load case 0, torque")


def test_rows_are_kept_as_they_are(tmp_path):
    first, second, _ = cells()
    with Results.opened(tmp_path, asked()) as rows:
        rows.add(row_of(first))
        rows.add(failed(second, Failed("timeout", "still running, after a day")))
        assert [rows.has(cell) for cell in cells()] == [True, True, False]
    with (tmp_path / RESULTS).open(newline="") as stream:
        kept = list(csv.DictReader(stream))
    assert [row["key"] for row in kept] == [first.key, second.key]
    assert float(kept[0]["objective"]) == 0.1 + 0.2
    assert kept[0]["variant"] == "one, two"
    assert kept[0]["worst_constraint"] == "load case 0, torque"
    assert kept[1]["status"] == "failed"
    assert kept[1]["worst_constraint"] == "still running, after a day"
    with Results.opened(tmp_path, asked()) as rows:
        assert [rows.has(cell) for cell in cells()] == [True, True, False]


@pytest.mark.parametrize("kept", [0, 1, 20])
def test_a_torn_row_is_cut_off_and_no_other(tmp_path, kept):
    first, second, _ = cells()
    with Results.opened(tmp_path, asked()) as rows:
        rows.add(row_of(first))
        whole = (tmp_path / RESULTS).read_bytes()
        rows.add(row_of(second))
    torn = (tmp_path / RESULTS).read_bytes()[: len(whole) + kept]
    (tmp_path / RESULTS).write_bytes(torn)
    with Results.opened(tmp_path, asked()) as rows:
        assert (tmp_path / RESULTS).read_bytes() == whole
        assert [rows.has(cell) for cell in cells()] == [True, False, False]


def test_a_kill_before_the_first_row_leaves_a_folder_to_go_on_with(tmp_path):
    with Results.opened(tmp_path, asked()):
        pass
    (tmp_path / RESULTS).unlink()
    with Results.opened(tmp_path, asked()) as rows:
        rows.add(row_of(cells()[0]))
    assert (tmp_path / RESULTS).read_text().splitlines()[0] == ",".join(COLUMNS)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"starts": 2}, "holds an experiment with starts 1, not 2"),
        ({"seed": 7}, "holds an experiment with seed 0, not 7"),
        ({"distances": (0.3,)}, r"holds an experiment with distances \[\], not \[0.3\]"),
        ({"topologies": (3, 4)}, r"holds an experiment with topologies \[3, 3\], not \[3, 4\]"),
        ({"tasks": (("push", (4,)),)}, "holds an experiment with tasks"),
        ({"time_limit": 1.0}, "holds an experiment with time_limit 600.0, not 1.0"),
    ],
)
def test_a_folder_with_other_options_is_refused_by_their_name(tmp_path, changes, words):
    with Results.opened(tmp_path, asked()) as rows:
        rows.add(row_of(cells()[0]))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(BadInput, match=words), Results.opened(tmp_path, asked(**changes)):
        pass
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name in (RESULTS, ABOUT)} == {
        name: content for name, content in before.items() if name in (RESULTS, ABOUT)
    }


def test_other_experiments_programs_and_versions_are_refused(tmp_path):
    with Results.opened(tmp_path, asked()):
        pass
    other = {**asked(), "experiment": "ablation"}
    with (
        pytest.raises(BadInput, match="holds the experiment scaling, not ablation"),
        Results.opened(tmp_path, other),
    ):
        pass
    held = json.loads((tmp_path / ABOUT).read_text())
    held["versions"]["casadi"] = "1.0"
    (tmp_path / ABOUT).write_text(json.dumps(held))
    with pytest.raises(BadInput, match='holds results of version casadi "1'), Results.opened(tmp_path, asked()):
        pass
    (tmp_path / ABOUT).write_text('{"format": "something"}')
    with pytest.raises(BadInput, match="of another program"), Results.opened(tmp_path, asked()):
        pass
    (tmp_path / ABOUT).unlink()
    with pytest.raises(BadInput, match="but no about"), Results.opened(tmp_path, asked()):
        pass


def test_results_of_another_program_are_left_as_they_are(tmp_path):
    with Results.opened(tmp_path, asked()):
        pass
    for content in ("", "a,b\n1,2"):
        (tmp_path / RESULTS).write_text(content)
        with pytest.raises(BadInput, match="with other columns"), Results.opened(tmp_path, asked()):
            pass
        assert (tmp_path / RESULTS).read_text() == content


def test_what_made_the_rows_is_said_without_where(tmp_path):
    with Results.opened(tmp_path, asked()):
        pass
    text = (tmp_path / ABOUT).read_text()
    held = json.loads(text)
    assert held["command"] == (
        "topo-search experiment scaling --task push:3 --topologies 3,3 --starts 1 --seed 0 --time-limit 600"
    )
    assert {"date", "python", "machine", "cores", "versions", "settings"} <= set(held)
    assert str(tmp_path) not in text


@pytest.mark.parametrize("name", NAMES)
def test_settings_come_back_from_files_and_options(name):
    for settings in (experiment(name).full, experiment(name).small, SETTINGS.changed(distances=(0.22, 0.3))):
        assert Settings.from_json(json.loads(json.dumps(settings.as_json()))) == settings
        words = settings.as_options().split()
        assert tuple(Settings.task_of(word) for word in words[1::2] if ":" in word) == settings.tasks


def test_the_command_has_all_digits():
    options = SETTINGS.changed(distances=(0.2200001, 3.0), time_limit=1234567.5).as_options()
    assert "--distances 0.2200001,3 " in options
    assert options.endswith("--time-limit 1234567.5")


@pytest.mark.parametrize("name", ["scaling", "ablation"])
def test_the_full_setting_is_the_paper_s(name):
    sizes = {n for _, of in experiment(name).full.tasks for n in of}
    assert sizes == set(range(10, 101, 10))
    assert [experiment(name).full.trees(n) for n in (10, 40, 50, 100)] == [50, 50, 10, 10]
    assert len(experiment("scaling").full.tasks) == 4


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tasks": (("pusch", (3,)),)}, "--task: must name a shipped example, but got pusch; did you mean `push`"),
        ({"tasks": (("push", (0,)),)}, "--sizes: must be positive and finite, but got 0"),
        ({"topologies": (0, 1)}, "--topologies: must be positive and finite, but got 0"),
        ({"distances": (float("nan"),)}, "--distances: must be positive and finite, but got nan"),
    ],
)
def test_settings_that_cannot_be_are_refused(changes, words):
    with pytest.raises(BadInput, match=words):
        SETTINGS.changed(**changes)
