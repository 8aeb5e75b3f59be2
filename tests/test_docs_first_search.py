"""The newcomer's path: every command of the first tutorial runs, in order, and prints what the page shows."""

import os
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest
from documented import blocks, same

PAGE = "tutorials/first-search.md"


def sessions() -> list[tuple[str, list[str]]]:
    """Return every command of the page with the lines shown below it."""
    found = []
    for block in blocks("console", PAGE):
        command, *shown = block.splitlines()
        assert command.startswith("$ topo-search ")
        found.append((command.removeprefix("$ "), shown))
    return found


def test_lines_are_compared_by_words_and_numbers():
    assert same("gap 8.90 %, audit clear", "gap  8.91 %,  audit clear")
    assert not same("gap 8.90 %, audit clear", "gap 8.90 %, audit violated")
    assert not same("gap 8.90 %", "gap 9.90 %")
    assert len(sessions()) >= 5


@pytest.mark.slow
def test_the_newcomers_path_runs_as_it_is_shown(tmp_path):
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    (_, task) = blocks("toml", PAGE)
    (tmp_path / "wall.toml").write_text(task, encoding="utf-8")
    for command, shown in sessions():
        began = time.perf_counter()
        done = subprocess.run(
            shlex.split(command), cwd=tmp_path, env={**os.environ, "PATH": path}, capture_output=True, text=True
        )
        print(f"{time.perf_counter() - began:6.1f} s  {command}")
        assert done.returncode in (0, 1), done.stderr
        printed = iter(done.stdout.splitlines())
        for line in shown:
            if line != "...":
                assert any(same(line, other) for other in printed), f"{command}: not printed, in order: {line}"
    (page,) = tmp_path.glob("runs/push-*/report.html")
    assert page.stat().st_size > 1_000_000
    for made in ("kit/allocation.json", "kit/platform.params", "kit/assembly.html", "flight/flight.json"):
        assert (tmp_path / made).is_file(), made
