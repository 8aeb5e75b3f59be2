"""CPU time of a search whose page a browser follows, over that of the same search alone.

    python tests/benchmarks/live.py push --modules 4 --starts 2 [--workers W]

Arguments are those of `topo-search run`. One is followed twice as closely as by the page: progress every
second, and the page whenever there is progress. CPU seconds, user and system, of the command and all its children;
the follower's do not count. A first round, which is not printed, compiles what is compiled once.
"""

from __future__ import annotations

import json
import re
import resource
import subprocess
import sys
import tempfile
import time
from http.client import HTTPException
from pathlib import Path
from urllib.request import urlopen

PERIOD_S = 1.0
"""Time between two questions of the page [s]."""


def cpu_seconds(arguments: list[str]) -> tuple[float, int]:
    """Return the CPU seconds of a run, and how many pages were fetched while it went on."""
    before, pages = resource.getrusage(resource.RUSAGE_CHILDREN), 0
    with tempfile.TemporaryDirectory() as folder:
        out, log = Path(folder, "run"), Path(folder, "log")
        command = [sys.executable, "-m", "topo_search", "run", *arguments, "--out", str(out)]
        with log.open("w") as told, subprocess.Popen(command, stdout=told, stderr=told) as process:
            seen = -1
            while process.poll() is None:
                time.sleep(PERIOD_S)
                address = re.search(r"live page: (\S+)", log.read_text())
                if address is None:
                    continue
                try:
                    version = json.load(urlopen(f"{address[1]}status"))["version"]
                    if version != seen:
                        urlopen(f"{address[1]}page").read()
                        seen, pages = version, pages + 1
                except (OSError, HTTPException):  # the run has just ended
                    continue
        if process.returncode:
            raise SystemExit(log.read_text())
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, pages


def main() -> None:
    """Measure and print."""
    arguments = sys.argv[1:]
    cpu_seconds(arguments)
    alone, _ = cpu_seconds(arguments)
    followed, pages = cpu_seconds([*arguments, "--live"])
    print(f"alone {alone:.1f} s, followed {followed:.1f} s of CPU, {pages} pages: ratio {followed / alone:.3f}")


if __name__ == "__main__":
    main()
