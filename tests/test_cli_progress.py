"""What a command shows while it works: the plan, the stage, the incumbent and the time left."""

import importlib.util
import io
import os
import pty
import re
import statistics
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from random import Random

import nbformat
import pytest
import toy_problem
from nbclient import NotebookClient
from rich.console import Console
from toy_problem import toy_run

from topo_search.report.bar import Bar
from topo_search.report.progress import Lines, describe_plan
from topo_search.study import Phase, Plan, TimeLeft
from topo_search.study.progress import WRITING, audit_phase, duration, proof_phase

SEARCHING = Phase("searching", 3, 100, 24, seconds=2.0)
ROW = toy_problem.toy_row("a110", objective=4.0, gap=0.25)


def test_a_bar_shows_the_stage_the_incumbent_its_gap_and_the_count():
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=True, width=140)
    with Bar.show(console) as bar:
        bar.plan(Plan((SEARCHING, WRITING), workers=2))
        bar.phase(Phase("searching", 3, 2, 1, seconds=1.0))
        bar.settled(None)
        bar.settled(ROW)
        bar.note("something happened")
    shown = stream.getvalue()
    assert "best a110 J 4, gap 25.00 %" in shown
    assert "searching 3 modules" in shown
    assert "2/2" in shown
    assert "something happened" in shown
    assert "100 candidates" in shown


def test_plain_lines_come_now_and_then_without_control_characters(monkeypatch):
    now, lines = 0.0, list[str]()
    monkeypatch.setattr("topo_search.report.progress.time.monotonic", lambda: now)
    observer = Lines(lines.append)
    observer.plan(Plan((SEARCHING, WRITING), workers=2))
    observer.phase(SEARCHING)
    for _ in range(50):
        now += 1.0
        observer.settled(ROW)
    assert lines[1] == "searching 3 modules: 100 candidates, at most 24 starts each"
    assert re.fullmatch(
        r"searching 3 modules: 10 of 100, best a110 J 4, gap 25.00 %, about [89]\d s left", lines[2]
    )
    assert len(lines) == 2 + 5
    assert all(line.isprintable() for line in lines)


SEARCH = """
import sys
sys.path.append(TESTS)
import toy_problem
from topo_search import search
from topo_search.compose import binding, searching
binding.backends, binding.open_engine = lambda _: toy_problem.BACKENDS, lambda *_: toy_problem.InProcess(1)
searching.write_page = lambda _: None
search(toy_problem.toy_task(3), out="run", starts=2, workers=1).best.key
""".replace("TESTS", repr(str(Path(__file__).parent)))


def test_a_search_in_python_shows_a_bar_in_a_terminal_and_nothing_elsewhere(tmp_path):
    (tmp_path / "search.py").write_text(SEARCH)
    command = [sys.executable, "search.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")
    ours, terminal = pty.openpty()
    (tmp_path / "run").rename(tmp_path / "other")
    shown = b""
    with subprocess.Popen(command, cwd=tmp_path, stderr=terminal) as running:
        os.close(terminal)
        with suppress(OSError):  # no other process has the terminal open any more
            while part := os.read(ours, 4096):
                shown += part
    assert running.returncode == 0
    assert all(words in shown for words in (b"plan: 3 modules", b"writing", b"best aa00 J"))  # the last frame


