"""pyrender on today's Python and numpy, with a fast renderer: one colour-only read, own shaders, optional MSAA.

Importing this module loads OpenGL. One process has one way to a context: `prepare` chooses it first.
"""

import ctypes
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

SHADERS = Path(__file__).parent / "shaders"
PACKAGES = "libegl1 libgl1 libxrender1"
Pixels = NDArray[np.uint8]


class NoOpenGL(RuntimeError):
    """No OpenGL picture can be made here; the message is one line with the remedy."""


def prepare(window: bool) -> None:
    """Choose how this process reaches OpenGL, before pyrender is imported.

    Args:
        window: pictures are drawn in the context of an open pyglet window; else without any display (EGL).

    Raises:
        NoOpenGL: a system library is missing, or the other way was chosen before.
    """
    if sys.platform.startswith("linux"):
        for library in ("libGL.so.1",) if window else ("libEGL.so.1", "libGL.so.1"):
            try:
                ctypes.CDLL(library)
            except OSError:
                raise NoOpenGL(f"{library} is missing; install it with: apt-get install {PACKAGES}") from None
    loaded = "OpenGL" in sys.modules
    now = os.environ.get("PYOPENGL_PLATFORM") == "egl"
    if loaded and now == window:
        raise NoOpenGL("this process already draws " + ("without a window" if window else "in a window"))
    if window:
        os.environ.pop("PYOPENGL_PLATFORM", None)
    elif sys.platform.startswith("linux"):
        os.environ["PYOPENGL_PLATFORM"] = "egl"
    if not loaded:
        _mend(window)


def _mend(window: bool) -> None:
    """What pyrender 0.1.45 and PyOpenGL 3.1.0 need of numpy 2 and Python 3.12 and later."""
    if not hasattr(np, "infty"):
        setattr(np, "infty", np.inf)  # noqa: B010
    try:
        import pyglet
        from OpenGL.plugins import FormatHandler

        if not window:
            pyglet.options["headless"] = True
        if sys.version_info >= (3, 12):
            FormatHandler(
                "ctypesparameter312", "OpenGL.arrays.ctypesparameters.CtypesParameterHandler", ["_ctypes.CArgObject"]
            )
        import pyrender  # noqa: F401
    except Exception as error:  # whatever the loaders raise: ImportError, AttributeError, RuntimeError
        raise NoOpenGL(f"OpenGL cannot be loaded ({_line(error)}); try: apt-get install {PACKAGES}") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def headless() -> Any:
    """A current context without a display: the first EGL device that gives one.

    Returns:
        The pyrender platform object; ``delete_context()`` ends it.

    Raises:
        NoOpenGL: no device gives a context; says what each answered.
    """
    prepare(window=False)
    if not sys.platform.startswith("linux"):
        from pyrender.platforms.pyglet_platform import PygletPlatform

        try:
            hidden = PygletPlatform(1, 1)
            hidden.init_context()
            hidden.make_current()
        except Exception as error:
            raise NoOpenGL(f"no hidden window could be opened ({_line(error)})") from None
        return hidden
    from pyrender.platforms import egl

    answers = []
    try:
        devices = egl.query_devices()
    except Exception:  # an EGL without the device extension
        devices = [egl.EGLDevice(None)]
    first = os.environ.get("EGL_DEVICE_ID", "")
    if first.isdigit() and int(first) < len(devices):
        devices.insert(0, devices.pop(int(first)))
    for device in devices:
        platform = egl.EGLPlatform(1, 1, device=device)
        try:
            platform.init_context()
            platform.make_current()
        except Exception as error:
            answers.append(_line(error))
            continue
        return platform
    raise NoOpenGL(f"none of {len(devices)} EGL devices gives an OpenGL context ({'; '.join(answers) or 'no device'})")


