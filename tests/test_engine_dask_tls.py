"""TLS to a Dask scheduler, with certificates of an authority that the test makes."""

import contextlib
import gc
import socket
import subprocess
from pathlib import Path

import pytest
from dask_cluster import Cluster, free_port
from engine_jobs import LONG, square

from topo_search.engine import Certificates, DaskWorkers, WorkersLost, dask_workers
from topo_search.model import BadInput


def openssl(folder, *words):
    subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)


def authority(folder, name):
    """A certificate of an authority, and one of an end with its key."""
    folder.mkdir()
    new = ("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    openssl(folder, *new, "-x509", "-days", "2", "-subj", f"/CN={name}", "-keyout", "ca.key", "-out", "ca.pem")
    openssl(folder, *new, "-subj", f"/CN=an end of {name}", "-keyout", "end.key", "-out", "end.csr")
    signed = ("-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2", "-out", "end.pem")
    openssl(folder, "x509", "-req", "-in", "end.csr", *signed)
    return Certificates(folder / "ca.pem", folder / "end.pem", folder / "end.key")


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    return authority(tmp_path_factory.mktemp("certificates") / "ours", "us")


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    return authority(tmp_path_factory.mktemp("certificates") / "others", "others")


@pytest.fixture(scope="module")
def encrypted(tmp_path_factory, certificates):
    """A Dask cluster that speaks TLS alone, with one worker."""
    files = tuple(map(str, (certificates.ca, certificates.cert, certificates.key)))
    with Cluster(tmp_path_factory.mktemp("cluster"), certificates=files) as cluster:
        cluster.add_worker()
        yield cluster


def test_jobs_run_over_tls(encrypted, certificates):
    assert encrypted.address.startswith("tls://")
    with DaskWorkers(encrypted.address, {}, certificates=certificates) as workers:
        assert sorted(workers.run(square, range(20), deadline=lambda _: LONG)) == [(x, x * x) for x in range(20)]


def test_certificates_of_dasks_own_configuration_are_used(encrypted, certificates):
    import dask

    files = {"ca-file": certificates.ca, "client.cert": certificates.cert, "client.key": certificates.key}
    with (
        dask.config.set({f"distributed.comm.tls.{name}": str(path) for name, path in files.items()}),
        DaskWorkers(encrypted.address, {}) as workers,
    ):
        assert workers.run_one(square, 3, deadline=LONG) == 9


def test_another_authority_is_not_trusted(encrypted, others, monkeypatch):
    monkeypatch.setattr(dask_workers, "DURATIONS", dask_workers.Durations(answer=5.0))
    with (
        DaskWorkers(encrypted.address, {}, certificates=others) as workers,
        pytest.raises(WorkersLost, match=f"no Dask scheduler answers at {encrypted.address}: "),
    ):
        workers.run_one(square, 3, deadline=LONG)


@pytest.fixture
def abandoned(cluster):
    """Close what tornado leaves open where the scheduler's greeting comes before the handshake of TLS."""
    yield
    port = int(cluster.address.rpartition(":")[2])
    for one in gc.get_objects():
        if type(one) is socket.socket and one.family == socket.AF_INET and one.fileno() >= 0:
            with contextlib.suppress(OSError):  # not connected
                if one.getpeername()[1] == port:
                    one.close()


@pytest.mark.usefixtures("abandoned")
def test_a_scheduler_without_tls_gets_no_job(cluster, certificates, monkeypatch):
    monkeypatch.setattr(dask_workers, "DURATIONS", dask_workers.Durations(answer=5.0))
    address = cluster.address.replace("tcp://", "tls://")
    with (
        DaskWorkers(address, {}, certificates=certificates) as workers,
        pytest.raises(WorkersLost, match=f"no Dask scheduler answers at {address}: "),
    ):
        workers.run_one(square, 3, deadline=LONG)


def test_certificates_are_asked_for_with_tls_and_only_with_tls(certificates):
    lacking = r"dask: needs certificates with tls://HOST:PORT: give --dask-ca, --dask-cert and --dask-key .* or set"
    with pytest.raises(BadInput, match=lacking):
        DaskWorkers("tls://127.0.0.1:8786", {})
    with pytest.raises(BadInput, match="must be tls://HOST:PORT for certificates, but got 'tcp://127"):
        DaskWorkers("tcp://127.0.0.1:8786", {}, certificates=certificates)


def test_files_that_are_no_certificates_are_named(tmp_path, certificates, others):
    with pytest.raises(BadInput, match=r"dask-ca: .*absent\.pem: No such file or directory"):
        Certificates(tmp_path / "absent.pem", certificates.cert, certificates.key)
    with pytest.raises(BadInput, match=r"dask-key: .*: Is a directory"):
        Certificates(certificates.ca, certificates.cert, tmp_path)
    with pytest.raises(BadInput, match="dask-ca: must be a certificate in PEM format"):
        Certificates(Path(__file__), certificates.cert, certificates.key)
    with pytest.raises(BadInput, match="must be a certificate and its key in PEM format"):
        Certificates(certificates.ca, certificates.cert, others.key)
    locked = tmp_path / "locked.key"
    openssl(tmp_path, "ec", "-in", str(certificates.key), "-aes256", "-passout", "pass:secret", "-out", str(locked))
    with pytest.raises(BadInput, match="must be a certificate and its key in PEM format"):
        Certificates(certificates.ca, certificates.cert, locked)


def test_the_command_searches_over_tls(encrypted, certificates, run_toy):
    files = ("--dask-ca", certificates.ca, "--dask-cert", certificates.cert, "--dask-key", certificates.key)
    run_toy("--dask", encrypted.address, *map(str, files))


def test_what_the_command_lacks_is_told_before_a_folder_is_made(certificates, run_toy, tmp_path):
    address = f"tls://127.0.0.1:{free_port()}"
    for words, message in (
        (("--dask", address), "needs certificates with tls://HOST:PORT: give --dask-ca, --dask-cert and"),
        (("--dask", address, "--dask-ca", str(certificates.ca)), "--dask-key must be given together"),
        (("--dask-ca", str(certificates.ca)), "--dask-key require --dask"),
    ):
        assert message in run_toy(*words, status=2).stderr
    assert not (tmp_path / "runs").exists()
