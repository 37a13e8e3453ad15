import numpy as np
import pytest
from PIL import Image

from bunraku.figure.camera import default_camera, look_at, project
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.quat import from_axis_angle
from bunraku.figure.wire import to_message
from bunraku.msgs import Overlay, Pose, Primitive
from bunraku.nodes.renderer import opengl
from bunraku.nodes.renderer.engine import open_engine
from bunraku.nodes.renderer.node import Renderer, read_size
from bunraku.nodes.renderer.overlay import draw
from bunraku.nodes.renderer.scene import Scene, paint
from bunraku.nodes.renderer.sheet import Sheet, strip
from bunraku.nodes.renderer.view import Figure, Layer, View
from bunraku.runtime.memory import MemoryStage

FIGURE = default_figure()
FRONT = look_at((0.0, 1.0, 5.0), (0.0, 0.9, 0.0), yfov=0.6)
WIDTH, HEIGHT = 480, 270


@pytest.fixture(scope="module")
def gl():
    """One OpenGL engine for this module."""
    try:
        engine = open_engine("gl")
    except opengl.NoOpenGL as error:
        pytest.skip(str(error))
    yield engine
    engine.close()


@pytest.fixture(params=["gl", "pillow"])
def engine(request):
    """Each engine."""
    return request.getfixturevalue("gl") if request.param == "gl" else open_engine("pillow")


def standing(root=(0.0, 0.95, 0.0), figure=FIGURE, **turns):
    """A figure whose joints of some roles are turned by (x, y, z, angle)."""
    _, rotations = figure.rest_pose()
    for role, (x, y, z, angle) in turns.items():
        from_axis_angle(x, y, z, angle, rotations[figure.role(role)])
    return Figure(figure, *fk(figure, np.array(root), rotations))


def picture(engine, *figures, camera=FRONT, layers=()):
    return engine.draw(View(camera, figures, layers), WIDTH, HEIGHT).copy()


def at(camera, point):
    """Column and row of a world point."""
    x, y = project(camera, np.array(point))
    return int(x * WIDTH), int(y * HEIGHT)


def near(pixels, place, size=4):
    column, row = place
    return pixels[row - size : row + size + 1, column - size : column + size + 1, :3].reshape(-1, 3).astype(int)


def test_the_figure_stands_where_the_pose_puts_it(engine):
    pixels = picture(engine, standing())
    cover = pixels[..., 3] > 127
    assert 0.02 < cover.mean() < 0.2
    rows, columns = np.nonzero(cover)
    assert abs(columns.mean() - WIDTH / 2) < 6
    top, bottom = at(FRONT, (0, 1.74, 0))[1], at(FRONT, (0, 0, 0.05))[1]
    assert abs(rows.min() - top) <= 3
    assert abs(rows.max() - bottom) <= 4
    hand = at(FRONT, (0.80, 1.39, 0.0))
    assert cover[hand[1] - 2 : hand[1] + 3, hand[0]].any()


def test_it_moves_with_the_root_and_bends_with_a_joint(engine):
    before = picture(engine, standing())[..., 3] > 127
    moved = picture(engine, standing(root=(0.5, 0.95, 0.0)))[..., 3] > 127
    shift = at(FRONT, (0.5, 1, 0))[0] - at(FRONT, (0, 1, 0))[0]
    assert abs(np.nonzero(moved)[1].mean() - np.nonzero(before)[1].mean() - shift) < 2
    raised = picture(engine, standing(leftUpperArm=(0.0, 0.0, 1.0, np.pi / 2)))[..., 3] > 127
    assert not raised[at(FRONT, (0.8, 1.39, 0))[::-1]]
    column, row = at(FRONT, (0.18, 1.39 + 0.28 + 0.2, 0.0))
    assert raised[row, column - 3 : column + 4].any()


def test_left_is_teal_and_right_is_coral(engine):
    pixels = picture(engine, standing())
    left, right = (near(pixels, at(FRONT, (sign * 0.18, 1.40, 0.05)), 2).mean(axis=0) for sign in (1, -1))
    assert left[1] > left[0] + 40
    assert left[2] > left[0] + 40
    assert right[0] > right[1] + 40
    assert right[0] > right[2] + 40


