"""A wrong task file gets one message per fault: the field's path, the rule, the value given."""

import pickle
import re
import tomllib
from importlib import resources
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from nlp_cases import HOVER
from wording import told

from topo_search.model import BadInput, Fault, Task
from topo_search.model.files import validate
from topo_search.model.flying import with_older_defaults
from topo_search.model.task_file import examples, read_task

TASK = """
name = "t"
modules = 5
[[load_cases]]
com = { force = [0.0, 0.0, 1.0] }
"""
TEN = 'name = "t"\nmodules = 5\ntask_seed = 0\nload_cases = "ten-wrenches"\n'
CAPSULE = '[[exposure]]\nkind = "directional"\n'
CONE = '[[exposure]]\nkind = "exterior"\n'
KIND = 'must be one of "local", "directional", "exterior", "allowed", but got'
NAME = "must be 1 to 40 letters, digits, spaces and any of . _ + -, a letter or digit first"
FORMS = "must have either `segments`, or `polylines`, or `along` with `length`, but got"


def messages(tmp_path: Path, text: str, *settings: str) -> list[str]:
    path = tmp_path / "task.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadInput) as caught:
        read_task(path, settings)
    assert str(caught.value).splitlines() == [f"{caught.value.source}: {fault}" for fault in caught.value.faults]
    return [str(fault) for fault in caught.value.faults]


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        # unknown names
        ("[search]\nmargn = 1", "search.margn: unknown field; did you mean `margin`?"),
        ("[module]\ngravity = 3.7", "module.gravity: unknown field; `gravity` is a field of the file, not of..."),
        # ranges
        ("[module]\nmass = -1", "module.mass: must be greater than 0, but got -1"),
        (
            "[module]\nmax_thrust = 2.0\nmax_thrust_to_weight = 2.5",
            "module.max_thrust: must agree with max_thrust_to_weight = 2.5, which is 1.472 N per rotor, "
            "but got 2.0: leave one of them out",
        ),
        (
            "[module]\nmin_input = 0.5\n[goals]\npeak_input = [0.9, 0.4]",
            "module.min_input: must be less than the largest share that rotors may use, 0.4, but got 0.5",
        ),
        ("[module]\narm_length = nan", "module.arm_length: must be a finite number, but got NaN"),
        ("[module.body]\ninertia = [1, 1, 3]", "module.body.inertia: no moment may exceed the sum of the..."),
        (CAPSULE + "segments = [[0, 0, 0]]", "exposure[0].segments[0]: must have a direction, but got [0, 0, 0]"),
        (
            "[[load_cases]]\nname = 'a\\nb'\ncom = { force = [0, 0, 1] }",
            f'load_cases[1].name: {NAME}, but got "a\\\\nb"',
        ),
        (
            "[[load_cases]]\nname = 'push'\ncarries_weight = true\n" * 2,
            'load_cases[2].name: must differ from that of load_cases[1], but got "push"',
        ),
        (CAPSULE + "segments = []", "exposure[0].segments: must have at least one entry, but got []"),
        # types
        ("[module]\nmass = '0.2'", 'module.mass: must be a number, but got "0.2"'),
        ("[search]\nbody_clearance = true", "search.body_clearance: must be a length or false, but got true"),
        ("[[exposure]]\nkind = 'locl'", f'exposure[0].kind: {KIND} "locl"'),
        ("[[exposure]]\nradius = 0.1", "exposure[0].kind: is required, but missing"),
        # rules between fields
        (CAPSULE, f"exposure[0]: {FORMS} none of them"),
        (
            CAPSULE + "along = 'end_effector'\nlength = 1\n[end_effector]\nposition = [0, 0, 0.005]",
            "exposure[0]: takes its direction from p_E: `||end_effector.position|| >= 0.01` must hold, "
            "but got [0.0, 0.0, 0.005]",
        ),
        (
            "[search]\ninterference = 'parts'\n[tolerances]\nposition = 1e-3",
            'search.interference: must be "airflow" if clearances must survive [tolerances], which is not '
            'proven for parts, but got "parts"',
        ),
    ],
)
def test_a_fault_gets_one_message(tmp_path: Path, more: str, expected: str | list[str]) -> None:
    found = messages(tmp_path, TASK + more)
    assert told(found, [expected] if isinstance(expected, str) else expected), found


