"""CPU time of a search with a live page that a browser follows, over that of the search alone.

    python tests/benchmarks/live.py push --modules 4 --starts 2 [--workers W]

Arguments are those of `topo-search run`. The script polls twice as often as the page does: the status every second,
and the page whenever there is progress. CPU time, user and system, is that of the command and its children, without
the poller. A first round, which is not printed, compiles code.
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
"""Time between two polls [s]."""


def cpu_seconds(arguments: list[str]) -> tuple[float, int]:
    """Return the CPU time of a run [s], and the number of pages fetched while it ran."""
    before, pages = resource.getrusage(resource.RUSAGE_CHILDREN), 0
    with tempfile.TemporaryDirectory() as folder:
        out, log = Path(folder, "run"), Path(folder, "log")
        command = [sys.executable, "-m", "topo_search", "run", *arguments, "--out", str(out)]
        with log.open("w") as log_file, subprocess.Popen(command, stdout=log_file, stderr=log_file) as process:
            shown = -1
            while process.poll() is None:
                time.sleep(PERIOD_S)
                address = re.search(r"live page: (\S+)", log.read_text())
                if address is None:
                    continue
                try:
                    version = json.load(urlopen(f"{address[1]}status"))["version"]
                    if version != shown:
                        urlopen(f"{address[1]}page").read()
                        shown, pages = version, pages + 1
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
