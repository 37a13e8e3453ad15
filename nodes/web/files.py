"""The page's files, read once and kept compressed, and what is fetched beside them."""

import gzip
import hashlib
import re
import secrets
import shutil
from dataclasses import dataclass, field
from pathlib import Path

PAGE = Path(__file__).parent / "page"
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".bin": "application/octet-stream",
    ".mcap": "application/octet-stream",
    ".bvh": "text/plain; charset=utf-8",
    ".glb": "model/gltf-binary",
    ".mp4": "video/mp4",
}
WITHIN = re.compile(r"\s*/\*\*.*?\*/|\s+// .*$")
TICKET_SECONDS = 120.0
MAX_DOWNLOAD = 512 << 20


@dataclass(frozen=True)
class Asset:
    """One file as it is served."""

    body: bytes
    type: str
    packed: bytes = b""
    """The body compressed by gzip; empty where that does not pay."""
    etag: str = ""
    filename: str = ""
    """Offered as a download under this name."""


def asset(body: bytes, suffix: str) -> Asset:
    """Bytes made ready to be served."""
    packed = gzip.compress(body, 9, mtime=0)
    return Asset(
        body,
        TYPES.get(suffix, "application/octet-stream"),
        packed if len(packed) < 0.9 * len(body) else b"",
        f'"{hashlib.sha256(body).hexdigest()[:20]}"',
    )


def without_comments(text: str) -> str:
    """JavaScript with its comments taken out: what is served is small, and the lines keep their numbers.

    A comment begins a line (``//``, or ``/**`` and what follows up to ``*/``), stands in one (``/** */``) or ends it
    (`` // ``); in all of the page's modules these signs stand in no string.
    """
    lines, inside = [], False
    for line in text.split("\n"):
        bare = line.strip()
        begins = bare.startswith("/**") and not bare.partition("*/")[2]
        comment = inside or begins or bare.startswith("//")
        if inside or begins:
            inside = "*/" not in bare
        lines.append("" if comment else WITHIN.sub("", bare).strip())
    return "\n".join(lines)


def load_page(folder: Path = PAGE) -> dict[str, Asset]:
    """All files of the page by their path on the server."""
    files = {
        f"/{path.relative_to(folder).as_posix()}": asset(_served(path), path.suffix)
        for path in sorted(folder.rglob("*"))
        if path.suffix in (".html", ".js", ".css", ".svg")
    }
    files["/"] = files.pop("/index.html")
    files["/favicon.ico"] = files["/icon.svg"]
    return files


def _served(path: Path) -> bytes:
    text = path.read_text("utf-8")
    if path.suffix == ".js":
        return without_comments(text).encode()
    return "\n".join(line.strip() for line in text.split("\n")).encode()


def weight(files: dict[str, Asset]) -> int:
    """Bytes that a browser loads for the page, compressed, without headers."""
    return sum(len(a.packed or a.body) for path, a in files.items() if path != "/favicon.ico")


@dataclass
class Tickets:
    """Files that a page may fetch once: the way to a download knows no token."""

    entries: dict[str, tuple[float, Path | Asset, str, bool]] = field(default_factory=dict)

    def add(self, now: float, source: Path | Asset, filename: str, *, passing: bool = False) -> str:
        """The path under which a file can be fetched once, until `TICKET_SECONDS` from ``now`` s.

        A ``passing`` file was made for this: it is removed with the folder that holds it.
        """
        for key, (until, old, _, gone) in list(self.entries.items()):
            if until <= now:
                del self.entries[key]
                _remove(old, gone)
        key = secrets.token_urlsafe(16)
        self.entries[key] = (now + TICKET_SECONDS, source, filename, passing)
        return f"/ticket/{key}"

    def take(self, now: float, path: str) -> Asset | None:
        """The file behind a ticket's path; None where there is no such ticket, or no such file any more."""
        entry = self.entries.pop(path.removeprefix("/ticket/"), None)
        if entry is None:
            return None
        until, source, filename, passing = entry
        if until <= now:
            _remove(source, passing)
            return None
        if isinstance(source, Asset):
            return Asset(source.body, source.type, source.packed, source.etag, filename)
        try:
            if source.stat().st_size > MAX_DOWNLOAD:
                return None
            return Asset(source.read_bytes(), TYPES.get(source.suffix, TYPES[".bin"]), filename=filename)
        except OSError:
            return None
        finally:
            _remove(source, passing)


def _remove(source: Path | Asset, passing: bool) -> None:
    if passing and isinstance(source, Path):
        shutil.rmtree(source.parent, ignore_errors=True)