def test_the_body_is_cream_and_neither_white_nor_black(engine):
    pixels = picture(engine, standing())
    chest = near(pixels, at(FRONT, (0.0, 1.32, 0.1)))
    assert (chest.max(axis=1) < 252).all()
    assert (chest.min(axis=1) > 90).all()
    assert chest[:, 0].mean() > chest[:, 2].mean() + 15


def test_the_visor_is_dark_in_front_and_not_behind(engine):
    face = at(FRONT, (0.0, 1.625, 0.1))
    assert near(picture(engine, standing()), face, 1).mean() < 90
    turned = picture(engine, standing(hips=(0.0, 1.0, 0.0, np.pi)))
    assert near(turned, face, 1).mean() > 120


def test_the_shadow_lies_away_from_the_light_and_follows(engine):
    above = look_at((0.0, 6.0, 0.01), (0.0, 0.0, 0.0), yfov=0.8)
    empty = picture(engine, camera=above)[..., :3].astype(int).sum(axis=2)
    for x in (0.0, 1.0):
        pixels = picture(engine, standing(root=(x, 0.95, 0.0)), camera=above)
        darker = (empty - pixels[..., :3].astype(int).sum(axis=2) > 40) & (pixels[..., 3] == 0)
        rows, columns = np.nonzero(darker)
        assert len(rows) > 300
        # the key light stands at -X +Z: the shadow falls to +X (right) and -Z (up)
        assert columns.mean() > at(above, (x, 0, 0))[0] + 5
        assert rows.mean() < at(above, (0, 0, 0))[1] - 5


def test_ground_lines_run_where_the_world_has_them(engine):
    above = look_at((0.5, 4.0, 0.51), (0.5, 0.0, 0.5), yfov=0.8)
    pixels = picture(engine, camera=above)[..., :3].astype(int).sum(axis=2)
    column, row = at(above, (0.0, 0.0, 0.6))
    line = pixels[row, column - 8 : column + 9]
    assert abs(int(line.argmin()) - 8) <= 1
    assert line.max() - line.min() > 40


def test_an_orthographic_camera_keeps_sizes(engine):
    camera = look_at((0.0, 1.0, 5.0), (0.0, 1.0, 0.0), ortho_height=2.4)
    for depth in (0.0, -3.0):
        rows = np.nonzero(
            (picture(engine, standing(root=(0.0, 0.95, depth)), camera=camera)[..., 3] > 127).any(axis=1)
        )[0]
        assert abs(len(rows) - 1.74 / 2.4 * HEIGHT) < 5


def test_several_figures_and_one_that_leaves(engine):
    two = picture(engine, standing(root=(-0.9, 0.95, 0.0)), standing(root=(0.9, 0.95, 0.0)))[..., 3] > 127
    half = WIDTH // 2
    assert abs(int(two[:, :half].sum()) - int(two[:, half:].sum())) < 0.05 * two.sum()
    one = picture(engine, standing(root=(-0.9, 0.95, 0.0)))[..., 3] > 127
    assert one[:, :half].sum() > 3 * one[:, half:].sum()


def test_both_engines_agree(gl):
    camera = look_at((2.4, 1.45, 3.9), (0, 0.9, 0), yfov=0.55)
    one = picture(gl, standing(), camera=camera)
    other = picture(open_engine("pillow"), standing(), camera=camera)
    a, b = one[..., 3] > 127, other[..., 3] > 127
    assert (a & b).sum() / (a | b).sum() > 0.85
    ground = ~(a | b)
    gap = np.abs(one[..., :3].astype(int) - other[..., :3].astype(int))[ground]
    assert np.percentile(gap, 99) < 12


