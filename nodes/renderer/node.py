"""Shows the figures in a window and films them."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from bunraku.msgs import Camera, Message, Overlay, Pose, SkeletonMessage
from bunraku.nodes.renderer.engine import ENGINES, open_engine
from bunraku.nodes.renderer.film import SECOND, Film, Shots
from bunraku.nodes.renderer.view import Engine
from bunraku.nodes.renderer.window import NoWindow, Window, display
from bunraku.nodes.renderer.worker import Worker
from bunraku.runtime.node import Node, param, request, subscribe, timer
from bunraku.runtime.presence import Presence

REPORT = 10 * SECOND
"""ns between two lines about frames that this machine was too slow to draw."""


class Renderer(Node):
    """Draws the figures and their overlays: in a window, as mp4, as pictures."""

    name = "renderer"
    journal = False  # it says nothing that could be compared

    output: str = param("", doc="the film to write, mp4; empty for none")
    sheet: str = param("", doc="a contact sheet of the performance to write at the end, png")
    picture: str = param("", doc="the last frame to write at the end, png")
    size: str = param("1280x720", doc="of the picture, in pixels")
    fps: int = param(60, low=1, high=240, doc="frames a second")
    window: str = param("auto", choices=["auto", "on", "off"], doc="auto: where there is a display")
    samples: int = param(4, low=0, high=16, doc="of OpenGL's antialiasing; 0 is faster")
    engine: str = param("auto", choices=ENGINES, doc="gl needs OpenGL, pillow draws without")
    figures: list[str] = param([""], doc="namespaces of the figures that are shown; empty text for the one without")
    overlays: bool = param(True, doc="whether what the nodes lay over the picture is drawn")

    shown: Window | None = None
    film: Film | None = None
    worker: Worker | None = None
    _engine: Engine | None = None

    @classmethod
    def further(cls, params: dict[str, Any]) -> tuple[Sequence[str], Sequence[str]]:
        """What the figures of these parameters say."""
        parts = ("pose", "skeleton", "camera", "overlay/*")
        return (), [f"{name}/{part}" for name in params["figures"] if name for part in parts]

    def setup(self) -> None:
        """Open the window, or the thread that films without one."""
        shots = self._shots()
        self.presence = Presence(getattr(self.stage, "folder", None))
        self._told = (0, 0)
        for name in self.figures:
            if name:
                for part, kind in (("pose", Pose), ("skeleton", SkeletonMessage), ("camera", Camera)):
                    self.listen(f"{name}/{part}", kind, partial(self._hear, f"{name}/{part}"), trigger=False)
                self.listen(f"{name}/overlay/*", Overlay, self._hear_overlay, trigger=False)
        self.every(self.fps, self.tick)
        if self.window == "on" or (self.window == "auto" and display()):
            try:
                self._open_window(shots)
                return
            except NoWindow as error:
                if self.window == "on":
                    raise ValueError(str(error)) from None
                self.log.info("no window: %s", error)
        if not (shots.output or shots.sheet or shots.picture):
            self.log.info("nothing to write and no window: set output, sheet or picture, or ask for `picture`")
        self.worker = Worker(shots, self._open_engine, self._failed)

    def _open_window(self, shots: Shots) -> None:
        self.shown = Window(shots.width, shots.height)
        try:
            if self.engine == "pillow":
                from bunraku.nodes.renderer.opengl import prepare

                prepare(window=True)  # its pictures are still shown by OpenGL
                self._engine = open_engine("pillow")
            else:
                from bunraku.nodes.renderer.glengine import GLEngine

                self._engine = GLEngine(self.samples, windowed=True)
            self.film = Film(shots, self._engine, shown=True)
        except RuntimeError as error:
            self.shown.close()
            self.shown = None
            raise NoWindow(str(error)) from None

    def _open_engine(self) -> Engine:
        return open_engine(self.engine, self.samples, self._say)

    def _say(self, line: str) -> None:
        self.post(partial(self.log.warning, "%s", line))

    def _failed(self, line: str) -> None:
        def end() -> None:
            self.log.error("%s", line)
            self.stop(1)

        self.post(end)

    def _shots(self) -> Shots:
        return Shots(
            self.output, self.sheet, self.picture, *read_size(self.size), self.fps,
            tuple(self.figures) or ("",), self.overlays,
        )  # fmt: skip

    def teardown(self) -> None:
        """Finish all files."""
        written: list[Path] = []
        if self.worker is not None:
            written = self.worker.close()
            self._tell(self.worker.frames, self.worker.repeated)
        if self.film is not None:
            written = self.film.close(self.now)
        if self._engine is not None:
            self._engine.close()
        if self.shown is not None:
            self.shown.close()
        for path in written:
            self.log.info("wrote %s", path)

    def on_param(self, name: str) -> None:
        """A new output, sheet, picture or size ends the film and begins another; the others need a new start."""
        shots = self._shots()
        if self.worker is not None:
            self.worker.change(shots)
        elif self.film is not None and self._engine is not None:
            heard = self.film.scene
            self.film.close(self.now)
            self.film = Film(shots, self._engine, shown=True)
            self.film.scene = heard

    # What is heard

    @subscribe("pose", Pose, trigger=False)
    def on_pose(self, message: Pose) -> None:
        """The newest pose of the figure without a namespace."""
        self._hear("pose", message)

    @subscribe("skeleton", SkeletonMessage, trigger=False)
    def on_skeleton(self, message: SkeletonMessage) -> None:
        """Its skeleton."""
        self._hear("skeleton", message)

    @subscribe("camera", Camera, trigger=False)
    def on_camera(self, message: Camera) -> None:
        """Where the picture is taken from."""
        self._hear("camera", message)

    @subscribe("overlay/*", Overlay, trigger=False)
    def on_overlay(self, message: Overlay, topic: str) -> None:
        """What a node lays over the picture."""
        self._hear_overlay(message, topic)

    @timer(hz=2)
    def sweep(self) -> None:
        """What a node drew goes with the node."""
        for topic in self.presence.gone():
            self._draw_overlay(Overlay(), topic)

    def _hear_overlay(self, message: Overlay, topic: str) -> None:
        self.presence.heard(topic, message.seq)
        self._draw_overlay(message, topic)

    def _draw_overlay(self, message: Overlay, topic: str) -> None:
        own = f"{self.namespace}/"
        self._hear(topic.removeprefix(own) if self.namespace else topic, message)

    def _hear(self, topic: str, message: Message) -> None:
        if self.worker is not None:
            self.worker.feed(self.now, topic, message)
        elif self.film is not None:
            self.film.hear(topic, message)

    # What is shown

    def tick(self) -> None:
        """A frame is due."""
        if self.worker is not None:
            self.worker.tick(self.now)
            if self.now - self._told[0] > REPORT:
                self._tell(self.worker.frames, self.worker.repeated)
        elif self.film is not None and self.shown is not None:
            self._show(self.film, self.shown)

    def _show(self, film: Film, window: Window) -> None:
        window.poll()
        if film.start is None and film.scene.ready:
            film.start = self.now
        film.advance(self.now - SECOND // self.fps, draw=False)  # what was missed while the last one was drawn
        film.advance(self.now)
        if film.pixels is not None and not window.closed:
            window.show(film.pixels)
        if window.closed and not (self.output or self.sheet or self.picture):
            self.log.info("the window was closed")
            self.stop(0)

    def _tell(self, frames: int, repeated: int) -> None:
        if repeated > self._told[1]:
            self.log.warning("film: %d of %d frames repeat the one before: this machine is busy", repeated, frames)
        self._told = (self.now, repeated)

    @request("picture")
    def take_picture(self, path: str = "") -> dict[str, Any]:
        """Write a picture of this moment."""
        if not path:
            raise ValueError("give the file: path=...")
        if self.worker is not None:
            self.worker.picture(path, self.now)
        elif self.film is not None and self.film.pixels is not None:
            from bunraku.nodes.renderer.sheet import save_picture

            save_picture(self.film.pixels, path)
        else:
            raise ValueError("there is no picture yet")
        return {"path": path}


def read_size(text: str) -> tuple[int, int]:
    """Width and height of '1280x720'; raises ValueError."""
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise ValueError(f"size: {text!r} is not like 1280x720") from None
    if not (16 <= width <= 8192 and 16 <= height <= 8192) or width % 2 or height % 2:
        raise ValueError(f"size: {text} must be even and within 16x16 and 8192x8192")
    return width, height
