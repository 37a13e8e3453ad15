"""Writing mp4: H.264, frame by frame, readable at every moment and quick to start when finished."""

import os
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from bunraku.nodes.renderer.view import Pixels

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

    def write(self, pixels: Pixels) -> None:
        """One frame, (height, width, 4)."""
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgba")
        self._last = self._scale.reformat(frame, format="yuv420p", dst_colorspace=BT709, dst_color_range=LIMITED)
        self._encode(self._last)

    def repeat(self) -> None:
        """The last frame once more, without drawing it."""
        self._encode(self._last)

    def _encode(self, frame: Any) -> None:
        frame.pts = self.frames
        frame.time_base = Fraction(1, self.fps)
        self.frames += 1
        try:
            for packet in self._stream.encode(frame):
                self._file.mux(packet)
        except (OSError, self._av.FFmpegError) as error:
            raise VideoError(f"{self.path} cannot be written: {error}") from None

    def close(self) -> None:
        """Finish the file; one without a frame is removed."""
        if self._file is None:
            return
        file, self._file = self._file, None
        try:
            for packet in self._stream.encode(None):
                file.mux(packet)
            file.close()
            if self.frames == 0:
                self.path.unlink(missing_ok=True)
            else:
                self._index_first()
        except (OSError, self._av.FFmpegError) as error:
            raise VideoError(f"{self.path} could not be finished: {error}") from None

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