MISSING = "is required, but missing"
NOT_TEN = 'task_seed: must be left out unless load_cases = "ten-wrenches", but got 4'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        *(
            (TASK.replace("= 5", f"= {modules}"), [f"modules: {rule}"])
            for modules, rule in (
                ("0", "must be at least 1, but got 0"),
                ("[4, 5, 6]", "must be a whole number of modules or [fewest, most], but got [4, 5, 6]"),
                ("[6, 4]", "`fewest <= most` must hold, but got [6, 4]"),
            )
        ),
        (
            TASK.replace("= 5", "= [0, 4.5]"),
            ["modules[0]: must be at least 1...", "modules[1]: must be a whole..."],
        ),
        ("", [f"{name}: {MISSING}" for name in ("name", "modules", "load_cases")]),
        ('name = "t"\nmodules = 5\nload_cases = []', ["load_cases: must have at least one entry, but got []"]),
        *(
            (TASK.replace('"t"', f'"{name}"'), ["name: must be 1 to 64 letters, digits, dots, dashes and..."])
            for name in ("", "../x", "x" * 65)
        ),
        (TEN.replace("task_seed = 0\n", ""), ["task_seed: must be given with load_cases..."]),
        ("task_seed = 4\n" + TASK, [NOT_TEN]),
        (TASK + "weight = 0.0\n", ["load_cases: must have a weight greater than 0 in at least one entry..."]),
        (TASK[: TASK.index("force") + 3], ["is not a TOML file, or only a part of one: ..."]),
    ],
)
def test_a_file_gets_a_message_per_fault(tmp_path: Path, text: str, expected: list[str]) -> None:
    found = messages(tmp_path, text)
    assert told(found, expected), found


PUSHING = {"end_effector": {"force": [0.2, 0.0, 1.0]}}
CARRIED = {"units": "SI", "com": {"force": [0.0, 0.0, 8.0]}}
FORCES = {"axis": [1.0, 0.0, 0.0], "half_angle_deg": 20.0, "force": 0.2}


@pytest.mark.parametrize(
    ("fields", "fault"),
    [
        ({"goals": {"clearance": [1e-3, 1e-3]}}, "goals.clearance: must all be different, but got [0.001, 0.001]"),
        (
            {"goals": {"modules": True}},
            "goals.modules: needs a range of sizes, [fewest, most], but got modules = 5",
        ),
        (
            {"goals": {"clearance": [1e-3]}, "modules": [4, 5], "load_cases": [CARRIED, HOVER]},
            'load_cases[1].units: must be "SI" to compare efforts of several sizes, but got "weight"',
        ),
        (
            {"flight": {"force_reserve": 0.2}, "goals": {"force_reserve": [0.1, 0.3]}},
            "flight.force_reserve: must be left out if goals.force_reserve has levels of it, but got 0.2",
        ),
        ({"goals": {"speed": [1.0]}}, "goals.speed: needs an exposure"),
        *(
            ({"load_cases": [{"name": "push", **PUSHING}, {"name": "hover", **HOVER}], "end_effector": rod}, fault)
            for rod, fault in (
                ({"within_deg": 10.0}, "end_effector.within_deg: must be left out without `axis`, but got 10"),
                (
                    {"axis": [0, 0, 1], "within_deg": 0.0},
                    "end_effector.within_deg: must be greater than 0, but got 0",
                ),
                (
                    {"axis": [0, 0, 1], "within_deg": 91.0},
                    "end_effector.within_deg: must be at most 90, but got 91",
                ),
                ({"axis": [0, 0, 0]}, "end_effector.axis: must have a direction, but got [0, 0, 0]"),
                ({"axis": "up"}, 'end_effector.axis: must be "force" or [x, y, z], but got "up"'),
                (
                    {"axis": [0, 0, 1], "rod": "none"},
                    'end_effector.axis: must be left out with rod = "none", but got [0.0, 0.0, 1.0]',
                ),
                (
                    {"axis_case": "push"},
                    'end_effector.axis_case: must be left out unless axis = "force", but got "push"',
                ),
                (
                    {"axis": [0, 0, 1], "axis_case": "push"},
                    'end_effector.axis_case: must be left out unless axis = "force", but got "push"',
                ),
                *(
                    (
                        {"axis": "force", "axis_case": name},
                        "end_effector.axis_case: must mean a load case with a force at the end-effector, "
                        f'but got "{name}"',
                    )
                    for name in ("pull", "hover")
                ),
            )
        ),
        (
            {"end_effector": {"axis": "force"}},
            'end_effector.axis: must mean a load case with a force at the end-effector, but got "force"',
        ),
        *(
            ({"flight": flight}, f"flight.{fault}")
            for flight, fault in (
                ({"force_reserve": -0.1}, "force_reserve: must be at least 0, but got -0.1"),
                ({"force_reserve": 1e15}, "force_reserve: must be at most 1e+15 N and N m, but got 1e+15 weights"),
            )
        ),
        *(
            ({"load_cases": [{"carries_weight": True, **case}]}, f"load_cases{fault}")
            for case, fault in (
                ({"cone": {**FORCES, "axis": [0, 0, 0]}}, "[0].cone.axis: must have a direction, but got"),
                ({"vertices": [{"forces": [1, 0, 0]}]}, "[0].vertices[0].forces: unknown field; did you"),
                (
                    {"vertices": [{"force": [1e-3 * k, 0, 0]} for k in range(1, 201)]},
                    ": must have at most 200 entries, corners of sets included, but got 201",
                ),
            )
        ),
    ],
)
def test_a_fault_of_goals_reserves_and_sets_gets_one_message(fields: dict[str, object], fault: str) -> None:
    with pytest.raises(BadInput) as caught:
        validate(Task, with_older_defaults({"name": "t", "modules": 5, "load_cases": [HOVER], **fields}), "t")
    assert [str(one)[: len(fault)] for one in caught.value.faults] == [fault]


