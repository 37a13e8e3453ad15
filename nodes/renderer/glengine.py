"""Pictures by OpenGL: pyrender's scene with one primitive a figure, skinned on the CPU and updated in place."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.camera import axes, project, to_camera
from bunraku.figure.capsules import Capsules, capsules
from bunraku.figure.mannequin import MEDIUM, Detail, build
from bunraku.figure.mesh import Mesh
from bunraku.figure.skeleton import Skeleton
from bunraku.nodes.renderer import opengl
from bunraku.nodes.renderer.shadow import Shadow, chosen
from bunraku.nodes.renderer.view import LOOK, Figure, Look, Pixels, View, projection_matrix, view_matrix

Single = NDArray[np.float32]
GROUND = 14.0  # m, half the ground's side; it fades out before


class Body:
    """One figure's mesh on the card."""

    def __init__(self, skeleton: Skeleton, detail: Detail, scene: Any) -> None:
        import pyrender

        self.hash = skeleton.hash
        self.mesh: Mesh = build(skeleton, detail)
        cones = capsules(skeleton)
        keep = chosen(cones)
        self.cones = Capsules(
            cones.joints[keep], cones.starts[keep], cones.ends[keep], cones.radii[keep], cones.colors[keep]
        )
        self.vertices = np.ones((len(self.mesh.positions), 10), dtype=np.float32)
        self.vertices[:, 6:9] = self.mesh.colors
        self.primitive = pyrender.Primitive(
            positions=self.mesh.positions, normals=self.mesh.normals, color_0=self.vertices[:, 6:],
            indices=self.mesh.indices,
            material=pyrender.MetallicRoughnessMaterial(baseColorFactor=[1.0, 1.0, 1.0, 1.0]),
        )  # fmt: skip
        self.node = scene.add(pyrender.Mesh([self.primitive]), name="a figure")

    def place(self, figure: Figure) -> None:
        """Skin the mesh for the next picture."""
        self.mesh.skin(figure.positions_ws, figure.rotations_ws, self.vertices)


