import csv
import json
import os

import pytest
from benchmarks.keep_results import settings_of

from topo_search.cli.experiment import NAMES
from topo_search.engine import Failed
from topo_search.experiments import Settings, experiment, results
from topo_search.experiments.conducting import ABOUT, COLUMNS, RESULTS, CellResult, Results, failure_row, identify
from topo_search.experiments.plan import Variant, plan
from topo_search.limits import LIMITS
from topo_search.model import BadInput
from topo_search.study.directory import RunFile
from topo_search.study.ledger_file import LedgerLost

SETTINGS = Settings(tasks=(("push", (3,)),), topologies=(3, 3), starts=1)


def asked(**changes):
    settings = SETTINGS.override(**changes)
    return identify("scaling", settings.as_json(), f"topo-search experiment scaling {settings.as_options()}")


def begin(folder, held=None):
    """Open a folder for an experiment, and add no row."""
    with Results.open(folder, held or asked()):
        pass


def cells():
    return plan(SETTINGS, (Variant("one, two"),), first=True)


def row_of(cell):
    return CellResult(
        **cell.identity, status="feasible", objective=0.1 + 0.2, worst_constraint="load case 0, torque"
    )


def test_rows_are_kept_as_they_are(tmp_path):
    first, second, _ = cells()
    with Results.open(tmp_path, asked()) as rows:
        rows.add(row_of(first))
        rows.add(failure_row(second, Failed("timeout", "still running, after a day")))
        assert [rows.has(cell) for cell in cells()] == [True, True, False]
    with (tmp_path / RESULTS).open(newline="") as stream:
        kept = list(csv.DictReader(stream))
    assert [row["key"] for row in kept] == [first.key, second.key]
    assert float(kept[0]["objective"]) == 0.1 + 0.2
    assert kept[0]["variant"] == "one, two"
    assert kept[0]["worst_constraint"] == "load case 0, torque"
    assert kept[1]["status"] == "failed"
    assert kept[1]["worst_constraint"] == "still running, after a day"
    with Results.open(tmp_path, asked()) as rows:
        assert [rows.has(cell) for cell in cells()] == [True, False, False]  # what failed is tried again
        rows.add(row_of(second))
    with Results.open(tmp_path, asked()) as rows:
        assert [rows.has(cell) for cell in cells()] == [True, True, False]
    assert list(results(tmp_path)["status"]) == ["feasible", "feasible"]


@pytest.mark.parametrize("kept", [0, 1, 20])
def test_a_torn_row_is_cut_off_and_no_other(tmp_path, kept):
    first, second, _ = cells()
    with Results.open(tmp_path, asked()) as rows:
        rows.add(row_of(first))
        whole = (tmp_path / RESULTS).read_bytes()
        rows.add(row_of(second))
    (tmp_path / RESULTS).write_bytes((tmp_path / RESULTS).read_bytes()[: len(whole) + kept])
    with Results.open(tmp_path, asked()) as rows:
        assert (tmp_path / RESULTS).read_bytes() == whole
        assert [rows.has(cell) for cell in cells()] == [True, False, False]


def test_a_kill_before_the_first_row_leaves_a_folder_to_go_on_with(tmp_path):
    begin(tmp_path)
    (tmp_path / RESULTS).unlink()
    with Results.open(tmp_path, asked()) as rows:
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
    with Results.open(tmp_path, asked()) as rows:
        rows.add(row_of(cells()[0]))
    before = [(tmp_path / name).read_bytes() for name in (RESULTS, ABOUT)]
    with pytest.raises(BadInput, match=words):
        begin(tmp_path, asked(**changes))
    assert [(tmp_path / name).read_bytes() for name in (RESULTS, ABOUT)] == before


def test_other_experiments_programs_and_versions_are_refused(tmp_path):
    begin(tmp_path)
    other = {**asked(), "experiment": "ablation"}
    with pytest.raises(BadInput, match="holds the experiment scaling, not ablation"):
        begin(tmp_path, other)
    held = json.loads((tmp_path / ABOUT).read_text())
    held["versions"]["casadi"] = "1.0"
    (tmp_path / ABOUT).write_text(json.dumps(held))
    with pytest.raises(BadInput, match='holds results of version casadi "1'):
        begin(tmp_path)
    (tmp_path / ABOUT).write_text('{"format": "something"}')
    with pytest.raises(BadInput, match="of another program"):
        begin(tmp_path)
    (tmp_path / ABOUT).unlink()
    with pytest.raises(BadInput, match="but no about"):
        begin(tmp_path)


def test_results_of_another_program_are_left_as_they_are(tmp_path):
    begin(tmp_path)
    for content in ("", "a,b\n1,2"):
        (tmp_path / RESULTS).write_text(content)
        with pytest.raises(BadInput, match="with other columns"):
            begin(tmp_path)
        assert (tmp_path / RESULTS).read_text() == content


def test_what_made_the_rows_is_said_without_where(tmp_path):
    begin(tmp_path)
    text = (tmp_path / ABOUT).read_text()
    held = json.loads(text)
    assert held["command"] == (
        "topo-search experiment scaling --task push:3 --topologies 3,3 --starts 1 --seed 0 --time-limit 600"
    )
    assert {"date", "python", "machine", "cores", "versions", "settings"} <= set(held)
    assert str(tmp_path) not in text


