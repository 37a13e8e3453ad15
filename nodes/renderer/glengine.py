"""Pictures by OpenGL: pyrender's scene with one primitive a figure, skinned on the CPU and updated in place."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.camera import axes
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
        platform: the context to draw in; None makes one. Raises `NoOpenGL` where there is none.
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
        self._renderer = opengl.renderer_class()(64, 36, min(samples, limit))

    def draw(self, view: View, width: int, height: int) -> Pixels:
        """See `Engine.draw`."""
        if self._platform is not None:
            self._platform.make_current()
        self._populate(view.figures)
        self._renderer._update_context(self._scene, 0)
        for body in self._bodies:
            opengl.update(body.primitive, body.vertices)
        center, span = self._cast(view)
        self._ground.translation = np.array([center[0], 0.0, center[1]])
        camera = view.camera
        flip = np.diag([1.0, -1.0, 1.0, 1.0])  # rows from the top, as pictures are read
        self._renderer.matrices = (view_matrix(camera), flip @ projection_matrix(camera))
        pose = np.eye(4)
        pose[:3, 3] = camera.position
        if camera.ortho_height is not None:  # parallel rays: an eye far behind
            pose[:3, 3] += 100.0 * axes(camera)[2]
        self._camera.matrix = pose
        self._renderer.uniforms = {
            "key": np.array(self._look.key, np.float32),
            "background": np.array(self._look.background, np.float32),
            "window": np.array([*center, 1.0 / span, self._look.shadow], np.float32),
        }
        self._renderer.viewport_width, self._renderer.viewport_height = width, height
        self._gl.glFrontFace(self._gl.GL_CW)
        from pyrender.constants import RenderFlags

        pixels: Pixels = self._renderer.render(self._scene, RenderFlags.OFFSCREEN)[0]
        self._gl.glFrontFace(self._gl.GL_CCW)
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
        self._renderer.delete()
        if self._platform is not None:
            self._platform.delete_context()
            self._platform = None