def test_figures_behind_the_camera_or_around_it_do_no_harm(engine):
    for place in ((0.0, 1.4, 0.0), (0.05, 0.9, 0.1), (0.0, -1.0, 3.0)):
        camera = look_at(place, (0.0, 0.9, -3.0), yfov=0.6)
        pixels = picture(engine, standing(), camera=camera)
        assert pixels.shape == (HEIGHT, WIDTH, 4)
    assert not picture(engine, standing(root=(0, 0.95, 30.0)))[..., 3].any()


def overlaid(engine, *primitives, parents=(), camera=FRONT, figures=None):
    """The picture with and without an overlay."""
    figures = (standing(),) if figures is None else figures
    bare = picture(engine, *figures, camera=camera)
    drawn = bare.copy()
    draw(drawn, camera, [Layer(primitives, parents)])
    return bare[..., :3].astype(int), drawn[..., :3].astype(int)


RED = (1.0, 0.0, 0.0, 1.0)


def changed(bare, drawn):
    return np.abs(bare - drawn).max(axis=2) > 8


def test_a_touch_circle_lies_at_its_place_and_is_round(gl):
    one = Primitive(kind="circle", space="screen", points=[(0.25, 0.5)], size=0.05, color=RED)
    mask = changed(*overlaid(gl, one))
    rows, columns = np.nonzero(mask)
    assert abs(rows.mean() - 0.5 * HEIGHT) < 1.0
    assert abs(columns.mean() - 0.25 * WIDTH) < 1.0
    assert abs(np.ptp(rows) - np.ptp(columns)) <= 1


def test_a_world_line_goes_through_its_projected_points(gl):
    a, b = (-1.2, 0.4, 0.3), (-0.6, 1.6, 0.3)
    bare, drawn = overlaid(gl, Primitive(kind="line", points=[a, b], size=0.03, color=RED))
    mask = changed(bare, drawn)
    for point in (a, b, tuple((p + q) / 2 for p, q in zip(a, b, strict=True))):
        column, row = at(FRONT, point)
        assert mask[row, column]
        assert drawn[row, column, 0] > drawn[row, column, 1] + 100
    assert mask.mean() < 0.05


def test_what_lies_on_the_ground_goes_under_the_feet(engine):
    square = [(-1.0, 0.004, -1.0), (1.0, 0.004, -1.0), (1.0, 0.004, 1.0), (-1.0, 0.004, 1.0)]
    camera = look_at((0.0, 3.0, 3.0), (0.0, 0.5, 0.0), yfov=0.7)
    bare = picture(engine, standing(), camera=camera)
    drawn = bare.copy()
    draw(drawn, camera, [Layer((Primitive(kind="polygon", points=square, color=RED, size=0.004),))])
    body = bare[..., 3] == 255
    np.testing.assert_array_equal(drawn[body], bare[body])
    assert changed(bare.astype(int)[..., :3], drawn.astype(int)[..., :3]).mean() > 0.1


def test_an_overlay_in_the_air_goes_over_the_figure(gl):
    _, drawn = overlaid(gl, Primitive(kind="points", points=[(0.0, 1.3, 0.0)], size=0.2, color=RED))
    column, row = at(FRONT, (0.0, 1.3, 0.0))
    assert drawn[row, column, 0] > 240
    assert drawn[row, column, 1] < 20


def test_a_stick_figure_has_its_joints_where_they_are(gl):
    spots = standing(root=(-1.1, 0.95, 0.0)).positions_ws
    points = [tuple(float(x) for x in spot) for spot in spots]
    one = Primitive(kind="figure", points=points, size=0.03, color=RED)
    bare, drawn = overlaid(gl, one, parents=tuple(int(p) for p in FIGURE.parents), figures=())
    mask = changed(bare, drawn)
    seen = [(c, r) for c, r in (at(FRONT, spot) for spot in spots) if 0 <= c < WIDTH]
    assert len(seen) > 12
    assert all(mask[r, c] for c, r in seen)