@pytest.mark.parametrize("name", NAMES)
def test_settings_come_back_from_files_and_options(name):
    for settings in (experiment(name).full, experiment(name).small, SETTINGS.override(distances=(0.22, 0.3))):
        assert settings_of(json.loads(json.dumps(settings.as_json()))) == settings
        words = settings.as_options().split()
        assert tuple(Settings.task_of(word) for word in words[1::2] if ":" in word) == settings.tasks


def test_the_command_has_all_digits():
    options = SETTINGS.override(distances=(0.2200001, 3.0), time_limit=1234567.5).as_options()
    assert "--distances 0.2200001,3 " in options
    assert options.endswith("--time-limit 1234567.5")


@pytest.mark.parametrize("name", ["scaling", "ablation"])
def test_the_full_setting_is_the_paper_s(name):
    sizes = {n for _, of in experiment(name).full.tasks for n in of}
    assert sizes == set(range(10, 101, 10))
    assert [experiment(name).full.trees(n) for n in (10, 40, 50, 100)] == [50, 50, 10, 10]
    assert len(experiment("scaling").full.tasks) == 4


def rows_of(tmp_path):
    """A folder with two rows, and the path of its table."""
    with Results.open(tmp_path, asked()) as rows:
        for cell in cells()[:2]:
            rows.add(row_of(cell))
    return tmp_path / RESULTS


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (lambda text: text.replace(b"feasible", b"feas\xe9ble", 1), "must be UTF-8 text, but got the byte 0xe9"),
        (lambda text: text.replace(b"feasible", b"feas,ble", 1), "has 27 in line 2: it is damaged"),
        (
            lambda text: text.replace(b"feasible", b'fe"asible', 1).replace(b"one, two", b'one, "two', 1),
            "in line 2",
        ),
        (lambda text: text.replace(b"push,0.15", b"push,0.1z", 1), r'distance_m: .*, but got "0.1z" in line 2'),
        (
            lambda text: text.replace(b"push,0.15,3,", b"push,0.15,3.5,", 1),
            r'n: .* kind int, but got "3.5" in line 2',
        ),
        (lambda text: text.replace(b"push,0.15,3,", b"push,0.15,,", 1), r'n: .* kind int, but got "" in line 2'),
        (lambda text: text + b"x" * LIMITS.result_bytes, "must have at most 67,108,864 bytes, but has"),
    ],
)
def test_rows_that_are_none_are_named_and_left_as_they_are(tmp_path, harm, words):
    path = rows_of(tmp_path)
    path.write_bytes(harmed := harm(path.read_bytes()))
    with pytest.raises(BadInput, match=words):
        begin(tmp_path)
    assert path.read_bytes() == harmed


@pytest.mark.parametrize(
    "held", ["[1]", "{}", '{"format": "topo-search/experiment", "version": 1}', "1", '{"version": 1'] + [
        json.dumps({**asked(), group: value}) for group in ("settings", "versions") for value in ([], None, "x")
    ] + [json.dumps({**asked(), "settings": {"tasks": "x" * 5000}})],
)  # fmt: skip
def test_what_is_not_said_of_rows_is_named(tmp_path, held):
    path = rows_of(tmp_path)
    (tmp_path / ABOUT).write_text(held)
    before = path.read_bytes()
    with pytest.raises(BadInput) as refused:
        begin(tmp_path)
    assert ABOUT in str(refused.value) or "holds" in str(refused.value)
    assert len(str(refused.value)) < 1000
    assert path.read_bytes() == before


@pytest.mark.parametrize("name", [RESULTS, ABOUT])
def test_no_symbolic_link_is_followed_to_rows(tmp_path, name):
    rows_of(tmp_path)
    outside = tmp_path.with_name(f"{tmp_path.name} outside")
    (tmp_path / name).rename(outside)
    before = outside.read_bytes()
    (tmp_path / name).symlink_to(outside)
    with pytest.raises(BadInput, match=f"symbolic link in place of its {name}"):
        begin(tmp_path)
    assert outside.read_bytes() == before


VANISH = {
    "removed": lambda path: path.unlink(),
    "moved": lambda path: path.parent.rename(f"{path.parent} moved"),
    "emptied": lambda path: path.write_bytes(b""),
    "replaced": lambda path: (path.rename(f"{path}.old"), path.write_bytes(b"a\n")),
}


@pytest.mark.parametrize("harm", VANISH)
def test_rows_that_vanish_end_the_experiment_and_are_not_called_kept(tmp_path, harm):
    folder = tmp_path / "folder"
    first, second, _ = cells()
    with Results.open(folder, asked()) as rows:
        rows.add(row_of(first))
        VANISH[harm](folder / RESULTS)
        with pytest.raises(LedgerLost, match=r"results\.csv: was removed"):
            rows.add(row_of(second))


def test_what_a_killed_experiment_left_half_written_is_removed(tmp_path):
    rows_of(tmp_path)
    (tmp_path / RunFile.PARTIAL).write_text("half")
    begin(tmp_path)
    assert not (tmp_path / RunFile.PARTIAL).exists()


def test_a_pipe_is_no_table_to_be_read(tmp_path):
    os.mkfifo(tmp_path / RESULTS)
    with pytest.raises(BadInput, match="must be a regular file, but is a pipe"):
        results(tmp_path)
