"""Ctrl-C and SIGTERM end every command soon, at any moment, whatever becomes of stderr; nothing done is lost."""

import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import eventually, gone, recorded
from suites import few
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
    (
        "run",
        "push",
        "--modules",
        "8",
        "--strategy",
        "optuna",
        "--trials",
        "24",
        "--workers",
        "2",
        "--out",
        "optuna",
    ),
    ("solve", "push", "--modules", "20", "--sample-seed", "0"),
    ("check", "push", "--modules", "81-100"),
    ("topologies", "11"),
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
@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_signal_while_a_command_starts_ends_it(tmp_path, words, number):
    command = Command(tmp_path, *words)
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


@pytest.mark.parametrize("delay", few([0.0, 0.1, 0.2, 0.3, 0.5], 1))
def test_a_signal_in_a_function_that_ipopt_calls_is_not_swallowed(delay):
    """CasADi catches KeyboardInterrupt there, prints a warning and returns half a result."""
    command = [sys.executable, "-c", CALLS_BACK]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while "on" not in process.stdout.readline():
        pass
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=HANG)
    assert (process.returncode, told) == (ExitStatus.INTERRUPTED, "stopped\n")


def test_a_signal_while_another_is_told_of_takes_no_word_from_it():
    """A terminal signals the whole group: a command gets one from there, and one from the process that waits."""
    code = """
import os, signal
from topo_search import supervisor

def again(text, tell=supervisor.tell):
    os.kill(os.getpid(), signal.SIGTERM)
    tell(text)

supervisor.tell = again
supervisor.Stop().handle()
os.kill(os.getpid(), signal.SIGINT)
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG)
    assert (ended.returncode, ended.stdout, ended.stderr) == (ExitStatus.INTERRUPTED, "", "stopped\n")


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Words after Python's that search the toy problem."""
    (tmp_path / "toy.toml").write_text(to_toml(toy_task(3)))
    monkeypatch.setenv("PYTHONPATH", str(HERE))
    return "-c", COMMAND, "run", "toy.toml", "--out", "run"


@pytest.mark.parametrize("kind", ["full", "closed", "unread"])
def test_what_becomes_of_stderr_keeps_no_run_from_being_stopped(tmp_path, monkeypatch, toy, kind):
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    try:
        while kind == "unread":
            os.write(writer, b"x" * 65536)
    except BlockingIOError:
        os.set_blocking(writer, True)
    with open("/dev/full", "wb") as full:
        given = {"full": full, "closed": subprocess.DEVNULL, "unread": writer}[kind]
        monkeypatch.setenv("TOY_SLEEP", "2")
        setup = (lambda: os.close(2)) if kind == "closed" else None
        command = Command(tmp_path, start=toy, stderr=given, setup=setup)
    if kind == "unread":
        eventually(lambda: len(command.family()) >= 2)
        time.sleep(2.0)
    else:
        eventually(lambda: recorded(tmp_path / "run"))
    command.process.terminate()
    assert command.ends() == ExitStatus.INTERRUPTED
    os.close(reader)
    os.close(writer)


@pytest.mark.parametrize("kind", ["full", "closed"])
def test_a_run_that_can_tell_nobody_of_its_progress_finishes(tmp_path, toy, kind):
    with open("/dev/full", "wb") as full:
        closed = kind == "closed"
        given = subprocess.DEVNULL if closed else full
        command = Command(tmp_path, start=toy, stderr=given, setup=(lambda: os.close(2)) if closed else None)
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


# ---- Memory that runs out anywhere, in Python, in a library or in its threads, is a line and an exit status.

SMALL = (
    ("check", "push"),
    ("solve", "push", "--modules", "3", "--sample-seed", "0", "--starts", "1"),
    ("run", "push", "--modules", "3", "--starts", "1", "--workers", "2", "--out", "run"),
    ("topologies", "9"),
    ("examples",),
)


def limited(megabytes, *words, folder, **environment):
    """Result of a command with limited address space, as by `ulimit -v`."""
    size = megabytes * 2**20
    return subprocess.run(
        [sys.executable, "-m", "topo_search", *words],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=300,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (size, size)),
    )


