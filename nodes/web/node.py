"""The node: pages hear what the stage shows, and the stage hears what their hands did."""

import logging
import ssl
import sys
import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from bunraku.figure.skeleton import SkeletonError
from bunraku.figure.wire import from_message
from bunraku.msgs import Camera, Event, Overlay, Params, Pose, SkeletonMessage
from bunraku.nodes.web.access import LOOPBACK, AccessError, Gate, certificate, host_names, lan_address, new_token, qr
from bunraku.nodes.web.audience import Hooks
from bunraku.nodes.web.calls import Calls
from bunraku.nodes.web.files import asset, load_page
from bunraku.nodes.web.mesh import pack_mesh
from bunraku.nodes.web.protocol import (
    CAMERA,
    OVERLAY,
    POSE,
    Input,
    encode_text,
    pack_camera,
    pack_overlay,
    pack_pose,
)
from bunraku.nodes.web.server import PageServer
from bunraku.nodes.web.takes import Takes
from bunraku.runtime.node import BoundPublisher, Node, ParamProblem, Publisher, param, subscribe, timer
from bunraku.runtime.presence import Presence

PORTS = 20
"""Ports that are tried from the one asked for on."""


class _Kept(msgspec.Struct):
    """What a restarted node takes up: pages find back to the same place."""

    token: str = ""
    port: int = 0
    playing: dict[str, str] = {}
    """Page -> figure, of pages whose hands were heard."""


@dataclass(frozen=True)
class _Door:
    """Where and how pages come in."""

    bind: str
    name: str
    gate_names: tuple[str, ...]
    token: str


