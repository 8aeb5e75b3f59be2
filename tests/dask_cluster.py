"""A Dask cluster as a user starts it, on this machine, for tests that use it or end parts of it."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


class Cluster:
    """A scheduler, and as many Dask workers as are asked for; `with` ends all of them."""

    def __init__(self, folder, **environment):
        paths = filter(None, [str(HERE), os.environ.get("PYTHONPATH")])
        self.environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(paths),
            "DASK_DISTRIBUTED__WORKER__DAEMON": "False",
            "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
            "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s",
            "DASK_DISTRIBUTED__WORKER__MEMORY__MONITOR_INTERVAL": "1s",
            **environment,
        }
        self.folder = folder
        self.address = f"tcp://127.0.0.1:{free_port()}"
        port = self.address.rsplit(":", 1)[1]
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", port)
        self.workers = []

    def __enter__(self):
        return self

    def __exit__(self, *error):
        for process in (*self.workers, self.scheduler):
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    def add_worker(self, *options):
        """Start a Dask worker of one thread, without waiting for it."""
        given = ("--nthreads", "1", "--local-directory", str(self.folder), *options)
        self.workers.append(self._start("worker", self.address, *given))
        return self.workers[-1]

    def _start(self, role, *arguments):
        command = [sys.executable, "-m", "dask", role, *arguments, "--no-dashboard"]
        with (self.folder / f"{role}.log").open("a") as log:
            return subprocess.Popen(
                command, env=self.environment, stdout=log, stderr=log, start_new_session=True, cwd=self.folder
            )
