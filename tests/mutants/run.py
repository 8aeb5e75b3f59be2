"""Put each fault of `mutants.toml` into a copy of the repository, and see its test fail.

    python tests/mutants/run.py [WORD ...]

With words only mutants whose file or test contains one of them. The status is 1 if a test does not fail, or fails
without a fault.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
FAILED = 1
"""Status of pytest if tests ran and some failed; others mean that it found none, or could not start."""


def mutants() -> list[dict[str, str]]:
    """Return the mutants of the list."""
    text = (Path(__file__).parent / "mutants.toml").read_text(encoding="utf-8")
    found: list[dict[str, str]] = tomllib.loads(text)["mutant"]
    return found


def status_of(copy: Path, *tests: str) -> int:
    """Return the status of the fast tests among some in a copy of the repository."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "-m", "not slow and not browser", *tests]
    environment = os.environ | {"PYTHONPATH": str(copy)}
    return subprocess.run(command, cwd=copy, env=environment, stdout=subprocess.DEVNULL, check=False).returncode


def survives(copy: Path, mutant: dict[str, str]) -> bool:
    """Return whether the test passes, or does not run, with the fault."""
    path = copy / mutant["file"]
    source = path.read_text(encoding="utf-8")
    if source.count(mutant["old"]) != 1:
        return True
    path.write_text(source.replace(mutant["old"], mutant["new"]), encoding="utf-8")
    try:
        return status_of(copy, mutant["test"]) != FAILED
    finally:
        path.write_text(source, encoding="utf-8")


def main() -> None:
    """Try the mutants; compiled code is copied too, since only that of changed files must be compiled anew."""
    words = sys.argv[1:]
    chosen = [m for m in mutants() if not words or any(word in m["file"] + m["test"] for word in words)]
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", ".venv", "site", "runs"))
        faults = []
        if status_of(copy, *sorted({mutant["test"] for mutant in chosen})) != 0:
            faults.append("a test fails without any fault")
        for mutant in chosen:
            is_alive = survives(copy, mutant)
            print("SURVIVES" if is_alive else "caught", mutant["file"], mutant["test"], flush=True)
            faults += [mutant["file"]] * is_alive
    sys.exit(f"not caught: {', '.join(faults)}" if faults else 0)


if __name__ == "__main__":
    main()
