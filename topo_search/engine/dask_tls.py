"""Who a Dask scheduler is, and that nobody listens: certificates of both ends (TLS)."""

from __future__ import annotations

import ssl
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from topo_search.model import BadInput, Fault

if TYPE_CHECKING:
    from distributed import Security


@dataclass(frozen=True)
class Certificates:
    """PEM files. Whoever has a certificate of the authority is trusted, whatever host it names."""

    ca: Path
    """Certificate of the authority that both ends trust."""
    cert: Path
    """Certificate of this end, signed by it."""
    key: Path
    """Private key of this end, without a passphrase."""

    def __post_init__(self) -> None:
        """Refuse files that cannot be used.

        Raises:
            BadInput: one is missing, or is no such file, or key and certificate are not of each other.
        """
        for field in fields(self):
            path = getattr(self, field.name)
            try:
                with open(path, "rb"):
                    pass
            except OSError as error:
                raise BadInput(f"dask-{field.name}", [Fault("", f"{path}: {error.strerror}")]) from None
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        try:
            context.load_verify_locations(cafile=self.ca)
        except ssl.SSLError as error:
            rule = f"must be a certificate in PEM format, but got {self.ca} ({error})"
            raise BadInput("dask-ca", [Fault("", rule)]) from None
        try:
            context.load_cert_chain(self.cert, self.key, password="")  # no passphrase is asked for
        except ssl.SSLError as error:
            rule = f"must be a certificate and its key in PEM format, but got {self.cert}, {self.key} ({error})"
            raise BadInput("dask-cert, dask-key", [Fault("", rule)]) from None


def security_of(address: str, certificates: Certificates | None) -> Security | None:
    """Return how a scheduler is connected to; None: as Dask's own configuration has it.

    Raises:
        BadInput: certificates without TLS, or TLS without certificates.
    """
    encrypted = address.startswith("tls://")
    if certificates is None:
        if encrypted:
            _require_configuration()
        return None
    if not encrypted:
        raise BadInput("dask", [Fault("", f"must be tls://HOST:PORT for certificates, but got {address!r}")])
    from distributed import Security

    return Security(
        require_encryption=True,
        tls_ca_file=str(certificates.ca),
        tls_client_cert=str(certificates.cert),
        tls_client_key=str(certificates.key),
    )


def _require_configuration() -> None:
    """Refuse TLS if Dask's own configuration has no certificates either; a key may be in the certificate's file."""
    import distributed  # noqa: F401 (has the defaults of the configuration)
    from dask import config

    lacking = [
        name
        for name in ("distributed.comm.tls.ca-file", "distributed.comm.tls.client.cert")
        if config.get(name) is None
    ]
    if lacking:
        rule = (
            "needs certificates with tls://HOST:PORT: give --dask-ca, --dask-cert and --dask-key (in Python: "
            f"dask_tls), or set {' and '.join(lacking)} in Dask's configuration"
        )
        raise BadInput("dask", [Fault("", rule)])
