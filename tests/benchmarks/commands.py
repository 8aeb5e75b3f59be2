"""CPU time of whole commands, compared with an older revision.

    python tests/benchmarks/commands.py REVISION [--repeat R] [--only NAME ...]

Both revisions run from their own sources, alternately, each command in a separate process. A first round, which
does not count, compiles code. Figures are medians over R rounds of the CPU time, user and system, of the command
and its children.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from reduced import HERE, source_of

THREE = ("push", "--topology", "a300", "--set", "modules=3")
COMMANDS = {
    "help": ("--help",),
    "run": ("run", "push", "--workers", "1", "--out", "new"),
    "finished run": ("run", "push", "--workers", "1", "--out", "finished"),
    "audit": ("audit", "finished/best.json"),
    "solve": ("solve", *THREE, "--out", "solved.json"),
    "report": ("report", "finished"),
    "export": ("export", "finished/best.json", "--format", "mjcf", "--out", "exported.xml"),
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--only", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    arguments = parser.parse_args()
    with source_of(arguments.revision) as then, tempfile.TemporaryDirectory() as temporary:
        sides = [(then, Path(temporary, "then")), (HERE, Path(temporary, "now"))]
        for source, folder in sides:
            folder.mkdir()
            cpu_seconds(COMMANDS["finished run"], source, folder)
        print("| command | then [s] | now [s] | now / then |\n|---|---|---|---|")
        for name in arguments.only:
            rounds = [
                [cpu_seconds(COMMANDS[name], source, folder) for source, folder in sides]
                for _ in range(1 + arguments.repeat)
            ]
            then, now = (median(seconds) for seconds in zip(*rounds[1:], strict=True))
            print(f"| {name} | {then:.2f} | {now:.2f} | {now / then:.2f} |", flush=True)


def cpu_seconds(command: tuple[str, ...], source: Path, folder: Path) -> float:
    """Run a command in a folder, from a source, and return its CPU time [s]."""
    shutil.rmtree(folder / "new", ignore_errors=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-m", "topo_search", *command],
        check=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": ""},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
