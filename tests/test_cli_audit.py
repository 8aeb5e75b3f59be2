"""`topo-search audit` on designs of anyone: folders, tables, summaries, and files that mean harm."""

import csv
import json
import os
from functools import partial

import pytest
import toy_problem
from commands import invoke, refused
from verify_cases import changed, fan
from wording import says

import verify
from topo_search import compose
from topo_search.engine import Job
from topo_search.export.audits import flight_lines
from topo_search.limits import LIMITS
from topo_search.model import Audit, Topology
from topo_search.model.files import to_json
from topo_search.report.design_part import errors, power

CLEAR = fan({"exposure": [{"kind": "local", "radius": 0.15}]})
OVERLAPPING = fan(hinges=(0.0, 0.0))
DATA = json.loads(to_json(CLEAR))
COLUMNS = "kind,a,b,segment,status,lower_m,upper_m,analytic_m,level,percent,design,rotor"


@pytest.fixture
def command(in_process, tmp_path, monkeypatch):
    """The audit command in this process, with the real audit, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return partial(invoke, "audit")


def write(path, design=CLEAR):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(to_json(design))


# ---- folders


def test_a_folder_stands_for_all_designs_below_it(command, tmp_path):
    write(tmp_path / "run" / "designs" / "b.json")
    write(tmp_path / "run" / "designs" / "a.json", OVERLAPPING)
    write(tmp_path / "run" / "best.json")
    (tmp_path / "run" / "audits").mkdir()
    (tmp_path / "run" / "audits" / "a.json").write_text(to_json(verify.audit(CLEAR)))
    (tmp_path / "run" / "candidates.csv").write_text("key\n")
    result = command("run", status=1)
    heads = [line.split(":")[0] for line in result.stdout.splitlines() if not line.startswith(" ")]
    files = ["run/best.json", "run/designs/a.json", "run/designs/b.json"]
    assert heads == [*files, "3 designs", "1 audit in the folders skipped"]
    assert "3 designs: 2 clear, 1 violated" in result.stdout
    assert [each["file"] for each in json.loads(command("run", "--json", status=1).stdout)] == files
    assert json.loads(command("run/audits", "--json").stdout) == []


def test_an_audit_that_is_given_is_no_design(command, tmp_path):
    (tmp_path / "audit.json").write_text(to_json(verify.audit(CLEAR)))
    assert (
        command("audit.json", status=2).stderr
        == 'audit.json: format: must be "topo-search/design", but got "topo-search/audit"\n'
    )


def test_what_cannot_be_read_in_a_folder_is_named_and_the_rest_is_audited(command, tmp_path):
    write(tmp_path / "in" / "good.json")
    (tmp_path / "in" / "half.json").write_text(to_json(CLEAR)[:200])
    (tmp_path / "in" / "broken link.json").symlink_to("nowhere")
    result = command("in", status=2)
    assert "in/good.json: clear" in result.stdout
    assert "1 design: 1 clear, 2 bad input" in result.stdout
    said = dict(line.split(": ", 1) for line in result.stderr.splitlines())
    assert said["in/broken link.json"] == "no such file"
    assert said["in/half.json"].startswith("is not a JSON file, or only a part of one")
    assert len(said) == 2


def test_a_folder_without_designs_is_bad_input(command, tmp_path):
    (tmp_path / "empty").mkdir()
    assert command("empty", status=2).stderr == "empty: must contain designs, but no file below it ends in .json\n"
    assert command("nowhere", status=2).stderr == "nowhere: no such file\n"


def test_designs_come_back_in_order_from_worker_processes_and_a_crash_is_one_design_s(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(compose.binding, "BACKENDS", toy_problem.BACKENDS)
    task = toy_problem.toy_task(3).resolve(3)
    keys = ["aa00", "a110", "a500", "a300"]
    for key in keys:
        write(
            tmp_path / f"{key}.json", toy_problem.solve(Job(task, Topology.from_key(key), starts=range(1), seed=0))
        )
    monkeypatch.setenv("TOY_AUDIT_SEGFAULT", "a110")
    monkeypatch.setenv("TOY_VIOLATED", "a300")
    result = invoke("audit", *(f"{key}.json" for key in keys), "--workers", "2", status=1)
    assert [line.replace(", 0 clearances", "") for line in result.stdout.splitlines()] == [
        "aa00.json: clear",
        "a500.json: clear",
        "a300.json: violated",
        "4 designs: 2 clear, 1 violated, 1 failed",
    ]
    assert says(result.stderr, "a110.json", "audit failed", "SIGSEGV")


# ---- tables and summaries


def test_the_table_holds_every_clearance_of_every_design(command, tmp_path):
    write(tmp_path / "one.json")
    write(tmp_path / "two.json", OVERLAPPING)
    command("one.json", "two.json", "--csv", "pairs.csv", status=1)
    text = (tmp_path / "pairs.csv").read_text()
    assert text.splitlines()[0] == COLUMNS
    rows = list(csv.DictReader(text.splitlines()))
    for name, design in (("one.json", CLEAR), ("two.json", OVERLAPPING)):
        mine = [row for row in rows if row["design"] == name]
        pairs = verify.audit(design).pairs
        assert [(row["kind"], int(row["a"]), int(row["b"]), row["status"]) for row in mine] == [
            (pair.kind, pair.a, pair.b, pair.status) for pair in pairs
        ]
        assert [float(row["analytic_m"]) for row in mine] == [pair.analytic_m for pair in pairs]
        assert [row["lower_m"] == "" for row in mine] == [pair.status == "violated" for pair in pairs]


def test_an_audit_is_six_lines_and_the_rest_with_details(command, tmp_path):
    given = fan({"tolerances": {"hinge_angle_deg": 0.1}, "load_cases": [{"com": {"force": [0.0, 0.0, 1.2]}}]})
    write(tmp_path / "good.json", given)
    write(tmp_path / "bad.json", changed(OVERLAPPING, objective=2 * OVERLAPPING.objective))
    audited = verify.audit(given)
    short, details = (command("good.json", *more).stdout.splitlines() for more in ([], ["--details"]))
    words = ("good.json: clear", "closest pair: ", "side force ", "tilt ", "rotor failures ", "load until ")
    assert len(short) == len(words)
    assert all(line.lstrip().startswith(word) for line, word in zip(short, words, strict=True))
    assert details[: len(short)] == short
    assert {f"  {line}" for line in flight_lines(audited.flight)} <= set(details)
    (hinges, *_), (hover, *_) = errors(audited).rows, power(audited).rows
    for row in (hinges, hover):
        assert any(all(cell in line for cell in row) for line in details)
    said = command("bad.json", status=1).stdout
    assert "  airflow of modules 0 and 1: violated, -" in said
    assert "  control effort J: violated, off by " in said


def test_an_output_that_cannot_be_written_is_refused_before_the_work(command, tmp_path):
    write(tmp_path / "one.json")
    assert refused("audit", "one.json", "--csv", "one.json/deeper").startswith("--csv: must be writable")


# ---- files that mean harm


def text(**fields):
    return json.dumps({**DATA, **fields}).encode()


def replaced(old, new):
    content = to_json(CLEAR)
    assert old in content
    return content.replace(old, new, 1).encode()


HARM = {
    "binary": (bytes(range(256)) * 50, "must be UTF-8 text, but got the byte 0x80 at offset 128"),
    "NaN": (text(objective=float("nan")), "objective: must be a finite number, but got NaN"),
    "a million faults": (text(hinge_angles_rad=[None] * 10**6), "has 1,000,000"),
    "an escape sequence": (replaced('"name": "case"', '"name": "\\u001b[2J"'), "task.name"),
}


@pytest.mark.parametrize("name", HARM)
def test_a_file_that_means_harm_is_refused_with_the_reason(command, tmp_path, monkeypatch, name):
    monkeypatch.setattr(compose.binding, "BACKENDS", toy_problem.BACKENDS)
    content, said = HARM[name]
    (tmp_path / "harm.json").write_bytes(content)
    write(tmp_path / "good.json")
    result = command("harm.json", "good.json", status=2)
    assert said in result.stderr
    assert all(line.startswith("harm.json: ") and len(line) < 300 for line in result.stderr.splitlines())
    assert all(line.isprintable() for line in result.stderr.splitlines())
    assert result.stdout.splitlines()[0].startswith("good.json: clear")


def test_a_file_of_a_gigabyte_is_not_read(command, tmp_path):
    with (tmp_path / "huge.json").open("wb") as stream:
        stream.truncate(2**30)
    result = command("huge.json", "/dev/zero", status=2)
    assert result.stderr.splitlines() == [
        f"huge.json: must have at most {LIMITS.design_bytes:,} bytes, but has {2**30:,}",
        "/dev/zero: must be a regular file, but is a pipe or a device",
    ]


def test_the_json_of_one_file_is_the_audit_and_reads_back(command, tmp_path):
    write(tmp_path / "one.json", OVERLAPPING)
    given = json.loads(command("one.json", "--json", status=1).stdout)
    assert given["file"] == "one.json"
    found, again = Audit.model_validate(given), verify.audit(OVERLAPPING)
    assert (found.pairs, found.interference) == (again.pairs, again.interference)


def test_names_of_files_cannot_write_to_the_terminal(command, tmp_path):
    hostile = ["new\nline.json", "\x1b[31mred.json", os.fsdecode(b"\xff.json")]
    for name in hostile:
        write(tmp_path / "in" / name)
    (tmp_path / "in" / "\x1b[2Jbad.json").write_text("{")
    result = command("in", "--csv", "pairs.csv", status=2)
    assert "in/new\\nline.json: clear" in result.stdout
    assert "in/\\x1b[31mred.json: clear" in result.stdout
    assert "in/\ufffd.json: clear" in result.stdout
    assert result.stderr.startswith("in/\\x1b[2Jbad.json: ")
    assert "\x1b" not in (tmp_path / "pairs.csv").read_text(encoding="utf-8")
