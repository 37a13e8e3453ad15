"""ASF and AMC: bones, degrees of freedom, and one line for what is broken."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bunraku.motion.asf import find_asf, load_amc, parse_amc, parse_asf, read_amc
from bunraku.motion.capture import CaptureError, interpret
from bunraku.motion.files import find_captures, load_capture

MOCAP = Path(os.environ.get("BUNRAKU_MOCAP", Path(__file__).parents[2].parent / "shared" / "mocap"))
needs_mocap = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no motion capture at {MOCAP} (set BUNRAKU_MOCAP)")


def bone(name, direction, length, axis=(0, 0, 0), dof="rx ry rz"):
    x, y, z = direction
    lines = ["begin", "id 1", f"name {name}", f"direction {x} {y} {z}", f"length {length}",
             f"axis {axis[0]} {axis[1]} {axis[2]} XYZ"]  # fmt: skip
    if dof:
        lines += [f"dof {dof}", *["limits (-10.0 170.0)" if k == 0 else "(-1 1)" for k in range(len(dof.split()))]]
    return "\n".join([*lines, "end"])


SPLAY = np.radians(20)


def figure_text():
    bones = [bone("lowerback", (0, 1, 0), 4), bone("thorax", (0, 1, 0), 4), bone("lowerneck", (0, 1, 0), 2),
             bone("head", (0, 1, 0), 3)]  # fmt: skip
    links = ["root lhipjoint rhipjoint lowerback", "lowerback thorax", "thorax lowerneck lclavicle rclavicle",
             "lowerneck head"]  # fmt: skip
    for side, sign in (("l", 1), ("r", -1)):
        leg = (sign * np.sin(SPLAY), -np.cos(SPLAY), 0)
        bones += [
            bone(f"{side}hipjoint", (sign, 0, 0), 1.8, dof=""),
            bone(f"{side}femur", leg, 7.5, (0, 0, sign * 20)),
            bone(f"{side}tibia", leg, 7.3, (0, 0, sign * 20), "rx"),
            bone(f"{side}foot", (0, 0, 1), 2.2, (-90, 0, sign * 20), "rx rz"),
            bone(f"{side}clavicle", (sign, 0.2, 0), 3, dof="ry rz"),
            bone(f"{side}humerus", (sign, 0, 0), 4.9, (180, -30, -90)),
            bone(f"{side}radius", (sign, 0, 0), 3.3, (180, -30, -90), "rx"),
            bone(f"{side}hand", (sign, 0, 0), 0.7, (0, 90, 90), "rx rz"),
        ]
        links += [f"{side}hipjoint {side}femur", f"{side}femur {side}tibia", f"{side}tibia {side}foot",
                  f"{side}clavicle {side}humerus", f"{side}humerus {side}radius",
                  f"{side}radius {side}hand"]  # fmt: skip
    return (
        "# made for a test\n:version 1.10\n:name T\n:units\n mass 1.0\n length 0.45\n angle deg\n"
        ":documentation\n free words here\n:root\n order TX TY TZ RX RY RZ\n axis XYZ\n position 0 0 0\n"
        " orientation 0 0 0\n:bonedata\n" + "\n".join(bones) + "\n:hierarchy\nbegin\n" + "\n".join(links) + "\nend\n"
    )


FIGURE = figure_text()


def frame(number, **values):
    lines = [str(number)]
    for name, count in [("root", 6), *[(b.name, len(b.freedom)) for b in parse_asf(FIGURE, "t.asf").bones[1:]]]:
        if count:
            row = values.get(name, [0, 16, 0, 0, 0, 0] if name == "root" else [0] * count)
            lines.append(f"{name} " + " ".join(map(str, row)))
    return "\n".join(lines)


def motion(*frames):
    return "#!OML:ASF x\n:FULLY-SPECIFIED\n:DEGREES\n" + "\n".join(frames) + "\n"


MOTION = motion(frame(1), frame(2, lfemur=[10, 20, 30]), frame(3))


def read(asf=FIGURE, amc=MOTION):
    return interpret(parse_amc(amc, "t.amc", parse_asf(asf, "t.asf")))


def test_the_unit_and_the_rate_are_those_of_the_collections():
    capture = read()
    assert capture.unit == pytest.approx(0.0254 / 0.45)
    assert capture.clip.fps == 120.0
    assert capture.clip.roots[0, 1] == pytest.approx(16 * 0.0254 / 0.45)
    assert len(capture.clip) == 3
    capture.clip.skeleton.check_humanoid()


def test_splayed_legs_are_made_straight_at_rest_and_stay_where_they_were():
    clip = read().clip
    rest = clip.skeleton.rest_positions
    hip, ankle = clip.skeleton.role("leftUpperLeg"), clip.skeleton.role("leftFoot")
    assert np.allclose((rest[ankle] - rest[hip])[[0, 2]], 0.0, atol=1e-9)
    unit = 0.0254 / 0.45
    bone_vector = np.array([np.sin(SPLAY), -np.cos(SPLAY), 0.0]) * 14.8 * unit
    assert np.allclose(clip.world[0][0, ankle] - clip.world[0][0, hip], bone_vector, atol=1e-9)


def test_a_bone_turns_by_its_own_axes():
    clip = read().clip
    hip, knee = clip.skeleton.role("leftUpperLeg"), clip.skeleton.role("leftLowerLeg")
    base = Rotation.from_euler("xyz", [0, 0, 20], degrees=True)
    turn = base * Rotation.from_euler("xyz", [10, 20, 30], degrees=True) * base.inv()
    unit = 0.0254 / 0.45
    expected = turn.apply([np.sin(SPLAY), -np.cos(SPLAY), 0.0]) * 7.5 * unit
    assert np.allclose(clip.world[0][1, knee] - clip.world[0][1, hip], expected, atol=1e-9)


def test_radians_samples_and_angles_over_a_turn():
    wound = read(amc=motion(frame(1, lfemur=[10 + 1800, 20, 30 - 720])))
    assert np.allclose(wound.clip.world[0][0], read(amc=motion(frame(1, lfemur=[10, 20, 30]))).clip.world[0][0])
    radians = MOTION.replace(":DEGREES", ":RADIANS\n:SAMPLES-PER-SECOND 60").replace(
        "lfemur 10 20 30", "lfemur " + " ".join(repr(float(np.radians(v))) for v in (10, 20, 30))
    )
    assert read(amc=radians).clip.fps == 60.0
    assert np.allclose(read(amc=radians).clip.world[0], read().clip.world[0])


def test_a_last_frame_cut_short_is_left_out():
    cut = read(amc=motion(frame(1), frame(2), "3\nroot 0 16 0 0 0 0"))
    assert len(cut.clip) == 2
    assert any("cut short" in line for line in cut.findings)


@pytest.mark.parametrize(("change", "file", "word"), [
    (lambda a, m: (a.replace("direction 0 1 0", "direction 0 1", 1), m), "t.asf:", "3 numbers"),
    (lambda a, m: (a.replace("direction 0 1 0", "direction 0 0 0", 1), m), "t.asf:", "without a direction"),
    (lambda a, m: (a.replace("XYZ\n", "XXZ\n", 2), m), "t.asf:", "XXZ"),
    (lambda a, m: (a.replace("dof rx ry rz", "dof rx qq", 1), m), "t.asf:", "qq"),
    (lambda a, m: (a.replace("length 0.45", "length 0"), m), "t.asf:6", "unit length"),
    (lambda a, m: (a.replace("lowerback thorax", "lowerback nobody"), m), "t.asf:", "nobody"),
    (lambda a, m: (a.replace("lowerback thorax", "head thorax"), m), "t.asf:", "hangs from nothing"),
    (lambda a, m: (a.replace("name thorax", "name lowerback"), m), "t.asf:", "second bone"),
    (lambda a, m: ("hello", m), "t.asf:1", "not an ASF"),
    (lambda a, m: (a, m.replace("lfemur 10 20 30", "lfemur 10 20")), "t.amc:", "2 numbers"),
    (lambda a, m: (a, m.replace("lfemur 10 20 30", "lfemur 10 x 30")), "t.amc:", "no numbers"),
    (lambda a, m: (a, m.replace("lfemur 10 20 30", "tail 10 20 30")), "t.amc:", "right ASF"),
    (lambda a, m: (a, m.replace("lfemur 10 20 30\n", "")), "t.amc:", "missing in this frame"),
    (lambda a, m: (a, m.replace("lfemur 10 20 30", "lfemur 1 2 3\nlfemur 1 2 3")), "t.amc:", "twice"),
    (lambda a, m: (a, m.replace("lfemur 10 20 30", "lfemur nan 2 3")), "t.amc:38", "no lengths"),
    (lambda a, m: (a, ":DEGREES\n"), "t.amc:1", "no frames"),
    (lambda a, m: (a, "root 1 2 3\n"), "t.amc:1", "frame number"),
    (lambda a, m: (a, "1\n2\n"), "t.amc:2", "without any bone"),
])  # fmt: skip
def test_broken_files_give_one_line(change, file, word):
    asf, amc = change(FIGURE, MOTION)
    with pytest.raises(CaptureError) as caught:
        read(asf, amc)
    assert str(caught.value).startswith(file)
    assert word in str(caught.value)
    assert "\n" not in str(caught.value)


JUNK = [
    "\n",
    " ",
    "nan",
    "1e400",
    ":root\n",
    "begin\n",
    "end\n",
    "dof tx l\n",
    "7\n",
    "axis 1 2 3 ZYX\n",
    ":bonedata\n",
]


@given(data=st.data())
@settings(max_examples=200, deadline=None)
def test_damaged_texts_give_a_clip_or_one_line(data):
    texts = [FIGURE, MOTION]
    for _ in range(data.draw(st.integers(1, 3))):
        which = data.draw(st.integers(0, 1))
        at = data.draw(st.integers(0, len(texts[which])))
        length = data.draw(st.sampled_from([0, 1, 3, 20, 200]))
        junk = data.draw(st.one_of(
            st.sampled_from(JUNK),
            st.text(max_size=5),
        ))  # fmt: skip
        texts[which] = texts[which][:at] + junk + texts[which][at + length :]
    try:
        clip = read(*texts).clip
    except CaptureError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(clip.world[0]).all()


def test_the_skeleton_is_found_beside_the_motion(tmp_path):
    (tmp_path / "02_04.amc").write_text(MOTION)
    with pytest.raises(CaptureError, match="give the ASF"):
        find_asf(tmp_path / "02_04.amc")
    (tmp_path / "86.asf").write_text(FIGURE)
    assert find_asf(tmp_path / "02_04.amc").name == "86.asf"
    (tmp_path / "02.asf").write_text(FIGURE)
    assert find_asf(tmp_path / "02_04.amc").name == "02.asf"
    (tmp_path / "02.ASF").write_text(FIGURE)
    clip = read_amc(tmp_path / "02_04.amc", fps=60.0)
    assert (clip.name, clip.fps) == ("02_04", 60.0)
    assert [p.name for p in find_captures(tmp_path)] == ["02_04.amc"]
    with pytest.raises(CaptureError, match=r"neither a \.bvh nor an \.amc"):
        load_capture(tmp_path / "02.asf")


@needs_mocap
@pytest.mark.parametrize(("name", "frames"), [("02_04.amc", 483), ("86_01.amc", 4579),
                                              ("HDM_bd_kickLFront1Reps_001_120.amc", 161)])  # fmt: skip
def test_originals_stand_on_the_floor(name, frames):
    capture = load_amc(MOCAP / "originals" / name)
    assert len(capture.clip) == frames
    assert capture.findings == ()
    from bunraku.motion.analysis_contacts import floor_height

    assert abs(floor_height(capture.clip)) < 0.12
