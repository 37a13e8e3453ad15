"""The keys of a bridge: CURVE pairs in a folder, the secret ones readable by their owner alone.

``listen.key_secret`` and ``<name>.key`` of every peer belong on the machine that listens; ``<name>.key_secret``
and ``listen.key`` on the machine of the peer ``<name>`` (default: connect).
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path

import zmq

LISTEN, CONNECT = "listen", "connect"
_KEY = re.compile(r'(public|secret)-key\s*=\s*"(.{40})"')


class KeyProblem(ValueError):
    """Keys that cannot be used; one line with the remedy."""


@dataclass(frozen=True)
class Pair:
    """A CURVE pair, Z85 text."""

    public: bytes
    secret: bytes


def write_pair(folder: Path, name: str) -> list[Path]:
    """Make a pair and write ``<name>.key`` and ``<name>.key_secret``; raises `KeyProblem` where one is there."""
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,64}", name):
        raise KeyProblem(f"key name {name!r}: use letters, digits, '_' and '-'")
    public, secret = zmq.curve_keypair()
    paths = [folder / f"{name}.key", folder / f"{name}.key_secret"]
    for path in paths:
        if path.exists():
            raise KeyProblem(f"{path} is there already: remove it, or choose another folder or --name")
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    texts = [f'public-key = "{public.decode()}"\n', f'secret-key = "{secret.decode()}"\n']
    for path, text in zip(paths, [texts[0], "".join(texts)], strict=True):
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(text)
    return paths


def _read(path: Path, wanted: str) -> bytes:
    try:
        text = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise KeyProblem(f"{path} cannot be read ({error.__class__.__name__}): bunraku keys {path.parent}") from None
    found = dict(_KEY.findall(text))
    if wanted not in found:
        raise KeyProblem(f"{path} holds no {wanted} key: write the keys again with bunraku keys")
    return str(found[wanted]).encode()


def read_pair(path: Path) -> Pair:
    """A pair from its ``.key_secret`` file; refuses one that others can read."""
    pair = Pair(_read(path, "public"), _read(path, "secret"))
    if path.stat().st_mode & 0o077:
        raise KeyProblem(f"{path} can be read by others: chmod 600 {path}")
    return pair


def listener(folder: Path) -> tuple[Pair, frozenset[bytes]]:
    """The listening side's pair and the public keys that it lets in."""
    pair = read_pair(folder / f"{LISTEN}.key_secret")
    peers = frozenset(_read(path, "public") for path in sorted(folder.glob("*.key")) if path.stem != LISTEN)
    if not peers:
        raise KeyProblem(f"{folder} holds no peer's .key: nobody could connect; write one with bunraku keys {folder}")
    return pair, peers


def connector(folder: Path) -> tuple[Pair, bytes]:
    """The connecting side's pair and the public key of the side that it connects to."""
    secrets = [path for path in sorted(folder.glob("*.key_secret")) if path.stem != LISTEN]
    if len(secrets) != 1:
        names = ", ".join(path.name for path in secrets) or "none"
        raise KeyProblem(f"{folder} must hold one peer's .key_secret beside {LISTEN}.key (has: {names})")
    return read_pair(secrets[0]), _read(folder / f"{LISTEN}.key", "public")
