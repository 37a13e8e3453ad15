"""Writing mp4: H.264, frame by frame, readable at every moment and quick to start when finished."""

import os
import threading
from fractions import Fraction
from pathlib import Path
from queue import Queue
from typing import Any

import numpy as np

from bunraku.nodes.renderer.view import Pixels

_END = object()
BT709 = 1
LIMITED = 1
"""FFmpeg's numbers of the colour space and of its range of values."""


class VideoError(RuntimeError):
    """A film that cannot be written; one line."""


class Video:
    """An mp4 of exactly ``fps`` frames a second.

    While it is written it is a fragmented mp4: what a killed process leaves can be played, but for its last
    second. `close` turns it into a plain one with its index in front.
    """

    def __init__(self, path: str | Path, width: int, height: int, fps: int, quality: int = 20) -> None:
        import av

        if width % 2 or height % 2:
            raise VideoError(f"{width}x{height}: an H.264 film needs even sizes")
        self.path = Path(path)
        self.fps, self.frames = fps, 0
        self._av = av
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file: Any = av.open(
                str(self.path), "w", format="mp4",
                options={"movflags": "frag_keyframe+empty_moov+default_base_moof", "flush_packets": "1"},
            )  # fmt: skip
            stream = self._file.add_stream("libx264", rate=fps)
        except (OSError, ValueError, av.FFmpegError) as error:
            raise VideoError(f"{self.path} cannot be written: {error}") from None
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.time_base = Fraction(1, fps)
        stream.codec_context.options = {
            "crf": str(quality), "preset": "superfast", "g": str(fps), "bf": "0", "tune": "animation",
            "colorprim": "bt709", "transfer": "bt709", "colormatrix": "bt709",
        }  # fmt: skip
        stream.codec_context.color_range = LIMITED
        stream.codec_context.colorspace = BT709
        stream.codec_context.color_primaries = BT709
        stream.codec_context.color_trc = BT709
        self._stream = stream
        self._scale = av.video.reformatter.VideoReformatter()
        self._last: Any = None
        # drawing and encoding overlap: two frames may wait
        self._queue: Queue[Any] = Queue(maxsize=2)
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="encoder", daemon=True)
        self._thread.start()

    def write(self, pixels: Pixels) -> None:
        """One frame, (height, width, 4); may be changed at once. Raises `VideoError`, also for an earlier frame."""
        self._put(self._av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgba"))

    def repeat(self) -> None:
        """The last frame once more, without drawing it."""
        self._put(None)

    def _put(self, frame: Any) -> None:
        self._check("written")
        self.frames += 1
        self._queue.put(frame)

    def _check(self, what: str) -> None:
        if self._error is not None:
            raise VideoError(f"{self.path} cannot be {what}: {self._error}") from None

    def _run(self) -> None:
        count = 0
        while (frame := self._queue.get()) is not _END:
            if self._error is not None:
                continue  # whoever writes is not left waiting
            try:
                if frame is not None:
                    self._last = self._scale.reformat(
                        frame, format="yuv420p", dst_colorspace=BT709, dst_color_range=LIMITED
                    )
                self._last.pts, self._last.time_base = count, Fraction(1, self.fps)
                count += 1
                for packet in self._stream.encode(self._last):
                    self._file.mux(packet)
            except Exception as error:
                self._error = error

    def close(self) -> None:
        """Finish the file; one without a frame is removed."""
        if self._file is None:
            return
        self._queue.put(_END)
        self._thread.join()
        file, self._file = self._file, None
        try:
            if self._error is None:
                for packet in self._stream.encode(None):
                    file.mux(packet)
            file.close()
            if self.frames == 0:
                self.path.unlink(missing_ok=True)
            elif self._error is None:
                self._index_first()
        except (OSError, self._av.FFmpegError) as error:
            self._error = self._error or error
        self._check("finished")

    def _index_first(self) -> None:
        """Copy the packets into a plain mp4 beside it, which then takes its place."""
        plain = self.path.with_name(f".{self.path.name}.part")
        try:
            with (
                self._av.open(str(self.path)) as source,
                self._av.open(str(plain), "w", format="mp4", options={"movflags": "faststart"}) as target,
            ):
                stream = source.streams.video[0]
                copy = target.add_stream_from_template(stream)
                for packet in source.demux(stream):
                    if packet.dts is not None:
                        packet.stream = copy
                        target.mux(packet)
            os.replace(plain, self.path)
        finally:
            plain.unlink(missing_ok=True)
