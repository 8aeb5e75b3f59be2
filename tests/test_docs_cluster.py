"""What the documentation shows for clusters runs, with stand-ins for Slurm's commands."""

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from documented import blocks

pytestmark = pytest.mark.slow

STAND_INS = {
    "dask": f'exec "{sys.executable}" -m dask "$@"',
    "topo-search": f'exec "{sys.executable}" -m topo_search "$@"',
    "hostname": "echo 127.0.0.1",
    "srun": 'exec "$@"',
    "sbatch": 'setsid bash "$1" </dev/null >worker.log 2>&1 & echo "Submitted batch job $!"; sleep 1',
    "scancel": 'kill -TERM -- "-$1"',
}


@pytest.fixture
def slurm(tmp_path):
    """The environment of a machine with Slurm."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name, script in STAND_INS.items():
        path = folder / name
        path.write_text(f"#!/bin/bash\n{script}\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
    paths = filter(None, [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH")])
    return {
        **os.environ,
        "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": os.pathsep.join(paths),
        "SLURM_JOB_ID": str(os.getpid()),
    }


def changed(text, *changes):
    """A text with every one of some words changed, each of which must be there."""
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    return text


def test_the_job_for_slurm_searches(slurm, tmp_path):
    (script,) = blocks("bash", "how-to/cluster.md")
    (tmp_path / "job.sh").write_text(changed(script, ("--modules 8", "--modules 3 --starts 4")))
    with (tmp_path / "log").open("w") as log:
        job = subprocess.Popen(
            ["bash", "job.sh"], cwd=tmp_path, env=slurm, stdout=log, stderr=log, start_new_session=True
        )
    status = job.wait()
    os.killpg(job.pid, signal.SIGKILL)  # as Slurm does when the script has ended
    log = (tmp_path / "log").read_text()
    assert status == 0, log
    assert "best design: a3" in log
    assert (tmp_path / "push-8" / "best.json").exists()


def test_the_search_without_a_script_starts_jobs_and_ends_them(slurm, tmp_path):
    (code,) = blocks("python", "how-to/cluster.md")
    fewer = 'topo_search.search(topo_search.read_task("push", ("modules=3",)), starts=4, out="push-5"'
    small = changed(
        code,
        ('topo_search.search("push", out="push-5"', fewer),
        ("cores=16", "cores=2"),
        ("processes=16", "processes=2"),
        ("jobs=4", "jobs=1"),
    )
    (tmp_path / "search.py").write_text(small)
    done = subprocess.run([sys.executable, "search.py"], cwd=tmp_path, env=slurm, capture_output=True, text=True)
    assert done.stdout.startswith("a3"), done.stderr