def test_all_faults_are_told_at_once_and_each_once(tmp_path: Path) -> None:
    text = TASK.replace("= 5", "= 0") + "gravty = 3\n[module]\nmass = -1\n[search]\nroot = 'x'"
    assert messages(tmp_path, text) == [
        "modules: must be at least 1, but got 0",
        "module.mass: must be greater than 0, but got -1",
        "load_cases[0].gravty: unknown field; "
        "valid names are name, units, end_effector, com, carries_weight, grows, contact, weight, cone, vertices",
        'search.root: must be "free" or "paper", but got "x"',
    ]
    text = "task_seed = 4\n" + TASK.replace("= 5", "= [6, 4]") + CONE + "[end_effector]\nposition = 'com'"
    assert [message.split(":")[0] for message in messages(tmp_path, text)] == [
        "modules",
        "task_seed",
        "exposure[0]",
    ]


def test_a_name_that_is_no_task_is_told_with_those_near_it() -> None:
    with pytest.raises(BadInput, match="psuh: no such file, nor a shipped example; did you mean `push`"):
        read_task("psuh")
    with pytest.raises(BadInput, match="nor a shipped example; valid names are battery-module, "):
        read_task("zzz")


def test_a_byte_order_mark_and_windows_line_ends_are_no_fault(tmp_path: Path) -> None:
    path = tmp_path / "task.toml"
    path.write_bytes(b"\xef\xbb\xbf" + TASK.replace("\n", "\r\n").encode())
    assert read_task(path).n == 5


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("search.margn=1", "search.margn: unknown field; did you mean `margin`?"),
        ("a..b=5", 'must be FIELD=VALUE, but got "a..b=5"'),
        ("modules.0=2", "modules.0: `modules` must be a table or a list to have fields, but got 5"),
    ],
)
def test_wrong_settings(setting: str, expected: str) -> None:
    with pytest.raises(BadInput) as caught:
        read_task("push", (setting,))
    found = [str(fault) for fault in caught.value.faults]
    assert told(found, [expected]), found


def test_settings_override_any_field() -> None:
    settings = (
        "search.body_clearance=false",
        "search.margin = 1e-3",
        "search.root=paper",
        "modules=[4,6]",
        "load_cases.0.weight=2",
        "load_cases[2].com.force=[0, 0, 2]",
        "module.airflow.reach=1",
        'exposure=[{kind="local", radius=0.2}]',
        "exposure.0.radius=0.3",
        "end_effector.position=com",
    )
    task = read_task("push", settings)
    assert task.search.body_clearance is False
    assert task.search.margin == 1e-3
    assert task.search.root == "paper"
    assert task.sizes == range(4, 7)
    assert [case.weight for case in task.load_cases if not isinstance(case, str)] == [2, 1, 1]
    assert task.load_cases[2].at_com.force == (0, 0, 2)  # type: ignore[union-attr]
    assert task.module.airflow.reach == 1
    assert task.exposure[0].radius == 0.3  # type: ignore[union-attr]
    assert task.end_effector.fixed_position == (0, 0, 0)
    assert read_task("push", ("modules=4",)).n == 4
    assert read_task("ten-wrenches", ("task_seed=4",)).task_seed == 4
    assert read_task("push", ("module.connector_distance=0.30",)).module.connector_distance == 0.3


def test_bad_input_crosses_processes() -> None:
    error = BadInput("file", [Fault("a.b", "must be 1, but got 2"), Fault("", "is empty")])
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) == "file: a.b: must be 1, but got 2\nfile: is empty"
    assert again.faults == error.faults


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)
FIELDS = ["name", "modules", "gravity", "task_seed", "module", "end_effector", "load_cases", "exposure", "search"]


def faults_in(data: dict[str, object]) -> list[Fault]:
    """Read a task; if it is one, also resolve it, which may not fail then."""
    try:
        task = validate(Task, with_older_defaults(data), "data")
    except BadInput as error:
        return error.faults
    task.resolve(task.sizes[0])
    return []


@given(st.dictionaries(st.sampled_from([*FIELDS, "other", "<list>"]), anything))
def test_any_data_is_a_task_or_told_what_is_wrong(data: dict[str, object]) -> None:
    paths = [fault.path for fault in faults_in(data)]
    assert len(set(paths)) == len(paths)
    missing = {"name", "modules", "load_cases"} - set(data)
    assert missing <= set(paths)


@given(st.sampled_from(examples()), st.sampled_from(FIELDS), anything)
def test_a_spoilt_example_is_refused_for_the_spoilt_field(name: str, field: str, value: object) -> None:
    text = (resources.files("topo_search") / "examples" / f"{name}.toml").read_text()
    faults = faults_in({**tomllib.loads(text), field: value})
    beside = {"load_cases": "task_seed", "search": "module"}  # rotors that lean need search.interference
    spoilt = {field, beside.get(field, field)}
    assert {re.split(r"[.\[]", fault.path)[0] for fault in faults} <= spoilt