def renderer_class() -> type[Any]:
    """The fast `pyrender.Renderer` subclass; call after `prepare`."""
    from OpenGL import GL
    from pyrender.renderer import Renderer
    from pyrender.shader_program import ShaderProgramCache

    class FastRenderer(Renderer):  # type: ignore[misc]
        """Draws into its own frame buffer and reads the colour back once, into the same array."""

        def __init__(self, width: int, height: int, samples: int) -> None:
            super().__init__(width, height)
            self.dpscale = 1  # pyrender doubles it on macOS: four times the pixels
            self.viewport_width, self.viewport_height = width, height
            self.samples = samples
            self.part = ""
            """Draw only the nodes whose names begin so."""
            self.window: tuple[int, int, int, int] | None = None
            """Left, bottom, width and height of the pixels to draw and read; all when None."""
            self.uniforms: dict[str, NDArray[np.float32]] = {}
            self.matrices: tuple[NDArray[np.float64], NDArray[np.float64]] = (np.eye(4), np.eye(4))
            self._program_cache = ShaderProgramCache(str(SHADERS))
            self._main_fb: Any = None
            self._main_fb_dims = (0, 0)
            self._buffers: list[Any] = []
            self._pixels: Pixels = np.empty((height, width, 4), np.uint8)

        def _compute_max_n_lights(self, flags: int) -> tuple[int, int, int]:
            return (0, 0, 0)

        def _get_camera_matrices(self, scene: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            return self.matrices

        def _bind_lighting(self, scene: Any, program: Any, node: Any, flags: int) -> None:
            for name, value in self.uniforms.items():
                program.set_uniform(name, value)

        def _sorted_mesh_nodes(self, scene: Any) -> list[Any]:
            # figures first: the ground behind them is then never shaded
            nodes = [node for node in scene.mesh_nodes if (node.name or "").startswith(self.part)]
            return sorted(nodes, key=lambda node: node.name or "")

        def _configure_forward_pass_viewport(self, flags: int) -> None:
            super()._configure_forward_pass_viewport(flags)
            if self.window is None:
                GL.glDisable(GL.GL_SCISSOR_TEST)
            else:
                GL.glEnable(GL.GL_SCISSOR_TEST)
                GL.glScissor(*self.window)

        def _storage(self, kind: Any, samples: int) -> Any:
            buffer = GL.glGenRenderbuffers(1)
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
            width, height = self.viewport_width, self.viewport_height
            if samples:
                GL.glRenderbufferStorageMultisample(GL.GL_RENDERBUFFER, samples, kind, width, height)
            else:
                GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, width, height)
            self._buffers.append(buffer)
            return buffer

        def _configure_main_framebuffer(self) -> None:
            size = (self.viewport_width, self.viewport_height)
            if self._main_fb is not None and size == self._main_fb_dims:
                return
            self._delete_main_framebuffer()
            self._main_fb_ms = self._frame(self.samples, depth=True)
            self._main_fb = self._frame(0, depth=False) if self.samples else self._main_fb_ms
            self._main_fb_dims = size

        def _frame(self, samples: int, depth: bool) -> Any:
            frame = GL.glGenFramebuffers(1)
            GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, frame)
            parts = [(GL.GL_COLOR_ATTACHMENT0, GL.GL_RGBA8)]
            if depth:
                parts.append((GL.GL_DEPTH_ATTACHMENT, GL.GL_DEPTH_COMPONENT24))
            for place, kind in parts:
                GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, place, GL.GL_RENDERBUFFER, self._storage(kind, samples))
            return frame

        def _delete_main_framebuffer(self) -> None:
            frames = {self._main_fb, self._main_fb_ms} - {None}
            if frames:
                GL.glDeleteFramebuffers(len(frames), list(frames))
            if self._buffers:
                GL.glDeleteRenderbuffers(len(self._buffers), self._buffers)
            self._buffers = []
            self._main_fb = self._main_fb_ms = None
            self._main_fb_dims = (0, 0)

        def _read_main_framebuffer(self, scene: Any, flags: int) -> tuple[Pixels, None]:
            x, y, width, height = self.window or (0, 0, *self._main_fb_dims)
            if self.samples:
                GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._main_fb_ms)
                GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, self._main_fb)
                GL.glDisable(GL.GL_SCISSOR_TEST)
                box = (x, y, x + width, y + height)
                GL.glBlitFramebuffer(*box, *box, GL.GL_COLOR_BUFFER_BIT, GL.GL_NEAREST)
            GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._main_fb)
            GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 4)
            if self._pixels.shape[:2] != (height, width):
                self._pixels = np.empty((height, width, 4), np.uint8)
            GL.glReadPixels(x, y, width, height, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, self._pixels)
            return self._pixels, None

    return FastRenderer


def update(primitive: Any, vertices: NDArray[np.float32]) -> None:
    """Put interleaved vertices (V, 10: position, normal, colour) in the place of a primitive's own."""
    from OpenGL import GL

    GL.glBindBuffer(GL.GL_ARRAY_BUFFER, primitive._buffers[0])
    GL.glBufferSubData(GL.GL_ARRAY_BUFFER, 0, vertices.nbytes, vertices)


def update_texture(texture: Any, pixels: Pixels) -> None:
    """Put pixels (n, n, 3) in the place of a texture's own."""
    from OpenGL import GL

    GL.glActiveTexture(GL.GL_TEXTURE0)
    texture._bind()
    GL.glPixelStorei(GL.GL_UNPACK_ALIGNMENT, 1)
    GL.glTexSubImage2D(
        GL.GL_TEXTURE_2D, 0, 0, 0, pixels.shape[1], pixels.shape[0], GL.GL_RGB, GL.GL_UNSIGNED_BYTE, pixels
    )