def test_text_and_bars_and_panels_are_drawn_where_they_belong(gl):
    label = Primitive(kind="text", space="screen", points=[(0.05, 0.10)], size=0.06, label="hello", color=RED)
    rows, columns = np.nonzero(changed(*overlaid(gl, label)))
    assert len(rows) > 60
    assert rows.max() < 0.13 * HEIGHT
    assert columns.min() > 0.03 * WIDTH
    bars = [
        Primitive(kind="bar", space="panel", points=[(0.1, 0.5), (0.9, 0.5)], size=v, color=RED) for v in (0.2, 0.9)
    ]
    few, many = (
        ((drawn[..., 0] - drawn[..., 1]) > 150).sum() for drawn in (overlaid(gl, bar, figures=())[1] for bar in bars)
    )
    assert many > 3 * few > 0
    mask = changed(*overlaid(gl, bars[0]))
    assert not mask[: int(0.6 * HEIGHT)].any()
    assert not mask[:, int(0.5 * WIDTH) :].any()


def test_overlays_that_pass_behind_the_camera_or_far_outside_do_no_harm(gl):
    far = [(-1e6, 0.0, 1e6), (1e6, 0.0, 1e6), (1e6, 0.0, -1e6), (-1e6, 0.0, -1e6)]
    behind = [(0.0, 1.0, 20.0), (1.0, 1.0, 30.0)]
    places = (
        ("world", far), ("world", behind), ("world", []),
        ("screen", [(9e8, -9e8), (0.5, 0.5)]), ("screen", [(0.1, 0.2, 0.3)]), ("panel", [(1.0, 2.0)]),
    )  # fmt: skip
    ones = [
        Primitive(kind=kind, space=space, points=points, size=size, label="label")
        for kind in ("circle", "line", "polygon", "points", "figure", "bar", "text")
        for space, points in places
        for size in (0.0, 0.02, 900.0)
    ]  # fmt: skip
    for one in ones:
        overlaid(gl, one, figures=())


# The scene


def pose_message(figure=FIGURE, root=(0.0, 0.95, 0.0)):
    return Pose(skeleton=figure.hash, root=np.array(root), rotations=figure.rest_pose()[1])


def heard(*figures):
    scene = Scene(figures or ("",))
    for name in scene.figures:
        prefix = f"{name}/" if name else ""
        scene.hear(f"{prefix}skeleton", to_message(FIGURE))
        scene.hear(f"{prefix}pose", pose_message())
    return scene


def test_a_scene_is_ready_with_a_skeleton_and_its_pose_in_any_order():
    scene = Scene()
    assert not scene.ready
    scene.hear("pose", pose_message())
    assert not scene.ready
    scene.hear("skeleton", to_message(FIGURE))
    assert scene.ready
    np.testing.assert_allclose(scene.view(0).figures[0].positions_ws[0], (0.0, 0.95, 0.0), atol=1e-6)


def test_a_pose_of_another_skeleton_keeps_the_last_one():
    scene = heard()
    other = pose_message(root=(5.0, 1.0, 0.0))
    other.skeleton = "0123456789abcdef"
    scene.hear("pose", other)
    assert scene.view(0).figures[0].positions_ws[0][0] == pytest.approx(0.0)


def test_namespaces_choose_the_figures_and_one_camera_serves_all():
    scene = heard("alice", "bob")
    assert not scene.hear("carol/pose", pose_message())
    assert len(scene.view(0).figures) == 2
    assert scene.hear("camera", FRONT)
    assert scene.view(0).camera is FRONT
    assert scene.hear("alice/overlay/interpreter", Overlay(primitives=[Primitive(kind="points")]))
    assert not scene.hear("carol/overlay/interpreter", Overlay())
    (layer,) = scene.view(0).layers
    assert layer.parents == tuple(FIGURE.parents)


def test_a_skeleton_that_is_no_humanoid_is_refused_and_said():
    scene = Scene()
    message = to_message(FIGURE)
    del message.roles["head"]
    assert not scene.hear("skeleton", message)
    assert "head" in scene.refused[""]


