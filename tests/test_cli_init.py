"""`topo-search init`: the file that it writes is a task, and what it says of its fields is true."""

import re
from pathlib import Path
from typing import get_args

import pytest
from commands import invoke
from pydantic import BaseModel
from wording import says

from topo_search.model import LoadCase, ResolvedTask, Task
from topo_search.model.end_effector import CountedRod
from topo_search.model.exposure import EXPOSURE_KINDS, AnyExposure
from topo_search.model.flying import FLYING
from topo_search.model.task_file import read_task, task_template

EXAMPLES = (
    "rotor_out_torque|joint_moment|joint_force|tolerances|battery_Wh|speed|"
    "centre_margin|root_orientation_deg|lattice|hinge_step_deg|hinge_angles_deg|joint_mass|axis|within_deg|maximize"
)
"""Fields without a default, where the file has an example, and one from which loads derive."""
SLIPSTREAMS = {"airflow": {"regions": {}}}
"""Lines of `init` beside load cases and flight: envelopes against regions enclose the slipstreams."""


@pytest.fixture
def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("options", [(), ("--full",)])
def test_the_file_is_a_task_in_which_all_but_the_load_cases_is_the_default(in_folder: Path, options) -> None:
    invoke("init", "window.toml", *options)
    task = read_task("window.toml")
    module = {"torque_coefficient": 3.1e-9, "max_thrust": 3.2, **SLIPSTREAMS}
    assert task == Task(name="window", modules=3, load_cases=task.load_cases, module=module)
    assert set(task.flight.filled) == set(FLYING)
    assert 0.35 < task.module.figure_of_merit(task.air_density) < 0.8
    assert len(task.load_cases) == 2


def test_fields_that_are_taken_out_of_their_comments_say_what_their_default_was(in_folder: Path) -> None:
    invoke("init", "--full", "window.toml")
    before = read_task("window.toml").resolve(3)
    path = in_folder / "window.toml"
    defaults = rf"^# (?!{EXAMPLES})(\w+ = )"
    path.write_text(
        re.sub(defaults, r"\1", task_template("window", full=True).replace("# [", "["), flags=re.MULTILINE)
    )
    after = read_task("window.toml").resolve(3)
    assert len(after.exposure) == len(EXPOSURE_KINDS)
    module = before.module.model_copy(update={"bracket": before.module.bracket_sizes})  # a table says it is stated
    assert_same(after.model_copy(update={"exposure": ()}), before.model_copy(update={"module": module}))


def assert_same(after: BaseModel, before: BaseModel) -> None:
    """Equal, numbers to four digits: so many has a default that derives from other fields."""
    for field in type(after).model_fields:
        one, other = getattr(after, field), getattr(before, field)
        if isinstance(one, BaseModel):
            assert_same(one, other)
        elif isinstance(one, float) or field == "inertia":
            assert one == pytest.approx(other, rel=1e-3)
        else:
            assert one == other


def is_model(one: object) -> bool:
    return isinstance(one, type) and issubclass(one, BaseModel)


def test_every_field_is_explained() -> None:
    text = task_template("window", full=True)
    words = " ".join(re.sub(r"\n# +# ", " ", text).split())

    def fields(model: type[BaseModel]) -> set[tuple[str, str]]:
        found = set()
        for name, field in model.model_fields.items():
            if field.exclude:
                continue
            inside = next((one for one in get_args(field.annotation) if is_model(one)), field.annotation)
            meaning = " ".join((field.description or "").split())
            found |= fields(inside) if is_model(inside) else {(name, meaning)}
        return found

    missing = {
        name for name, _ in fields(Task) if not re.search(rf"^(# )?#? ?\[*(\w+\.)*{name}\b", text, re.MULTILINE)
    }
    explained = fields(LoadCase).union(*map(fields, (*get_args(AnyExposure), CountedRod)))
    untold = {name for name, meaning in fields(ResolvedTask) - explained if meaning not in words}
    assert untold - missing == {"name", "exposure"}  # they have words of their own
    assert missing == {
        "task_seed",  # belongs to the shipped random family alone
        *("frame", "frame_excess"),  # are read from a mesh
        *("grows", "port"),  # are of designs whose rod counts
        *("closures", "dropped", "reached", "towards"),  # are of designs
    }
    assert max(len(line) for line in text.splitlines()) <= 120


@pytest.mark.parametrize(
    ("file", "name"),
    [("a b(c).toml", "a-b-c-"), (".hidden.toml", "hidden"), ("ä.toml", "task"), (f"{'x' * 80}.toml", "x" * 64)],
)
def test_the_name_of_the_task_is_that_of_its_file_as_far_as_it_may_be(in_folder, file, name):
    invoke("init", file)
    assert read_task(file).name == name


def test_without_a_name_it_is_task_toml_and_what_is_there_is_not_replaced(in_folder: Path) -> None:
    assert invoke("init").stdout.endswith("topo-search check task.toml\n")
    (in_folder / "task.toml").write_text("mine")
    assert says(invoke("init", status=2).stderr, "task.toml:", "exists", "--force")
    assert (in_folder / "task.toml").read_text() == "mine"
    invoke("init", "--force")
    assert read_task("task.toml").name == "task"


def test_a_folder_that_cannot_be_written_is_bad_input(in_folder: Path) -> None:
    (in_folder / "file").write_text("")
    assert "FILE: must be writable" in invoke("init", "file/task.toml", status=2).stderr