def test_a_search_in_a_notebook_shows_a_line_that_vanishes(tmp_path):
    lines = []

    class Client(NotebookClient):
        def process_message(self, message, *given):
            if message["msg_type"] == "update_display_data":
                lines.append(message["content"]["data"]["text/plain"])
            return super().process_message(message, *given)

    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(SEARCH)])
    Client(book, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert lines[0].startswith("plan: 3 modules: 3 candidates")
    assert "auditing 3 modules: 3 designs" in lines
    shown, answer = book.cells[0].outputs
    assert shown.data == {"text/plain": lines[-1]} == {"text/plain": ""}
    assert answer.data["text/plain"] == "'aa00'"


def test_the_plan_names_candidates_starts_workers_stages_and_time():
    phases = (proof_phase(5), Phase("searching", 5, 28, 8, seconds=3.0), audit_phase(5, 10), WRITING)
    text = describe_plan(Plan(phases, workers=2))
    assert text.startswith(
        "plan: 5 modules: 28 candidates, 8 starts each; audits of the best 10; "
        "proving, searching, auditing, writing on 2 workers: about "
    )
    assert re.search(r"about [45]\d s$", text)
    limited = describe_plan(Plan(phases, workers=2, time_limit=20.0))
    assert limited.endswith("about 28 s, of which at most 20 s to solve")


def test_a_plan_is_what_is_left_to_do(tmp_path):
    plans = []

    class Planned(Lines):
        def plan(self, plan):
            plans.append({(phase.name, phase.n): (phase.steps, phase.starts) for phase in plan.phases})

    for starts in (2, 2, 4):
        toy_run(tmp_path / "run", starts=starts, observer=Planned(lambda _: None))
    first, again, more = plans
    number, starts = first["searching", 3]
    assert starts == 2
    assert set(first) == {("proving", 3), ("searching", 3), ("auditing", 3), ("writing", 0)}
    assert set(again) == {("writing", 0)}
    assert more["searching", 3] == (number, 4)


def test_a_timed_run_plans_rounds_of_more_starts_by_the_name_of_polishing(tmp_path):
    phases = []

    class Told(Lines):
        def plan(self, plan):
            phases.append([phase.plan_key for phase in plan.phases if phase.starts])

        def phase(self, phase):
            phases.append(phase.plan_key)

    toy_run(tmp_path / "run", starts=4, time_limit=1000.0, observer=Told(lambda _: None))
    planned, *met = phases
    assert planned == [("searching", 3, 1), ("polishing", 3, 2), ("polishing", 3, 4)]
    assert [same for same in met if same[2]] == planned


def test_time_left_is_learnt_from_the_steps():
    left = TimeLeft()
    left.plan(Plan((Phase("searching", 3, 10, 1, seconds=1.0), audit_phase(3, 10)), workers=1), 0.0)
    before = left(0.0)
    left.begin(Phase("searching", 3, 10, 1, seconds=1.0), 0.0)
    for number in range(1, 6):
        left.step(10.0 * number, known=False)
    audits = duration(audit_phase(3, 10), 1)  # slow solves say nothing of them
    assert before < left(50.0) == pytest.approx(5 * (40.0 + 2.0) / (4.0 + 2.0) + audits)
    assert left(130.0) >= 80.0, "no step has ended for so long"
    left.plan(Plan((), workers=1, time_limit=5.0), 50.0)
    assert left(50.0) <= 5.0


def simulate(phases, longer):
    """Return what is shown after each step of a run on one worker, over the truth, from a fiftieth of the run on.

    Steps take `longer` times what is expected, give or take a factor of two.
    """
    random, left, now, shown = Random(1), TimeLeft(), 0.0, []
    left.plan(Plan(phases, workers=1), now)
    for phase in phases:
        left.begin(phase, now)
        for _ in range(phase.steps):
            now += longer * phase.seconds * 2 ** random.uniform(-1, 1)
            left.step(now, known=False)
            shown.append((now, left(now)))
    return [remaining / (now - at) for at, remaining in shown if now / 50 < at < 0.99 * now]


@pytest.mark.parametrize("longer", [1, 100])
def test_time_left_is_steady_where_trees_take_longer_than_expected(longer):
    several = tuple(Phase("searching", n, 100 * n, 4, seconds=0.05 * n) for n in (3, 4, 6, 8))
    for phases in (several, (Phase("searching", 12, 1000, 4, seconds=0.1),)):
        factors = simulate(phases, longer)
        assert min(factors) > 0.5
        assert max(factors) < 2.0


def test_known_steps_take_no_time():
    left = TimeLeft()
    left.plan(Plan((SEARCHING,), workers=1), 0.0)
    left.begin(SEARCHING, 0.0)
    for _ in range(98):
        left.step(0.0, known=True)
    assert left(0.0) < 10.0


def benchmark():
    path = Path(__file__).parent / "benchmarks" / "time_left.py"
    specification = importlib.util.spec_from_file_location("benchmark_of_time_left", path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_over_recorded_runs_the_median_time_left_is_off_by_less_than_a_factor_of_two():
    replay = benchmark()
    records = sorted(replay.RECORDED.glob("*.json"))
    assert len(records) >= 5
    factors = [replay.error_factors(path) for path in records]
    assert all(len(of_run) == 90 for of_run in factors)
    assert statistics.median([factor for of_run in factors for factor in of_run]) < 2.0
    assert statistics.median([statistics.median(of_run) for of_run in factors]) < 2.0
