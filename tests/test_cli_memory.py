"""Memory that runs out anywhere, in Python, in a library or in its threads, is a line and an exit status."""

import os
import resource
import subprocess
import sys

import pytest
from suites import few

from topo_search.supervisor import ExitStatus

COMMANDS = (
    ("check", "push"),
    ("solve", "push", "--modules", "3", "--sample-seed", "0", "--starts", "1"),
    ("run", "push", "--modules", "3", "--starts", "1", "--workers", "2", "--out", "run"),
    ("topologies", "9"),
    ("examples",),
)


def limited(megabytes, *words, folder, **environment):
    """What becomes of a command with so much address space, as of `ulimit -v`."""
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
    [(60, COMMANDS[-1]), (90, COMMANDS[-1]), (150, COMMANDS[0]), (320, COMMANDS[0]), (320, COMMANDS[1])],
)
def test_too_little_memory_is_a_line_and_a_status(tmp_path, megabytes, words):
    done = limited(megabytes, *words, folder=tmp_path)
    assert done.returncode == ExitStatus.OUT_OF_MEMORY, done.stderr
    assert done.stderr.splitlines()[-1].startswith("out of memory")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("files", few([18, 20], 1))
def test_too_few_file_descriptors_are_a_line_and_a_status(tmp_path, files):
    done = subprocess.run(
        [sys.executable, "-m", "topo_search", *COMMANDS[2]],
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
        for words in COMMANDS:
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
    assert counts[ExitStatus.OUT_OF_MEMORY] > 20
    assert counts[0] > 20