class GLEngine:
    """Draws in the current OpenGL context, or in one of its own without a display.

    Args:
        samples: 4 for smooth edges, 0 for speed.
        windowed: draw in the context that is current, a window's; else in one of its own, without a display.
        cells: of the shadow's grid, each way.

    Raises:
        NoOpenGL: there is no context to be had; one line with the remedy.
    """

    name = "gl"

    def __init__(
        self, samples: int = 4, detail: Detail = MEDIUM, look: Look = LOOK, windowed: bool = False, cells: int = 112
    ) -> None:
        if windowed:
            opengl.prepare(window=True)
            self._platform = None
        else:
            self._platform = opengl.headless()
        import pyrender
        from OpenGL import GL

        self._gl = GL
        self._detail, self._look = detail, look
        self._shadow = Shadow(look.key, cells)
        self._scene = pyrender.Scene(bg_color=[*look.background, 0.0])
        self._camera = self._scene.add(pyrender.PerspectiveCamera(yfov=0.5))
        self._bodies: list[Body] = []
        self._texture = pyrender.Texture(
            source=np.zeros((cells, cells, 3), np.uint8), source_channels="RGB",
            sampler=pyrender.Sampler(
                magFilter=GL.GL_LINEAR, minFilter=GL.GL_LINEAR, wrapS=GL.GL_CLAMP_TO_EDGE, wrapT=GL.GL_CLAMP_TO_EDGE
            ),
        )  # fmt: skip
        self._dark = np.zeros((cells, cells, 3), np.uint8)
        corners = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], np.float32) * np.float32(GROUND)
        self._ground = self._scene.add(
            pyrender.Mesh([pyrender.Primitive(
                positions=corners, texcoord_0=np.zeros((4, 2), np.float32), indices=np.array([[0, 1, 2], [0, 2, 3]]),
                material=pyrender.MetallicRoughnessMaterial(baseColorTexture=self._texture, doubleSided=True),
            )]), name="z ground",
        )  # fmt: skip
        limit = int(GL.glGetIntegerv(GL.GL_MAX_SAMPLES))
        renderer = opengl.renderer_class()
        self._plain, self._smooth = renderer(64, 36, 0), renderer(64, 36, min(samples, limit))
        self._matrices = (np.eye(4), np.eye(4))
        self._uniforms: dict[str, Single] = {}

    def draw(self, view: View, width: int, height: int) -> Pixels:
        """See `Engine.draw`."""
        if self._platform is not None:
            self._platform.make_current()
        self._populate(view.figures)
        self._plain._update_context(self._scene, 0)
        self._smooth._meshes, self._smooth._mesh_textures = self._plain._meshes, self._plain._mesh_textures
        for body in self._bodies:
            opengl.update(body.primitive, body.vertices)
        center, span = self._cast(view)
        self._ground.translation = np.array([center[0], 0.0, center[1]])
        camera = view.camera
        flip = np.diag([1.0, -1.0, 1.0, 1.0])  # rows from the top, as pictures are read
        self._matrices = (view_matrix(camera), flip @ projection_matrix(camera))
        eye = np.array(camera.position)
        if camera.ortho_height is not None:  # parallel rays: an eye far behind
            eye = eye + 100.0 * axes(camera)[2]
        self._camera.translation = eye
        self._uniforms = {
            "key": np.array(self._look.key, np.float32),
            "background": np.array(self._look.background, np.float32),
            "window": np.array([*center, 1.0 / span, self._look.shadow], np.float32),
        }
        self._gl.glFrontFace(self._gl.GL_CW)
        try:
            if not self._smooth.samples:
                return self._take(self._plain, "", self._look.background, width, height)
            # only the figures need many samples, and they cover little of the picture: drawn apart
            pixels = self._take(self._plain, "z ground", self._look.background, width, height)
            box = _covered(view, width, height)
            if box is not None:
                figures = self._take(self._smooth, "a figure", (0.0, 0.0, 0.0), width, height, box)
                x, y, w, h = box
                _lay_over(pixels[y : y + h, x : x + w], figures)
            return pixels
        finally:
            self._gl.glFrontFace(self._gl.GL_CCW)

    def _take(
        self, renderer: Any, part: str, back: tuple[float, float, float], width: int, height: int,
        box: tuple[int, int, int, int] | None = None,
    ) -> Pixels:  # fmt: skip
        from pyrender.constants import RenderFlags

        renderer.matrices, renderer.uniforms = self._matrices, self._uniforms
        renderer.viewport_width, renderer.viewport_height = width, height
        renderer.part, renderer.window = part, box
        self._scene.bg_color = [*back, 0.0]
        pixels: Pixels = renderer.render(self._scene, RenderFlags.OFFSCREEN)[0]
        return pixels

    def _populate(self, figures: tuple[Figure, ...]) -> None:
        """A body for each figure, in order; a body whose skeleton changed is built again."""
        for k, figure in enumerate(figures):
            if k < len(self._bodies) and self._bodies[k].hash == figure.skeleton.hash:
                continue
            body = Body(figure.skeleton, self._detail, self._scene)
            if k < len(self._bodies):
                self._scene.remove_node(self._bodies[k].node)
                self._bodies[k] = body
            else:
                self._bodies.append(body)
        while len(self._bodies) > len(figures):
            self._scene.remove_node(self._bodies.pop().node)
        for body, figure in zip(self._bodies, figures, strict=True):
            body.place(figure)

    def _cast(self, view: View) -> tuple[tuple[float, float], float]:
        """Put the figures' shadow into the ground's texture; returns the grid's centre and width."""
        if view.figures:
            x, z, span = self._shadow.window(np.concatenate([figure.positions_ws for figure in view.figures]))
            ends = [
                body.cones.placed(f.positions_ws, f.rotations_ws)
                for body, f in zip(self._bodies, view.figures, strict=True)
            ]
            dark = self._shadow.cast(
                np.concatenate([a for a, _ in ends]), np.concatenate([b for _, b in ends]),
                np.concatenate([body.cones.radii for body in self._bodies]), (x, z), span,
            )  # fmt: skip
            self._dark[...] = (dark * 255.0)[..., None]
        else:
            (x, z), span = view.center, 3.6
            self._dark[...] = 0
        opengl.update_texture(self._texture, self._dark)
        return (x, z), span

    def close(self) -> None:
        """Free the context; nothing can be drawn afterwards."""
        if self._platform is not None:
            self._platform.make_current()
        self._smooth._meshes, self._smooth._mesh_textures = set(), set()
        self._smooth.delete()
        self._plain.delete()
        if self._platform is not None:
            self._platform.delete_context()
            self._platform = None


def _covered(view: View, width: int, height: int) -> tuple[int, int, int, int] | None:
    """Left, top, width and height of the pixels that the figures can cover; None for none."""
    if not view.figures:
        return None
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for figure in view.figures:
        rest = figure.skeleton.rest_positions
        reach = 0.15 * float(np.ptp(rest[:, 1]))  # of hands, head and feet beyond their joints
        depth = -to_camera(view.camera, figure.positions_ws)[:, 2]
        if view.camera.ortho_height is None and depth.min() < reach + LOOK.near:
            return 0, 0, width, height
        at = project(view.camera, figure.positions_ws) * (width, height)
        scale = 0.5 * height * projection_matrix(view.camera)[1, 1]
        pad = reach * scale if view.camera.ortho_height is not None else reach * scale / (depth - reach)
        pad = np.broadcast_to(pad, depth.shape)[:, None] + 2.0
        low, high = np.minimum(low, (at - pad).min(axis=0)), np.maximum(high, (at + pad).max(axis=0))
    x0, y0 = (int(v) for v in np.clip(low, 0, (width, height)))
    x1, y1 = (int(v) for v in np.clip(np.ceil(high), 0, (width, height)))
    return (x0, y0, x1 - x0, y1 - y0) if x1 > x0 and y1 > y0 else None


def _lay_over(ground: Pixels, figures: Pixels) -> None:
    """Lay figures (h, w, 4; colours times their alpha) over the ground, in place."""
    left = 255 - figures[..., 3:].astype(np.uint16)
    ground[...] = figures + ((ground * left + 127) // 255).astype(np.uint8)
    ground[..., 3] = figures[..., 3]
