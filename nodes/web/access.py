"""Who may talk to the page server: token, Host and Origin, rates; and the link that invites."""

import hmac
import secrets
import shutil
import socket
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
CERTIFICATE_DAYS = 365


class AccessError(RuntimeError):
    """The server cannot be offered as asked; the message says the remedy."""


@dataclass
class TokenBucket:
    """A rate with a burst: `take` says whether one more may pass now."""

    rate: float  # a second
    burst: float
    level: float = field(init=False)
    last: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self.level = self.burst

    def take(self, now: float, amount: float = 1.0) -> bool:
        """Take ``amount`` at ``now`` s; False where that much is not there."""
        self.level = min(self.burst, self.level + max(0.0, now - self.last) * self.rate)
        self.last = now
        if amount > self.level:
            return False
        self.level -= amount
        return True


@dataclass(frozen=True)
class Gate:
    """The rules at the door."""

    hosts: frozenset[str]
    """Allowed values of the Host header, lower case, with the port where it is not the scheme's own."""
    scheme: str = "http"
    token: str = ""
    """Empty: no token is asked for."""

    def host_ok(self, host: str | None) -> bool:
        """Whether a Host header names this server (a page of another name that resolves to this address does not)."""
        return host is not None and host.lower() in self.hosts

    def origin_ok(self, origin: str | None, host: str | None) -> bool:
        """Whether a WebSocket is opened by a page of this very server."""
        if origin is None or host is None:
            return False
        parts = urlsplit(origin.lower())
        return parts.scheme == self.scheme and parts.netloc == host.lower() and parts.netloc in self.hosts

    def token_ok(self, token: str) -> bool:
        """Whether a page knows the token; the time it takes does not tell how much of it was right."""
        return not self.token or hmac.compare_digest(token.encode(), self.token.encode())


def host_names(names: Iterable[str], port: int, scheme: str) -> frozenset[str]:
    """The Host headers by which names are reached on a port."""
    default = {"http": 80, "https": 443}[scheme]
    hosts = {f"{name.lower()}:{port}" for name in names if name}
    return frozenset(hosts | {name.lower() for name in names if name and port == default})


def lan_address() -> str:
    """The address under which this machine is reached from its network; raises `AccessError` where there is none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing: only asks which interface would be used
            address: str = probe.getsockname()[0]
        except OSError:
            address = "127.0.0.1"
    if address.startswith("127.") or address == "0.0.0.0":
        raise AccessError("no network interface for lan:=true: connect to a network, or use lan:=false here")
    return address


def new_token() -> str:
    """A token of 128 random bits."""
    return secrets.token_urlsafe(16)


def certificate(folder: Path, names: Iterable[str]) -> tuple[Path, Path, str]:
    """A self-made certificate for names and addresses: (certificate, key, SHA-256 fingerprint).

    It is made by the ``openssl`` program and kept in ``folder`` (mode 0700), so that a tablet that trusted it once
    still does; it is made anew when it runs out or lacks a name. Raises `AccessError`.
    """
    program = shutil.which("openssl")
    if program is None:
        raise AccessError(
            "tls:=true needs the `openssl` program to make a certificate: apt-get install openssl (or brew install "
            "openssl), or give your own with certificate:=FILE key:=FILE"
        )
    cert, key, listed = folder / "cert.pem", folder / "key.pem", folder / "names.txt"
    san = sorted({f"IP:{n.strip('[]')}" if _is_address(n) else f"DNS:{n}" for n in names if n})
    known = set(listed.read_text().split()) if listed.exists() else set()
    fresh = cert.exists() and key.exists() and set(san) <= known
    if not fresh or _run(program, "x509", "-in", str(cert), "-noout", "-checkend", "86400").returncode:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        made = _run(
            program, "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days",
            str(CERTIFICATE_DAYS), "-keyout", str(key), "-out", str(cert), "-subj", "/CN=bunraku", "-addext",
            "subjectAltName=" + ",".join(san), "-addext", "extendedKeyUsage=serverAuth",
        )  # fmt: skip
        if made.returncode:
            raise AccessError(f"openssl made no certificate: {made.stderr.strip().splitlines()[-1:]}")
        key.chmod(0o600)
        listed.write_text("\n".join(san))
    shown = _run(program, "x509", "-in", str(cert), "-noout", "-fingerprint", "-sha256").stdout
    return cert, key, shown.partition("=")[2].strip()


def qr(link: str) -> str:
    """A QR code of a link for a terminal (half blocks; black on white, quiet zone included)."""
    import io

    import segno

    out = io.StringIO()
    segno.make(link, error="m", micro=False).terminal(out, compact=True)
    return out.getvalue()


def _run(*command: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(command, capture_output=True, text=True, timeout=30, check=False, umask=0o077)


def _is_address(name: str) -> bool:
    for family, text in ((socket.AF_INET, name), (socket.AF_INET6, name.strip("[]"))):
        try:
            socket.inet_pton(family, text)
        except OSError:
            continue
        return True
    return False


def peer_user(peer: tuple[str, int], server_port: int, table: Path = Path("/proc/net/tcp")) -> int | None:
    """The user id behind a loopback connection (Linux); None where it cannot be told."""
    address = f"{socket.htonl(int.from_bytes(socket.inet_aton(peer[0]), 'big')):08X}:{peer[1]:04X}"
    try:
        lines = table.read_text().splitlines()[1:]
    except OSError:
        return None
    for line in lines:
        fields = line.split()
        if len(fields) > 7 and fields[1] == address and fields[2].endswith(f":{server_port:04X}"):
            return int(fields[7])
    return None