class Web(Node):
    """The stage page: any tablet, phone or laptop shows the figure and plays it."""

    name = "web"
    journal = False  # what it says comes from browsers
    events: Publisher[Event] = Publisher("web/events", Event)
    port: int = param(8420, low=0, high=65535, doc="of the page; 0 takes any free one")
    lan: bool = param(False, doc="let other devices of the network in, by a link with a token")
    tls: bool = param(False, doc="https with a self-made certificate: gives tablets every pen sample")
    certificate: str = param("", doc="PEM file of a certificate of your own for tls")
    key: str = param("", doc="PEM file of its key")
    hosts: list[str] = param([], doc="further names under which the page is opened (a proxy's)")
    figures: list[str] = param([""], doc="namespaces of the figures that are shown, the first is played first")
    takes: str = param("takes", doc="folder for takes recorded from the page")
    open: bool = param(False, doc="open the page in this machine's browser")

    def setup(self) -> None:
        self.device = True
        self.kept = _Kept()
        self.meshes: set[str] = set()
        folder: Path | None = getattr(self.stage, "folder", None)
        self.presence = Presence(folder)
        self.drawn: dict[str, int] = {}
        """Topic of an overlay -> its figure's number."""
        names = list(dict.fromkeys(self.figures)) or [""]
        self.said: dict[str, BoundPublisher[Event]] = {}
        for index, figure in enumerate(names):
            self._follow(figure, index)
        self.calls = Calls(folder, Takes(Path(self.takes)), self.namespace)
        door = self._door()
        gate = Gate(frozenset(), "https" if self.tls else "http", door.token)
        self.server = PageServer(
            Hooks(
                on_input=lambda page, figure, sample, received: self.post(
                    lambda: self._on_input(page, figure, sample, received)
                ),
                on_gone=lambda page, figure: self.post(lambda: self._on_gone(page, figure)),
                on_call=self.calls,
            ),
            load_page(),
            gate,
            tuple(names),
            self.log.getChild("pages") if isinstance(self.log, logging.Logger) else None,
            {"lan": self.lan},
        )
        self.calls.server = self.server
        self.door = door
        self.listening = False
        self.post(self._open_door)

    def teardown(self) -> None:
        self.server.stop()
        self.calls.close()

    def save(self) -> bytes | None:
        return msgspec.msgpack.encode(self.kept)

    def restore(self, state: bytes) -> None:
        try:
            self.kept = msgspec.msgpack.decode(state, type=_Kept)
        except msgspec.MsgspecError:
            self.log.warning("what was kept of the last run cannot be read: pages need the new link")

    @subscribe("params/*", Params)
    def on_params(self, msg: Params, topic: str) -> None:
        """Parameters of any node."""
        self.calls.params[msg.node] = msg
        self.server.tell("heard", encode_text("heard", ways=self.calls.ways()))

    @classmethod
    def further(cls, params: dict[str, Any]) -> tuple[Sequence[str], Sequence[str]]:
        """What the figures of these parameters say, and what their pages do."""
        leads = [f"{figure}/" if figure else "" for figure in params["figures"] or [""]]
        shown = [f"{lead}{topic}" for lead in leads for topic in ("pose", "skeleton", "camera", "overlay/*")]
        return [f"{lead}web/events" for lead in leads], shown

    # -- what the stage shows ----------------------------------------------------------------------------------

    def _follow(self, figure: str, index: int) -> None:
        lead = f"{figure}/" if figure else ""
        self.said[figure] = self.advertise(f"{lead}web/events", Event) if figure else self.events

        def on_pose(msg: Pose) -> None:
            self.server.offer(f"{index} pose", POSE, index, pack_pose(msg), msg.origin)

        def on_skeleton(msg: SkeletonMessage) -> None:
            self._on_skeleton(figure, index, msg)

        def on_camera(msg: Camera) -> None:
            self.server.offer(f"{index} camera", CAMERA, index, pack_camera(msg))

        def on_overlay(msg: Overlay, topic: str) -> None:
            self.presence.heard(topic, msg.seq)
            self.drawn[topic] = index
            self._show_overlay(topic, msg)

        self.listen(f"{lead}pose", Pose, on_pose)
        self.listen(f"{lead}skeleton", SkeletonMessage, on_skeleton)
        self.listen(f"{lead}camera", Camera, on_camera)
        self.listen(f"{lead}overlay/*", Overlay, on_overlay)

    def _show_overlay(self, topic: str, msg: Overlay) -> None:
        index = self.drawn[topic]
        self.server.offer(f"{index} {topic}", OVERLAY, index, pack_overlay(topic, msg))

    @timer(hz=2)
    def sweep(self) -> None:
        """What a node drew goes with the node."""
        for topic in self.presence.gone():
            self._show_overlay(topic, Overlay())

    def _on_skeleton(self, figure: str, index: int, msg: SkeletonMessage) -> None:
        try:
            skeleton = from_message(msg)
            if skeleton.hash not in self.meshes:
                self.server.put_file(f"/figure/{skeleton.hash}.bin", asset(pack_mesh(skeleton), ".bin"))
                self.meshes.add(skeleton.hash)
        except SkeletonError as error:
            self.log.warning("figure %r cannot be shown: %s", figure, error)
            return
        self.server.tell(
            f"skeleton {figure}",
            encode_text(
                "skeleton", figure=figure, index=index, hash=skeleton.hash, names=skeleton.names,
                parents=skeleton.parents.tolist(), offsets=skeleton.offsets.ravel().tolist(),
                roles=dict(skeleton.roles), mesh=f"/figure/{skeleton.hash}.bin",
            ),
        )  # fmt: skip

    # -- what the hands did ------------------------------------------------------------------------------------

    def _on_input(self, page: str, figure: str, sample: Input, received: int) -> None:
        if page not in self.kept.playing:
            self.kept.playing[page] = figure
        event = sample.event(f"web-{page}")
        event.origin = received
        self.said[figure].publish(event)

    def _on_gone(self, page: str, figure: str) -> None:
        self.kept.playing.pop(page, None)
        self.said[figure].publish(Event(device=f"web-{page}", kind="gone", origin=self.now))

    # -- the door ------------------------------------------------------------------------------------------------

    def _door(self) -> _Door:
        extra = tuple(self.hosts)
        if not self.lan:
            return _Door("127.0.0.1", "127.0.0.1", (*LOOPBACK, *extra), "")
        try:
            name = lan_address()
        except AccessError as error:
            raise ParamProblem(f"lan: {error}") from None
        return _Door("0.0.0.0", name, (name, *LOOPBACK, *extra), new_token())

    def _context(self) -> ssl.SSLContext | None:
        if not self.tls:
            return None
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        if self.certificate:
            context.load_cert_chain(self.certificate, self.key or None)
            return context
        cert, key, fingerprint = certificate(data_folder() / "tls", self.door.gate_names)
        context.load_cert_chain(cert, key)
        self.log.info("certificate %s: browsers ask once whether to trust it; compare its SHA-256 there", fingerprint)
        return context

    def _open_door(self) -> None:
        """Listen; pages of a run before this one let go of what they held."""
        door = self.door
        if self.kept.token and door.token:
            door = self.door = _Door(door.bind, door.name, door.gate_names, self.kept.token)
        self.kept.token = door.token
        for page, figure in list(self.kept.playing.items()):
            if figure in self.said:
                self._on_gone(page, figure)
        first = self.kept.port or self.port
        scheme = "https" if self.tls else "http"
        try:
            context = self._context()
            for port in range(first, first + 1 if first == 0 else min(first + PORTS, 65536)):
                try:
                    gate = Gate(host_names(door.gate_names, port, scheme), scheme, door.token)
                    self.server.gate = gate
                    self.server.start(door.bind, port, context)
                    break
                except AccessError as error:
                    problem = error
            else:
                raise problem
        except (AccessError, OSError, ssl.SSLError) as error:
            self.log.error("the page cannot be offered: %s", error)
            self.stop(2)
            return
        if first == 0:
            self.server.gate = Gate(host_names(door.gate_names, self.server.port, scheme), scheme, door.token)
        self.kept.port = self.server.port
        self.listening = True
        self._invite(f"{scheme}://{door.name}:{self.server.port}/", door.token)

    def _invite(self, address: str, token: str) -> None:
        """Say the link: with its token only to the terminal, for the log may be recorded."""
        link = f"{address}#t={token}" if token else address
        self.log.info("the stage page is at %s%s", address, " (the link with its token follows)" if token else "")
        if token:
            print(f"\n{qr(link)}\n{link}\n", file=sys.stderr, flush=True)
        if self.open:
            webbrowser.open(link)


def data_folder() -> Path:
    """Where the certificate is kept."""
    import os

    base = os.environ.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "bunraku"
