"""BVH: what is written is read back; every dialect and defect that files are met with."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bunraku.figure.default import default_figure
from bunraku.motion import rotation as rot
from bunraku.motion.bvh import bvh_text, frame_rate, load_bvh, parse_bvh, read_bvh, write_bvh
from bunraku.motion.capture import CaptureError, interpret
from bunraku.motion.clip import Clip

MOCAP = Path(os.environ.get("BUNRAKU_MOCAP", Path(__file__).parents[2].parent / "shared" / "mocap"))
needs_mocap = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no motion capture at {MOCAP} (set BUNRAKU_MOCAP)")


def a_clip(frames: int = 20, fps: float = 60.0, skeleton=None) -> Clip:
    skeleton = skeleton or default_figure()
    rng = np.random.default_rng(4)
    phase = np.linspace(0.0, 2.0, frames)[:, None, None]
    vectors = np.sin(phase + rng.normal(size=(1, len(skeleton), 3)) * 3.0) * 0.5
    turns = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_quat().reshape(frames, len(skeleton), 4)
    roots = np.stack([0.3 * np.sin(phase[:, 0, 0]), 0.95 + 0 * phase[:, 0, 0], phase[:, 0, 0]], 1)
    return Clip("walk", skeleton, fps, roots, turns)


def same_places(a: Clip, b: Clip, tolerance: float = 1e-6) -> bool:
    """Joint by joint of the first clip, found by name in the second."""
    index = [b.skeleton.names.index(name) for name in a.skeleton.names]
    return bool(np.abs(a.world[0] - b.world[0][:, index]).max() < tolerance)


def test_what_is_written_is_read_back(tmp_path):
    clip = a_clip()
    write_bvh(clip, tmp_path / "walk.bvh")
    capture = load_bvh(tmp_path / "walk.bvh")
    back = capture.clip
    assert (capture.unit, capture.up, capture.rest, capture.findings) == (0.01, "y", "rest pose", ())
    assert sorted(back.skeleton.names) == sorted(clip.skeleton.names)
    assert back.fps == 60.0
    assert same_places(clip, back, 1e-7)
    assert {role: back.skeleton.names[j] for role, j in back.skeleton.roles.items()} == {
        role: clip.skeleton.names[j] for role, j in clip.skeleton.roles.items()
    }
    assert back.skeleton.offsets[0] == pytest.approx([0.0, 0.95, 0.0], abs=1e-6)
    assert back.skeleton.masses.sum() == pytest.approx(70.0, rel=0.02)


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.001, 0.0254])
def test_the_unit_is_told_from_the_legs(tmp_path, unit):
    write_bvh(a_clip(), tmp_path / "walk.bvh", unit=unit)
    capture = load_bvh(tmp_path / "walk.bvh")
    assert capture.unit == unit
    assert same_places(a_clip(), capture.clip, 1e-5)


def test_an_unknown_unit_is_scaled_and_said_and_can_be_given(tmp_path):
    write_bvh(a_clip(), tmp_path / "giant.bvh", unit=0.2)
    capture = load_bvh(tmp_path / "giant.bvh")
    assert any("fit no known unit" in line for line in capture.findings)
    assert load_bvh(tmp_path / "giant.bvh", unit=0.5).unit == 0.5
    with pytest.raises(CaptureError, match="unit"):
        read_bvh(tmp_path / "giant.bvh", unit=-1.0)


def test_a_file_with_z_up_is_turned(tmp_path):
    clip = a_clip()
    text = bvh_text(clip, unit=0.1)
    lines = []
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["OFFSET"]:
            x, y, z = map(float, words[1:])
            line = f"OFFSET {x} {-z} {y}"
        elif words[:1] == ["CHANNELS"]:
            line = line.replace("Zrotation Xrotation Yrotation", "Yrotation Xrotation Zrotation")
        lines.append(line)
    at = lines.index(next(line for line in lines if line.startswith("Frame Time"))) + 1
    for k in range(at, len(lines)):
        row = np.array(lines[k].split(), dtype=float)
        row[:3] = [row[0], -row[2], row[1]]
        row[3::3] *= -1.0  # about z it was, about -y it is
        lines[k] = " ".join(map(repr, row.tolist()))
    (tmp_path / "z.bvh").write_text("\n".join(lines))
    capture = load_bvh(tmp_path / "z.bvh")
    assert (capture.up, capture.unit) == ("z", 0.1)
    assert same_places(clip, capture.clip, 1e-5)


HEADER = """HIERARCHY
ROOT Hips
{
  OFFSET {root}
  CHANNELS 6 {channels}
  JOINT Chest
  {
    OFFSET 0 20 0
    CHANNELS 3 Xrotation Zrotation Yrotation
    JOINT Neck
    {
      OFFSET 0 30 0
      CHANNELS 3 Yrotation Zrotation Xrotation
      JOINT Head
      {
        OFFSET 0 10 0
        CHANNELS 3 Zrotation Yrotation Xrotation
        End Site
        {
          OFFSET 0 15 0
        }
      }
    }
"""


def person(root: str = "0 0 0", channels: str = "Xposition Yposition Zposition Zrotation Xrotation Yrotation",
           arm: tuple[float, float, float] = (1.0, 0.0, 0.0), leg_end: bool = True) -> str:  # fmt: skip
    """A hand-written hierarchy; arms along ``arm`` (left side)."""
    text = HEADER.replace("{root}", root).replace("{channels}", channels)
    plain = "CHANNELS 3 Zrotation Xrotation Yrotation"

    def chain(names, offsets, end, depth):
        out = []
        for k, (name, offset) in enumerate(zip(names, offsets, strict=True)):
            tab = "  " * (depth + k)
            out += [
                f"{tab}JOINT {name}",
                f"{tab}{{",
                f"{tab}  OFFSET {offset[0]} {offset[1]} {offset[2]}",
                f"{tab}  {plain}",
            ]
        tab = "  " * (depth + len(names))
        if end is not None:
            out += [f"{tab}End Site", f"{tab}{{", f"{tab}  OFFSET {end[0]} {end[1]} {end[2]}", f"{tab}}}"]
        out += ["  " * (depth + k) + "}" for k in reversed(range(len(names)))]
        return "\n".join(out) + "\n"

    for side, sign in (("Left", 1), ("Right", -1)):
        bone = [np.array([sign * arm[0], arm[1], arm[2]]) * length for length in (28, 25)]
        text += chain([f"{side}Collar", f"{side}Shoulder", f"{side}Elbow", f"{side}Wrist"],
                      [(sign * 3, 22, 0), (sign * 14, 0, 0), *bone], bone[1] * 0.5, 2)  # fmt: skip
    text += "  }\n"
    for side, sign in (("Left", 1), ("Right", -1)):
        text += chain([f"{side}Hip", f"{side}Knee", f"{side}Ankle"],
                      [(sign * 9, -4, 0), (0, -42, 0), (0, -41, 0)], (0, -6, 12) if leg_end else None, 1)  # fmt: skip
    return text + "}\n"


JOINTS = 18


def motion(rows: list[list[float]] | None = None, frames: int | None = None, time: str = "0.0166667") -> str:
    table = rows if rows is not None else [[0, 92, 0] + [0] * 3 * JOINTS]
    body = "\n".join(" ".join(map(str, row)) for row in table)
    return f"MOTION\nFrames: {len(table) if frames is None else frames}\nFrame Time: {time}\n{body}"


def read_text(text: str, **options):
    return interpret(parse_bvh(text, "t.bvh"), **options)


def test_names_by_the_place_of_the_joint_give_the_roles():
    skeleton = read_text(person() + motion()).clip.skeleton
    named = {role: skeleton.names[j] for role, j in skeleton.roles.items()}
    assert named["leftUpperArm"] == "LeftShoulder"
    assert named["leftShoulder"] == "LeftCollar"
    assert named["rightUpperLeg"] == "RightHip"
    assert named["hips"] == "Hips"
    assert named["spine"] == "Chest"


def test_channel_orders_differ_per_joint_and_are_kept():
    text = person(channels="Yrotation Zrotation Xrotation Zposition Xposition Yposition")
    row = [10, 20, 30, 3, 1, 92, 40, -20, 15] + [0] * 3 * (JOINTS - 2)
    clip = read_text(text + motion([row])).clip
    assert np.allclose(clip.roots[0], [0.01, 0.92, 0.03])
    root = Rotation.from_euler("YZX", [10, 20, 30], degrees=True)
    chest = root * Rotation.from_euler("XZY", [40, -20, 15], degrees=True)
    neck = clip.roots[0] + root.apply([0, 0.2, 0]) + chest.apply([0, 0.3, 0])
    assert np.allclose(clip.world[0][0, clip.skeleton.names.index("Neck")], neck)


@pytest.mark.parametrize(("root", "position", "kind"), [
    ("0 92 0", [0, 0, 0], "added"), ("0 92 0", [5, 91, 3], "absolute"), ("0 0 0", [0, 92, 0], "absolute"),
])  # fmt: skip
def test_the_root_is_where_the_feet_are_on_the_floor(root, position, kind):
    capture = read_text(person(root=root) + motion([[*position, *[0] * 3 * JOINTS]]))
    assert capture.root == kind
    assert 0.85 < capture.clip.roots[0, 1] < 0.95
    forced = read_text(person(root=root) + motion([[*position, *[0] * 3 * JOINTS]]), root="added")
    offset = float(root.split()[1])
    assert forced.clip.roots[0, 1] == pytest.approx((position[1] + offset) / 100)


def test_an_a_pose_becomes_a_t_pose_with_every_joint_where_it_was():
    slanted = (np.cos(0.8), -np.sin(0.8), 0.0)
    row = [0, 92, 0, 5, 6, 7, *np.random.default_rng(1).uniform(-40, 40, 3 * (JOINTS - 1))]
    flat, hanging = read_text(person() + motion([row])), read_text(person(arm=slanted) + motion([row]))
    skeleton = hanging.clip.skeleton
    hand = skeleton.rest_positions[skeleton.role("leftHand")] - skeleton.rest_positions[skeleton.role("leftUpperArm")]
    assert np.allclose(hand / np.linalg.norm(hand), [1, 0, 0], atol=1e-9)
    elbow, wrist = skeleton.names.index("LeftElbow"), skeleton.names.index("LeftWrist")
    raw = parse_bvh(person(arm=slanted) + motion([row]), "t.bvh")
    turns = raw.rotations[0]
    world = [turns[0]]
    places = [np.array([0, 92.0, 0])]
    for joint in range(1, len(raw.names)):
        parent = raw.parents[joint]
        places.append(places[parent] + rot.rotate(world[parent], raw.offsets[joint]))
        world.append(rot.mul(world[parent], turns[joint]))
    for joint in (elbow, wrist):
        assert np.allclose(hanging.clip.world[0][0, joint], places[joint] / 100, atol=1e-9)
    assert flat.clip.skeleton.hash != ""


KEPT = ("Hips", *(side + name for side in ("Left", "Right") for name in ("Hip", "Collar", "Shoulder")))


def along_one_axis(text: str) -> str:
    """The same hierarchy with every bone along +Y, as some exporters write it, hips apart."""
    lines = []
    last = ""
    for line in text.splitlines():
        words = line.split()
        if words[:1] in (["JOINT"], ["ROOT"]):
            last = words[1]
        if words[:1] == ["OFFSET"] and last not in KEPT:
            line = f"OFFSET 0 {np.linalg.norm(np.array(words[1:], dtype=float))} 0"
        lines.append(line)
    return "\n".join(lines) + "\n"


def test_a_meaningless_rest_pose_is_replaced_by_the_t_pose_in_the_first_frame():
    hierarchy = along_one_axis(person())
    parsed = parse_bvh(hierarchy + motion(), "t.bvh")
    want = {"LeftHip": (0, -1, 0), "RightHip": (0, -1, 0), "LeftShoulder": (1, 0, 0), "RightShoulder": (-1, 0, 0)}
    yaw = 40.0
    turns = {}
    for name, direction in want.items():
        turn = Rotation.align_vectors([direction], [[0, 1, 0]])[0]
        turns[name] = turn.as_euler("ZXY", degrees=True)
    row = [0, 92, 0, 0, 0, yaw]
    for name in parsed.names[1:]:
        angles = turns.get(name, (0, 0, 0))
        row += list(angles)
    bent = list(row)
    for k, name in enumerate(parsed.names):
        if name in ("LeftShoulder", "RightShoulder"):
            bent[3 + 3 * k : 6 + 3 * k] = [170, 10, 5]
    still = [v + 0.1 for v in bent]
    capture = read_text(hierarchy + motion([row, bent, still, bent]))
    assert capture.rest == "first frame"
    assert any("left out" in line for line in capture.findings)
    assert len(capture.clip) == 3
    skeleton = capture.clip.skeleton
    rest = skeleton.rest_positions
    assert np.allclose((rest[skeleton.role("leftHand")] - rest[skeleton.role("leftUpperArm")])[1:], 0.0, atol=1e-6)
    assert rest[skeleton.role("leftUpperArm"), 0] > 0.1
    assert rest[skeleton.role("leftFoot"), 1] == pytest.approx(rest[skeleton.role("leftUpperLeg"), 1] - 0.83, abs=1e-3)
    assert capture.clip.headings[0] == pytest.approx(np.radians(yaw), abs=0.01)


def test_six_channels_on_every_joint_replace_the_offset():
    text = person().replace(
        "OFFSET 0 -42 0\n      CHANNELS 3 Zrotation",
        "OFFSET 0 -1 0\n      CHANNELS 6 Xposition Yposition Zposition Zrotation",
    )
    parsed = parse_bvh(person() + motion(), "t.bvh")
    row = [0, 92, 0]
    for name in parsed.names:
        row += ([0, -42, 0] if name in ("LeftKnee", "RightKnee") else []) + [0, 0, 0]
    capture = read_text(text + motion([row]))
    foot = capture.clip.skeleton.role("leftFoot")
    assert capture.clip.world[0][0, foot, 1] == pytest.approx(0.92 - 0.04 - 0.83)


def test_a_root_above_the_hips_gives_way_to_the_hips():
    inner = person().split("\n", 1)[1].replace("ROOT Hips", "JOINT Hips")
    text = "HIERARCHY\nROOT joint_Root\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n" + inner + "}\n"
    capture = read_text(text + motion([[0, 0, 90, 1, 92, 2] + [0] * 3 * JOINTS]))
    assert capture.clip.skeleton.names[0] == "Hips"
    assert np.allclose(capture.clip.roots[0], [0.02, 0.92, -0.01])
    assert capture.clip.headings[0] == pytest.approx(np.pi / 2)
    assert any("is the root" in line for line in capture.findings)


def test_texts_as_they_come():
    plain = read_text(person() + motion())
    for text in (
        (person() + motion()).replace("\n", "\r\n"),
        (person() + motion()).replace("Frames:", "Frames:\t").replace("  ", "\t"),
        (person() + motion()).replace(" 92 ", " 9.2e+01 "),
        (person() + motion()).replace("End Site", "End Site nub"),
        (person() + motion()).replace("End Site", "end site"),
        (person() + motion()).replace("{\n", "{ \n").replace("JOINT Chest\n  {", "JOINT Chest {") + "  \n\n",
        "\ufeff" * 0 + person(leg_end=False) + motion(),
    ):
        assert same_places(plain.clip, read_text(text).clip, 1e-9)


def test_rows_count_more_than_the_declared_frames_and_a_cut_last_row_is_left_out():
    row = [0, 92, 0] + [0] * 3 * JOINTS
    many = read_text(person() + motion([row] * 4, frames=3))
    assert len(many.clip) == 4
    assert "3 frames declared, 4 there" in many.findings[0]
    cut = read_text(person() + motion([row] * 3 + [row[:5]]))
    assert len(cut.clip) == 3
    assert any("cut short" in line for line in cut.findings)
    words = motion([row] * 2).split("\n")
    wrapped = (
        "\n".join(words[:3])
        + "\n"
        + "\n".join(" ".join(w.split()[:30]) + "\n" + " ".join(w.split()[30:]) for w in words[3:])
    )
    assert len(read_text(person() + wrapped).clip) == 2


@pytest.mark.parametrize(("text", "rate"), [
    ("0.0083333", 120.0), ("0.008333", 120.0), ("0.0166667", 60.0), ("0.04", 25.0), ("0.041708", 1 / 0.041708),
    ("0.03", 1 / 0.03), ("1", 1.0), ("0.033333", 30.0),
])  # fmt: skip
def test_frame_times_that_are_a_rounded_rate_give_that_rate(text, rate):
    assert frame_rate(float(text), text) == pytest.approx(rate, abs=1e-12)


GOOD = person() + motion([[0, 92, 0] + [0] * 3 * JOINTS] * 3)


@pytest.mark.parametrize(("change", "line", "word"), [
    (lambda t: t.replace("HIERARCHY", "HELLO"), 1, "HIERARCHY"),
    (lambda t: t.replace("OFFSET 0 20 0", "OFFSET 0 x 0"), 8, "'x'"),
    (lambda t: t.replace("OFFSET 0 20 0", "OFFSET 0 nan 0"), 8, "nan"),
    (lambda t: t.replace("OFFSET 0 20 0\n", "\n"), None, "no OFFSET"),
    (lambda t: t.replace("CHANNELS 3 Xrotation", "CHANNELS 9 Xrotation"), 9, "'9'"),
    (lambda t: t.replace("CHANNELS 3 Xrotation", "CHANNELS 3 Wrotation"), 9, "Wrotation"),
    (lambda t: t.replace("JOINT Chest", "JUNK Chest"), 6, "JUNK"),
    (lambda t: t.replace("JOINT Chest", "JOINT"), 6, "without a name"),
    (lambda t: t.replace("}\nMOTION", "MOTION"), None, "missing before MOTION"),
    (lambda t: t.replace("}\nMOTION", "}\n}\nMOTION"), None, "closes nothing"),
    (lambda t: t.split("MOTION")[0], None, "no MOTION"),
    (lambda t: t.replace("Frame Time: 0.0166667", "Frame Time: fast"), None, "fast"),
    (lambda t: t.replace("Frame Time: 0.0166667", "Frame Time: 0"), None, "frame time of 0"),
    (lambda t: t.replace("Frames: 3", "Frames: many"), None, "many"),
    (lambda t: t.split("Frame Time")[0], None, "too early"),
    (lambda t: "\n".join(t.split("\n")[:-3]), None, "no frames"),
    (lambda t: t.replace("0 92 0 0", "0 92 0 0 7", 1), None, "numbers in this frame"),
    (lambda t: t[:-1] + "q", None, "'q'"),
    (lambda t: t[:-1] + "nan", None, "'nan'"),
    (lambda t: t[:-1] + "1_0", None, "'1_0'"),
    (lambda t: t.replace("ROOT Hips", "ROOT a { } ROOT Hips"), None, ":2"),
    (lambda t: "", 1, "HIERARCHY"),
])  # fmt: skip
def test_broken_files_give_one_line_with_name_and_line(change, line, word):
    with pytest.raises(CaptureError) as caught:
        read_text(change(GOOD))
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("t.bvh:" + (f"{line}:" if line else ""))
    assert word in message


def test_a_file_that_is_not_there_or_no_text(tmp_path):
    with pytest.raises(CaptureError, match=r"nowhere\.bvh: No such file"):
        read_bvh(tmp_path / "nowhere.bvh")
    (tmp_path / "b.bvh").write_bytes(b"\0\1\2\3")
    with pytest.raises(CaptureError, match="not a text file"):
        read_bvh(tmp_path / "b.bvh")
    with pytest.raises(CaptureError):
        read_bvh(tmp_path)


JUNK = [
    "{",
    "}",
    "\n",
    " ",
    "-",
    "e999",
    "nan",
    "JOINT a\n",
    "End Site\n",
    "OFFSET 1 2 3\n",
    "MOTION\n",
    "CHANNELS 0\n",
]
JUNK += ["1e308", "ROOT", "\x00", "٣"]


@given(data=st.data())
@settings(max_examples=300, deadline=None)
def test_damaged_texts_give_a_clip_or_one_line(data):
    text = GOOD
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text)))
        length = data.draw(st.sampled_from([0, 1, 2, 5, 40, 400]))
        junk = data.draw(st.one_of(
            st.sampled_from(JUNK),
            st.text(max_size=6),
        ))  # fmt: skip
        text = text[:at] + junk + text[at + length :]
    try:
        clip = read_text(text).clip
    except CaptureError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(clip.world[0]).all()


@given(data=st.binary(max_size=300))
@settings(max_examples=100, deadline=None)
def test_any_bytes_give_one_line(tmp_path_factory, data):
    file = tmp_path_factory.mktemp("f") / "x.bvh"
    file.write_bytes(b"HIERARCHY\n" + data)
    with pytest.raises(CaptureError):
        read_bvh(file)


def test_a_deep_hierarchy_does_not_exhaust_the_stack():
    depth = 3000
    text = "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
    text += "".join(f"JOINT j{k}\n{{\nOFFSET 0 1 0\nCHANNELS 0\n" for k in range(depth)) + "}\n" * (depth + 1)
    clip = read_text(text + "MOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n").clip
    assert len(clip.skeleton) == depth + 1


@needs_mocap
@pytest.mark.parametrize(("name", "rest", "root", "first"), [
    ("originals/007_06_iclone.bvh", "first frame", "added", True),
    ("originals/13_11_daz.bvh", "rest pose", "absolute", True),
    ("takes/take_cmu_86_01.bvh", "rest pose", "absolute", False),
])  # fmt: skip
def test_originals_stand_on_the_floor_with_legs_of_a_person(name, rest, root, first):
    capture = load_bvh(MOCAP / name)
    assert (capture.rest, capture.root, capture.unit) == (rest, root, 0.01)
    assert any("begins with a T-pose" in line for line in capture.findings) == first
    from bunraku.motion.analysis_contacts import floor_height

    assert abs(floor_height(capture.clip)) < 0.08
    capture.clip.skeleton.check_humanoid()
