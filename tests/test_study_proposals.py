"""A run in which candidates are proposed: as many as asked for, extended, killed and gone on with."""

import math
import os
import signal
from random import Random

import optuna
import pytest
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from processes import Coordinator, eventually, processes_with, ranking, recorded
from suites import few
from toy_problem import solved_keys, toy_run
from wording import says

from topo_search.engine import Engine
from topo_search.model import BadInput
from topo_search.study import RunFolder, SilentObserver

PROPOSED = {"modules": 6, "strategy": "optuna", "starts": 9}


def trials_of(folder):
    storage = JournalStorage(JournalFileBackend(str(folder / "study-n6.journal")))
    return optuna.load_study(study_name=None, storage=storage).trials


@pytest.mark.parametrize("sampler", ["moves", "tpe", "nsga2", "random"])
def test_as_many_candidates_are_solved_as_asked_for_and_the_number_can_be_raised(tmp_path, sampler):
    answer = toy_run(tmp_path / "run", sampler=sampler, trials=40, **PROPOSED)
    (size,) = answer.sizes
    assert (size.settled, size.candidates, size.complete) == (40, 216, True)
    assert any(
        says(one, "176 of 216 candidates", "never proposed", "none of them is more than") for one in size.remarks
    )
    few = {row[0] for row in ranking(tmp_path / "run")}
    assert {trial.user_attrs["key"] for trial in trials_of(tmp_path / "run")} == few

    more = toy_run(tmp_path / "run", sampler=sampler, trials=56, **PROPOSED)
    assert (more.sizes[0].settled, more.sizes[0].complete) == (56, True)
    assert few < {row[0] for row in ranking(tmp_path / "run")}
    assert len({trial.user_attrs["key"] for trial in trials_of(tmp_path / "run")}) == 56
    assert more.best.objective <= answer.best.objective


class Told(SilentObserver):
    """Notes how many candidates are announced, and how many of them are settled."""

    def __init__(self):
        self.sizes = []

    def phase(self, phase):
        self.sizes.append([phase, 0])

    def settled(self, incumbent, *, known=False):
        self.sizes[-1][-1] += 1


@pytest.mark.parametrize("sampler", few(["random", "moves"], 1))
def test_where_all_candidates_are_proposed_it_ends_like_an_exhaustive_search(tmp_path, sampler):
    observer = Told()
    answer = toy_run(tmp_path / "run", sampler=sampler, trials=1000, observer=observer, **PROPOSED)
    (size,) = answer.sizes
    assert (size.settled, size.candidates, size.starts, size.complete) == (216, 216, 9, True)
    (_, _), (first, settled), (second, told), *_ = observer.sizes
    assert (first.name, first.n, first.steps, first.starts, settled) == ("searching", 6, 216, 9, 216)
    assert (second.name, second.n, second.starts) == ("polishing", 6, 9)
    assert 108 < second.steps == told <= 216
    assert not any("never proposed" in remark for remark in size.remarks)
    if sampler == "random":  # without designs carried over
        toy_run(tmp_path / "exhaustive", modules=6, starts=9)
        assert [row[:2] for row in ranking(tmp_path / "run")] == [
            row[:2] for row in ranking(tmp_path / "exhaustive")
        ]
    assert min(trials_of(tmp_path / "run"), key=lambda trial: trial.value).value == size.top[0].objective


class Shuffled(Engine):
    """An engine whose jobs end in an order drawn at random, of all that can be begun."""

    def __init__(self, seed):
        self.random, self.most = Random(seed), 0

    def run(self, function, jobs, *, deadline, until=math.inf):
        source, running = iter(jobs), []
        while True:
            while (job := next(source, None)) is not None:
                running.append(job)
            if not running:
                return
            self.most = max(self.most, len(running))
            job = running.pop(self.random.randrange(len(running)))
            yield job, function(job)


@pytest.mark.parametrize("sampler", few(["moves", "tpe", "nsga2", "random"], 2))
def test_the_order_in_which_jobs_end_changes_nothing(tmp_path, sampler):
    engines = [Shuffled(seed) for seed in range(2)]
    for number, engine in enumerate([None, *engines]):
        toy_run(tmp_path / f"{number}", sampler=sampler, trials=40, round_size=20, engine=engine, **PROPOSED)
    first, *others = (ranking(tmp_path / f"{number}") for number in range(3))
    assert others == [first, first]
    first, *others = ([one.user_attrs for one in trials_of(tmp_path / f"{number}")] for number in range(3))
    assert others == [first, first]
    assert {engine.most for engine in engines} == {20} or sampler != "moves"  # others end with all starts of five


def test_the_size_of_a_round_is_part_of_what_is_asked(tmp_path):
    options = {"modules": 6, "strategy": "optuna", "trials": 40}
    asked = {**options, "round_size": 20}
    toy_run(tmp_path / "one", **asked)
    with RunFolder.load(tmp_path / "one") as folder:
        assert folder.request.round_size == 20
    with pytest.raises(BadInput, match="holds a run with round_size 20, not 8"):
        toy_run(tmp_path / "one", **options)
    with pytest.raises(ValueError, match="1 <= round_size <= 1,000"):
        toy_run(tmp_path / "three", **options, round_size=1001)


def test_a_killed_run_ends_like_one_that_was_not_and_solves_nothing_twice(tmp_path, monkeypatch):
    options = ("--modules", "6", "--strategy", "optuna", "--trials", "80", "--starts", "9")
    coordinator = Coordinator(tmp_path, *options, TOY_SLEEP="0.05")
    try:
        for rows in (9, 70):
            coordinator.start()
            coordinator.wait_for(rows)
            os.kill(coordinator.process.pid, signal.SIGKILL)
            coordinator.finish()
            eventually(lambda: processes_with(str(coordinator.log)) == [])
        assert len(recorded(coordinator.folder)) >= 70
        coordinator.start()
        assert coordinator.finish()[0] == 0
    finally:
        for pid in processes_with(str(coordinator.log)):
            os.kill(pid, signal.SIGKILL)
        coordinator.process.communicate()
    log = tmp_path / "unkilled"
    log.touch()
    monkeypatch.setenv("TOY_LOG", str(log))
    toy_run(tmp_path / "whole", trials=80, **PROPOSED)
    assert ranking(coordinator.folder) == ranking(tmp_path / "whole")
    assert (coordinator.folder / "best.json").read_text() == (tmp_path / "whole" / "best.json").read_text()
    in_flight = 2 * 2 * 2  # kills, workers, jobs a worker
    assert len(solved_keys(coordinator.log)) <= len(solved_keys(log)) + in_flight
    killed, unkilled = (
        [(trial.params, trial.user_attrs, trial.values) for trial in trials_of(folder)]
        for folder in (coordinator.folder, tmp_path / "whole")
    )
    assert killed == unkilled
