"""Ctrl-C and SIGTERM end every command soon, at any moment, whatever becomes of stderr; nothing done is lost."""

import os
import random
import resource
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from processes import eventually, gone, recorded
from toy_problem import COMMAND, toy_task
from wording import says

from topo_search.model.files import to_toml
from topo_search.supervisor import ExitStatus

HERE = Path(__file__).parent
HANG = 10.0
"""A command that takes longer to end hangs: generous beside the grace, for a machine that is busy [s]."""
RUN = ("run", "push", "--modules", "4", "--starts", "2", "--workers", "2", "--out", "run")
COMMANDS = (
    RUN,
    ("solve", "push", "--topology", "a3333333333333333330"),
    ("topologies", "1000", "--count"),
    ("experiment", "scaling", "--small", "--out", "experiment"),
)
"""Commands that outlast the wait for the signal's handler."""


class Command:
    """A command of its own process group, in a folder of its own."""

    def __init__(self, folder, *words, start=("-m", "topo_search"), stderr=None, setup=None):
        self.folder = folder
        self.log = folder / "stderr"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, *start, *words],
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log if stderr is None else stderr,
                start_new_session=True,
                preexec_fn=setup,
            )

    def wait_until_it_listens(self):
        """Wait until it handles SIGTERM: before, Python itself is still starting."""
        mask = f"/proc/{self.process.pid}/status"

        def listens():
            for line in Path(mask).read_text().splitlines():
                if line.startswith("SigCgt:"):
                    return int(line.split()[1], 16) >> (signal.SIGTERM - 1) & 1
            return True  # it has ended

        eventually(listens)

    def family(self):
        """The processes of its group."""
        found = []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    stat = (entry / "stat").read_text().rsplit(")", 1)[1].split()
                except (FileNotFoundError, ProcessLookupError):
                    continue
                if int(stat[2]) == self.process.pid and stat[0] not in "ZX":
                    found.append(int(entry.name))
        return found

    def ends(self):
        """Wait for its exit status, and see that nothing of it goes on."""
        try:
            status = self.process.wait(HANG)
        finally:
            family = self.family()
            if self.process.poll() is None:
                os.killpg(self.process.pid, signal.SIGKILL)
                self.process.wait()
        eventually(lambda: all(map(gone, family)), HANG)
        return status

    def told(self):
        return self.log.read_text(errors="replace")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_a_command_starts_ends_it(tmp_path, number):
    command = Command(tmp_path, *RUN)
    command.wait_until_it_listens()
    command.process.send_signal(number)
    assert command.ends() == ExitStatus.INTERRUPTED
    assert command.told() == "stopped\n"


def test_a_signal_during_a_run_keeps_what_was_finished(tmp_path):
    command = Command(tmp_path, *RUN, "--workers", "1")
    eventually(lambda: recorded(tmp_path / "run"))
    for _ in range(20):  # a terminal, a shell and a scheduler at once, all to every process
        os.killpg(command.process.pid, random.choice([signal.SIGINT, signal.SIGTERM]))
    assert command.ends() == ExitStatus.INTERRUPTED
    assert says(command.told().splitlines()[-1], "stopped", "kept", "same command")
    assert command.told().count("stopped") == 1
    assert "Traceback" not in command.told()
    assert recorded(tmp_path / "run")


def test_native_code_that_does_not_return_is_ended_too(tmp_path):
    """A big integer's power holds Python's lock for hours; no handler of Python runs meanwhile."""
    code = "from topo_search.supervisor import supervise; supervise(lambda: print('on', 7 ** 10**9, flush=True))"
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    eventually(lambda: Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text())
    time.sleep(0.5)
    process.terminate()
    _, told = process.communicate(timeout=HANG)
    assert (process.returncode, told) == (ExitStatus.INTERRUPTED, "stopped\n")


CALLS_BACK = """
import time
import casadi
from topo_search.cli.errors import explain_errors
from topo_search.supervisor import supervise

class Slow(casadi.Callback):
    def eval(self, arguments):
        print("on", flush=True)
        time.sleep(0.05)
        return [arguments[0] ** 2]

def command():
    with explain_errors():
        slow = Slow()
        slow.construct("slow", {"enable_fd": True})
        x = casadi.MX.sym("x")
        options = {"ipopt.print_level": 0, "print_time": False, "ipopt.max_iter": 3, "error_on_fail": False}
        casadi.nlpsol("solver", "ipopt", {"x": x, "f": slow(x)}, options)(x0=1.0)
        time.sleep(60.0)

supervise(command)
"""