def test_without_a_camera_an_own_one_follows():
    scene = heard()
    first = scene.view(0).camera
    assert first.position == pytest.approx(default_camera().position, abs=1e-4)
    scene.hear("pose", pose_message(root=(3.0, 0.95, 0.0)))
    for k in range(1, 400):
        camera = scene.view(k * 16_666_667).camera
    assert camera.position[0] - first.position[0] == pytest.approx(3.0, abs=0.05)
    assert camera.rotation == pytest.approx(first.rotation, abs=1e-6)


def test_a_camera_of_another_shape_is_letterboxed(gl):
    scene = heard()
    scene.hear("camera", look_at((0.0, 1.0, 5.0), (0.0, 0.9, 0.0), yfov=0.6, aspect=1.0))
    pixels = paint(gl, scene.view(0), WIDTH, HEIGHT)
    assert (pixels[:, :80, :3] < 60).all()
    assert (pixels[:, -80:, :3] < 60).all()
    assert (pixels[5, WIDTH // 2, :3] > 180).all()


# Sheets and strips


def test_a_sheet_keeps_evenly_spread_frames_in_bounded_memory():
    sheet = Sheet(count=6, columns=3, width=32)
    frame = np.zeros((18, 32, 4), np.uint8)
    for k in range(1000):
        if sheet.wants:
            frame[:] = k % 256
            sheet.add(k / 60, frame)
        else:
            sheet.skip()
    assert len(sheet.kept) < 24
    times = np.array([t for t, _ in sheet.kept])
    assert np.ptp(np.diff(times)) < 1e-9
    assert times[-1] > 0.9 * 999 / 60
    assert sheet.picture().size == (3 * 38 + 6, 2 * 24 + 6)


def test_an_empty_sheet_writes_nothing(tmp_path):
    assert not Sheet().save(tmp_path / "sheet.png")
    assert not list(tmp_path.iterdir())


def test_a_strip_shows_every_moment_side_by_side(gl):
    roots = np.tile([0.0, 0.95, 0.0], (4, 1))
    rotations = np.tile(FIGURE.rest_pose()[1], (4, 1, 1))
    for k in range(4):
        from_axis_angle(0.0, 1.0, 0.0, np.pi / 2, rotations[k, 0])
    pixels = strip(gl, FIGURE, roots, rotations, width=800, height=300, spacing=0.9)
    columns = (pixels[..., 3] > 127).any(axis=0).astype(int)
    assert (np.diff(columns) == 1).sum() == 4
    with pytest.raises(ValueError, match="needs a pose"):
        strip(gl, FIGURE, np.zeros((0, 3)), np.zeros((0, 21, 4)))


# Engines


def test_without_opengl_the_plain_engine_is_taken_and_said(monkeypatch):
    def refuse(window):
        raise opengl.NoOpenGL("libEGL.so.1 is missing; install it with: apt-get install libegl1 libgl1 libxrender1")

    monkeypatch.setattr(opengl, "prepare", refuse)
    said = []
    engine = open_engine("auto", say=said.append)
    assert engine.name == "pillow"
    assert len(said) == 1
    assert "apt-get install libegl1 libgl1 libxrender1" in said[0]
    with pytest.raises(opengl.NoOpenGL, match="libEGL"):
        open_engine("gl")


def test_what_a_node_drew_goes_with_the_node(monkeypatch):
    stage, heard = MemoryStage(), []
    node = stage.add(Renderer, window="off")
    monkeypatch.setattr(node, "_hear", lambda topic, message: heard.append((topic, len(message.primitives))))
    stage.publish("overlay/interpreter", Overlay(primitives=[Primitive(kind="circle", points=[(0, 0, 0)])]))
    stage.advance(2.0)
    monkeypatch.setattr(node.presence, "gone", lambda: ["overlay/interpreter"])
    stage.advance(0.6)
    stage.remove(node)
    assert heard[0] == ("overlay/interpreter", 1)
    assert set(heard[1:]) == {("overlay/interpreter", 0)}


def test_an_unknown_engine_is_refused():
    with pytest.raises(ValueError, match="engine"):
        open_engine("vulkan")


@pytest.mark.parametrize("text", ["", "1280", "1280x", "1281x720", "0x0", "axb", "1280x720x3", "99999x2"])
def test_sizes_that_cannot_be_are_refused(text):
    with pytest.raises(ValueError, match="size"):
        read_size(text)


# The node


def stage_with(tmp_path, **params):
    stage = MemoryStage()
    node = stage.add(Renderer, engine="pillow", window="off", size="160x90", fps=30, **params)
    return stage, node


def perform(stage, seconds=1.0, prefix="", rate=60):
    stage.publish(f"{prefix}skeleton", to_message(FIGURE))
    for k in range(round(seconds * rate)):
        stage.publish(f"{prefix}pose", pose_message(root=(0.3 * k / rate, 0.95, 0.0)))
        stage.advance(1.0 / rate)


def test_the_node_films_what_it_hears(tmp_path):
    import av

    film, sheet, last = tmp_path / "film.mp4", tmp_path / "sheet.png", tmp_path / "last.png"
    stage, node = stage_with(tmp_path, output=str(film), sheet=str(sheet), picture=str(last))
    perform(stage, 1.0)
    stage.remove(node)
    with av.open(str(film)) as file:
        count = sum(1 for _ in file.decode(video=0))
    assert 28 <= count <= 31
    assert Image.open(last).size == (160, 90)
    assert Image.open(sheet).width > 160


def test_the_node_takes_a_picture_on_request(tmp_path):
    stage, node = stage_with(tmp_path)
    perform(stage, 0.2)
    path = tmp_path / "deep" / "now.png"
    assert stage.ask(node, "picture", path=str(path))["ok"]
    assert np.asarray(Image.open(path)).std() > 5
    assert not stage.ask(node, "picture")["ok"]
    assert "error" in stage.ask(node, "picture", path="/proc/nowhere/x.png")
    stage.remove(node)
    assert stage.status is None


def test_the_node_films_figures_of_namespaces(tmp_path):
    last = tmp_path / "last.png"
    stage, node = stage_with(tmp_path, picture=str(last), figures=["alice", "bob"])
    stage.publish("camera", FRONT)
    for name, x in (("alice", -0.9), ("bob", 0.9)):
        stage.publish(f"{name}/skeleton", to_message(FIGURE))
        stage.publish(f"{name}/pose", pose_message(root=(x, 0.95, 0.0)))
    stage.advance(0.2)
    stage.remove(node)
    two = np.asarray(Image.open(last)).astype(int)
    body = (two[..., 0] - two[..., 2]) > 15
    assert body[:, :80].sum() > 50
    assert body[:, 80:].sum() > 50


def test_a_new_output_ends_one_film_and_begins_another(tmp_path):
    import av

    stage, node = stage_with(tmp_path, output=str(tmp_path / "one.mp4"))
    perform(stage, 0.5)
    node.set_param("output", str(tmp_path / "two.mp4"))
    perform(stage, 1.0)
    stage.remove(node)
    for name, least, most in (("one", 13, 17), ("two", 28, 32)):
        with av.open(str(tmp_path / f"{name}.mp4")) as file:
            assert least <= sum(1 for _ in file.decode(video=0)) <= most


def test_an_output_that_cannot_be_written_ends_the_node_with_one_line(tmp_path):
    stage, node = stage_with(tmp_path, output="/proc/nowhere/film.mp4")
    perform(stage, 0.2)
    node.worker.close()
    stage.poll()
    assert stage.status == 1
    lines = [log.text for log in stage.received("log/renderer") if log.level == "error"]
    assert len(lines) == 1
    assert "/proc/nowhere/film.mp4" in lines[0]


def test_a_size_that_cannot_be_is_refused_and_the_node_still_ends(tmp_path):
    stage = MemoryStage()
    node = Renderer(stage, params={"size": "12", "window": "off"})
    with pytest.raises(ValueError, match="1280x720"):
        node.start()
    node.finish()


def test_a_window_that_must_be_and_cannot_ends_the_node(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    stage = MemoryStage()
    node = Renderer(stage, params={"window": "on"})
    with pytest.raises(ValueError, match="display"):
        node.start()
    node.finish()