@pytest.mark.parametrize(
    ("megabytes", "words"),
    [(60, SMALL[-1]), (90, SMALL[-1]), (150, SMALL[0]), (320, SMALL[0]), (320, SMALL[1])],
)
def test_too_little_memory_is_a_line_and_a_status(tmp_path, megabytes, words):
    done = limited(megabytes, *words, folder=tmp_path)
    assert done.returncode == ExitStatus.OUT_OF_MEMORY, done.stderr
    assert done.stderr.splitlines()[-1].startswith("out of memory")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("megabytes", [50, 75, 100])
def test_too_little_memory_for_the_buffers_of_a_library_is_no_hang(megabytes):
    code = f"""
import resource
from topo_search.supervisor import supervise

def command():
    import numpy
    with open("/proc/self/status") as status:
        size = next(int(line.split()[1]) for line in status if line.startswith("VmSize:")) * 1024
    resource.setrlimit(resource.RLIMIT_AS, (size + {megabytes} * 2**20, resource.RLIM_INFINITY))
    import scipy.linalg

supervise(command)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (ExitStatus.OUT_OF_MEMORY, "out of memory\n")


@pytest.mark.parametrize("files", few([18, 20], 1))
def test_too_few_file_descriptors_are_a_line_and_a_status(tmp_path, files):
    done = subprocess.run(
        [sys.executable, "-m", "topo_search", *SMALL[2]],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (files, files)),
    )
    assert done.returncode == 74, done.stderr
    assert done.stderr.splitlines()[-1].startswith("Too many open files")
    assert "Traceback" not in done.stderr


def test_threads_of_libraries_take_no_memory_unasked(tmp_path):
    code = "import os; from topo_search.supervisor import supervise\n"
    code += "supervise(lambda: print(os.environ['OPENBLAS_NUM_THREADS']))"
    asked = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    for given, found in ((asked, "1"), ({**asked, "OPENBLAS_NUM_THREADS": "3"}, "3")):
        done = subprocess.run([sys.executable, "-c", code], env=given, capture_output=True, text=True, check=True)
        assert done.stdout.strip() == found


@pytest.mark.parametrize(
    ("fault", "status", "last"),
    [
        ("raise MemoryError", 71, "out of memory"),
        ("raise ImportError('x.so: failed to map segment from shared object')", 71, "out of memory"),
        ('import threading; raise RuntimeError("can\'t start new thread")', 71, "out of memory"),
        ("os.abort()", 134, "ended by SIGABRT"),
        ("ctypes.CDLL(None).exit(1)", 70, "ended by a library, with status 1"),
        ("raise SystemExit(3)", 3, None),
        ("os.kill(os.getpid(), 11)", 139, "ended by SIGSEGV"),
        ("print(1 / 0)", 1, "ZeroDivisionError: division by zero"),
    ],
)
def test_whatever_ends_a_command_is_told(fault, status, last):
    code = f"import ctypes, os\ndef command():\n    {fault}\n"
    code += "from topo_search.supervisor import supervise\nsupervise(command)"
    environment = {**os.environ, "PYTHONFAULTHANDLER": ""}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    assert (done.stderr.splitlines() or [None])[-1] == last
    if status == ExitStatus.OUT_OF_MEMORY:
        assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_every_amount_of_memory(tmp_path):
    counts = {}
    for megabytes in range(40, 1600, 120):
        for words in SMALL:
            folder = tmp_path / f"{megabytes}-{words[0]}"
            folder.mkdir()
            done = limited(megabytes, *words, folder=folder)
            counts[done.returncode] = counts.get(done.returncode, 0) + 1
            at = (megabytes, words, done.returncode, done.stderr)
            assert done.returncode in (0, 1, 3, 70, ExitStatus.OUT_OF_MEMORY), at
            assert "Traceback" not in done.stderr, at
            if done.returncode in (70, ExitStatus.OUT_OF_MEMORY):
                assert "memory" in done.stderr.splitlines()[-1], at
    print(f"\nexit statuses of {sum(counts.values())} commands with 40 to 960 MB: {dict(sorted(counts.items()))}")
    assert counts[ExitStatus.OUT_OF_MEMORY] > 15
    assert counts[0] > 20
