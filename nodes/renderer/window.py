"""A window that shows finished pictures, scaled to its size without changing their shape."""

import os
import sys
from typing import Any

import numpy as np

from bunraku.figure.camera import letterbox
from bunraku.nodes.renderer.scene import BARS
from bunraku.nodes.renderer.view import Pixels


class NoWindow(RuntimeError):
    """No window can be opened; one line."""


def display() -> bool:
    """Whether there may be a display to open a window on."""
    return bool(os.environ.get("DISPLAY")) or not sys.platform.startswith("linux")


class Window:
    """Open it on the main thread, before anything of OpenGL is loaded; its context is current afterwards."""

    def __init__(self, width: int, height: int, title: str = "bunraku") -> None:
        if not display():
            raise NoWindow("no display: set DISPLAY, or window:=off")
        try:
            import pyglet

            pyglet.options["shadow_window"] = False
            import pyglet.window

            config = pyglet.gl.Config(  # type: ignore[abstract]
                major_version=3, minor_version=3, double_buffer=True, depth_size=24
            )
            self._window: Any = pyglet.window.Window(
                width, height, caption=title, resizable=True, vsync=False, config=config
            )
        except Exception as error:  # whatever the windowing system raises
            why = " ".join(str(error).split()) or type(error).__name__
            raise NoWindow(f"no window can be opened ({why})") from None
        self.closed = False
        self._window.push_handlers(on_close=self._on_close, on_key_press=self._on_key)
        self._window.switch_to()
        self._texture: Any = None
        self._frame: Any = None
        self._shape = (0, 0)

    def _on_close(self) -> bool:
        self.closed = True
        self._window.set_visible(False)
        return True  # the context is still needed

    def _on_key(self, symbol: int, modifiers: int) -> bool:
        if symbol == 0xFF1B:  # Escape, which would else end pyglet
            self._on_close()
        return True

    def poll(self) -> None:
        """Take the user's doings with the window, and make its context current."""
        self._window.switch_to()
        self._window.dispatch_events()

    def show(self, pixels: Pixels) -> None:
        """Show a picture (h, w, 4), letterboxed."""
        from OpenGL import GL

        height, width = pixels.shape[:2]
        if self._texture is None:
            self._texture = GL.glGenTextures(1)
            self._frame = GL.glGenFramebuffers(1)
        GL.glActiveTexture(GL.GL_TEXTURE0)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texture)
        GL.glPixelStorei(GL.GL_UNPACK_ALIGNMENT, 4)
        data = np.ascontiguousarray(pixels)
        if self._shape != (height, width):
            GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, GL.GL_RGBA8, width, height, 0, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, data)
            self._shape = (height, width)
        else:
            GL.glTexSubImage2D(GL.GL_TEXTURE_2D, 0, 0, 0, width, height, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, data)
        GL.glBindTexture(GL.GL_TEXTURE_2D, 0)
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._frame)
        GL.glFramebufferTexture2D(GL.GL_READ_FRAMEBUFFER, GL.GL_COLOR_ATTACHMENT0, GL.GL_TEXTURE_2D, self._texture, 0)
        GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, 0)
        GL.glDisable(GL.GL_SCISSOR_TEST)
        full = self._window.get_framebuffer_size()
        left, top, inner, tall = (round(part) for part in letterbox(width / height, *full))
        GL.glClearColor(*(part / 255.0 for part in BARS), 1.0)
        GL.glClear(GL.GL_COLOR_BUFFER_BIT)
        # rows run downwards in the picture and upwards in the window
        GL.glBlitFramebuffer(
            0, 0, width, height, left, top + tall, left + inner, top, GL.GL_COLOR_BUFFER_BIT, GL.GL_LINEAR
        )
        self._window.flip()

    def close(self) -> None:
        """Close the window and its context."""
        self._window.close()