def test_a_signal_in_a_function_that_ipopt_calls_is_not_swallowed():
    """CasADi catches KeyboardInterrupt there, prints a warning and returns half a result."""
    command = [sys.executable, "-c", CALLS_BACK]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while "on" not in process.stdout.readline():
        pass
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=HANG)
    assert (process.returncode, told) == (ExitStatus.INTERRUPTED, "stopped\n")


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Words after Python's that search the toy problem."""
    (tmp_path / "toy.toml").write_text(to_toml(toy_task(3)))
    monkeypatch.setenv("PYTHONPATH", str(HERE))
    return "-c", COMMAND, "run", "toy.toml", "--out", "run"


def test_a_reader_of_stderr_that_has_stopped_keeps_no_run_from_being_stopped(tmp_path, monkeypatch, toy):
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writer, b"x" * 65536)
    os.set_blocking(writer, True)
    monkeypatch.setenv("TOY_SLEEP", "2")
    command = Command(tmp_path, start=toy, stderr=writer)
    eventually(lambda: len(command.family()) >= 2)
    time.sleep(2.0)
    command.process.terminate()
    assert command.ends() == ExitStatus.INTERRUPTED
    os.close(reader)
    os.close(writer)


def test_a_run_that_can_tell_nobody_of_its_progress_finishes(tmp_path, toy):
    with open("/dev/full", "wb") as full:
        command = Command(tmp_path, start=toy, stderr=full)
    assert command.process.wait(300) in (0, 3)
    assert (tmp_path / "run" / "candidates.csv").exists()


def test_a_killed_command_is_told_and_leaves_nothing_behind(tmp_path):
    command = Command(tmp_path, *RUN, "--workers", "1")
    eventually(lambda: len(recorded(tmp_path / "run")) >= 1)
    child = Path(f"/proc/{command.process.pid}/task/{command.process.pid}/children").read_text()
    os.kill(int(child), signal.SIGKILL)
    assert command.ends() == 128 + signal.SIGKILL
    assert says(command.told().splitlines()[-1], "SIGKILL", "memory")


@pytest.mark.slow
def test_signals_at_random_moments(tmp_path):
    """A hundred moments, over all commands, each with one signal or several."""
    rng = random.Random(0)
    counts = {}
    for number in range(100):
        words = COMMANDS[number % len(COMMANDS)]
        folder = tmp_path / str(number)
        folder.mkdir()
        command = Command(folder, *words)
        command.wait_until_it_listens()
        time.sleep(rng.choice([0.3, 2.0, 8.0]) * rng.random())
        several = rng.random() < 0.3
        for _ in range(5 if several else 1):
            if command.process.poll() is None:
                kind = rng.choice([signal.SIGINT, signal.SIGTERM])
                if rng.random() < 0.5:
                    os.killpg(command.process.pid, kind)
                else:
                    command.process.send_signal(kind)
        status = command.ends()
        done = status in (0, 1, 3)
        counts[status] = counts.get(status, 0) + 1
        assert done or status == ExitStatus.INTERRUPTED, (words, status, command.told())
        assert "Traceback" not in command.told(), (words, command.told())
        assert "Error" not in command.told(), (words, command.told())
        assert "Exception" not in command.told(), (words, command.told())
        assert done or "stopped" in command.told().splitlines()[-1], (words, command.told())
    print(f"\nexit statuses of 100 commands that were signalled: {dict(sorted(counts.items()))}")
    assert counts[ExitStatus.INTERRUPTED] >= 80


def test_too_few_file_descriptors_are_a_line_and_a_status(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "topo_search", *RUN],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (18, 18)),
    )
    assert done.returncode == 74, done.stderr
    assert done.stderr.splitlines()[-1].startswith("Too many open files")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("fault", "status", "last"),
    [
        ("raise MemoryError", 1, "MemoryError"),
        ("os.abort()", 134, "ended by SIGABRT"),
        ("raise SystemExit(3)", 3, None),
        ("os.kill(os.getpid(), 11)", 139, "ended by SIGSEGV"),
    ],
)
def test_whatever_ends_a_command_is_told(fault, status, last):
    code = f"import os\ndef command():\n    {fault}\n"
    code += "from topo_search.supervisor import supervise\nsupervise(command)"
    environment = {**os.environ, "PYTHONFAULTHANDLER": ""}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    assert (done.stderr.splitlines() or [None])[-1] == last
