"""Retargeting: the same motion on another figure."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.figure.default import default_figure
from bunraku.figure.skeleton import Skeleton, SkeletonError
from bunraku.motion import rotation as rot
from bunraku.motion.analysis import headings, hips, lean
from bunraku.motion.analysis_contacts import floor_height, sole_points
from bunraku.motion.body import figure_of, leg_length
from bunraku.motion.bvh import read_bvh
from bunraku.motion.clip import Clip
from bunraku.motion.files import load_capture
from bunraku.motion.retarget import retarget
from bunraku.motion.roles import roles_of

MOCAP = Path(os.environ.get("BUNRAKU_MOCAP", Path(__file__).parents[2].parent / "shared" / "mocap"))
needs_mocap = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no motion capture at {MOCAP} (set BUNRAKU_MOCAP)")


def bigger(scale: float) -> Skeleton:
    d = default_figure()
    return Skeleton(d.names, d.parents, d.offsets * scale, d.roles, d.masses, d.mass_centers * scale,
                    d.box_centers * scale, d.box_sizes * scale)  # fmt: skip


def a_clip(skeleton: Skeleton) -> Clip:
    rng = np.random.default_rng(7)
    turns = Rotation.from_rotvec(rng.normal(size=(9 * len(skeleton), 3)) * 0.4).as_quat().reshape(9, -1, 4)
    return Clip("a", skeleton, 60.0, rng.normal(size=(9, 3)) + np.array([0.0, 1.0, 0.0]), turns)


def test_a_figure_of_another_size_moves_alike():
    clip = a_clip(default_figure())
    there = retarget(clip, bigger(1.3))
    assert np.allclose(there.world[0], clip.world[0] * 1.3, atol=1e-9)
    assert np.allclose(retarget(there, default_figure()).world[0], clip.world[0], atol=1e-9)


def test_the_same_skeleton_gets_the_same_clip():
    clip = a_clip(default_figure())
    assert retarget(clip, default_figure()) is clip


def three_backs() -> Skeleton:
    """The default figure with one more joint in the back."""
    d = default_figure()
    names = [*d.names[:2], "middle", *d.names[2:]]
    index = [0, 1, *range(3, 22)]
    parents = [-1] + [0] * 21
    offsets = np.zeros((22, 3))
    for old, new in enumerate(index):
        parents[new] = -1 if old == 0 else index[d.parents[old]]
        offsets[new] = d.offsets[old]
    parents[2], parents[3] = 1, 2
    offsets[2] = offsets[3] = d.offsets[2] / 2
    roles = {role: index[j] for role, j in d.roles.items()}
    roles["upperChest"], roles["chest"] = roles["chest"], 2
    return figure_of(names, parents, offsets, roles)


def test_a_back_with_more_joints_shares_the_bend():
    d = default_figure()
    turns = np.tile(d.rest_pose()[1], (1, 1, 1))
    bend = np.radians(40)
    for joint in (d.role("spine"), d.role("chest")):
        turns[0, joint] = rot.axis_angle([1.0, 0, 0], np.array(bend / 2))
    clip = Clip("bow", d, 60.0, np.array([[0, 0.95, 0]]), turns)
    there = retarget(clip, three_backs())
    angles = 2 * np.arccos(there.rotations[0, [1, 2, 3], 3])
    assert np.allclose(angles, bend / 3, atol=1e-9)
    up = rot.rotate(there.world[1][0, there.skeleton.role("upperChest")], rot.UP)
    assert np.arctan2(up[2], up[1]) == pytest.approx(bend)
    back = retarget(there, d)
    assert np.allclose(back.rotations[0, d.role("head")], turns[0, d.role("head")], atol=1e-9)
    assert np.allclose(2 * np.arccos(back.rotations[0, [1, 2], 3]), bend / 2, atol=1e-9)


def test_what_is_no_humanoid_is_refused():
    box = Skeleton(("a", "b"), np.array([-1, 0]), np.zeros((2, 3)), {}, np.zeros(2), *[np.zeros((2, 3))] * 3)
    clip = Clip("crane", box, 30.0, np.zeros((1, 3)), np.tile([0, 0, 0, 1.0], (1, 2, 1)))
    with pytest.raises(SkeletonError, match=r"crane.*no humanoid"):
        retarget(clip, default_figure())


def test_a_body_from_bare_joints_is_like_the_default_figure():
    d = default_figure()
    again = figure_of(d.names, [int(p) for p in d.parents], d.offsets, d.roles)
    assert np.allclose(again.masses, d.masses)
    legs = [j for role, j in d.roles.items() if "Arm" in role or "Leg" in role]
    assert np.allclose(again.box_sizes[legs], d.box_sizes[legs])
    for side in ("left", "right"):
        bottom = again.rest_positions[d.role(side + "Foot"), 1] + again.box_centers[d.role(side + "Foot"), 1]
        assert bottom - again.box_sizes[d.role(side + "Foot"), 1] == pytest.approx(0.0, abs=1e-9)


NAMES = {
    "mixamo": ("mixamorig:Hips", "mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2", "mixamorig:Neck",
               "mixamorig:Head",
               "mixamorig:{S}Shoulder", "mixamorig:{S}Arm", "mixamorig:{S}ForeArm", "mixamorig:{S}Hand",
               "mixamorig:{S}UpLeg", "mixamorig:{S}Leg", "mixamorig:{S}Foot", "mixamorig:{S}ToeBase"),
    "iclone": ("CC_Base_Hip", "CC_Base_Waist", "CC_Base_Spine01", "CC_Base_Spine02", "CC_Base_NeckTwist01",
               "CC_Base_Head",
               "CC_Base_{s}_Clavicle", "CC_Base_{s}_Upperarm", "CC_Base_{s}_Forearm", "CC_Base_{s}_Hand",
               "CC_Base_{s}_Thigh", "CC_Base_{s}_Calf", "CC_Base_{s}_Foot", "CC_Base_{s}_ToeBase"),
    "bandai": ("Hips", "Spine", "Spine1", "Chest", "Neck", "Head", "Shoulder_{s}", "UpperArm_{s}", "LowerArm_{s}",
               "Hand_{s}", "UpperLeg_{s}", "LowerLeg_{s}", "Foot_{s}", "Toes_{s}"),
    "daz": ("hip", "abdomen", "abdomen2", "chest", "neck", "head", "{d}Collar", "{d}Shldr", "{d}ForeArm", "{d}Hand",
            "{d}Thigh", "{d}Shin", "{d}Foot", "{d}Toe"),
    "biped": ("Bip01 Pelvis", "Bip01 Spine", "Bip01 Spine1", "Bip01 Spine2", "Bip01 Neck", "Bip01 Head",
              "Bip01 {s} Clavicle",
              "Bip01 {s} UpperArm", "Bip01 {s} Forearm", "Bip01 {s} Hand", "Bip01 {s} Thigh", "Bip01 {s} Calf",
              "Bip01 {s} Foot", "Bip01 {s} Toe0"),
    "makehuman": ("root", "spine05", "spine03", "spine01", "neck01", "head", "clavicle.{s}", "upperarm01.{s}",
                  "lowerarm01.{s}", "wrist.{s}", "upperleg01.{s}", "lowerleg01.{s}", "foot.{s}", "toe1-1.{s}"),
    "xsens": ("Hips", "Chest", "Chest2", "Chest3", "Neck", "Head", "{S}Collar", "{S}Shoulder", "{S}Elbow", "{S}Wrist",
              "{S}Hip", "{S}Knee", "{S}Ankle", "{S}Toe"),
    "rokoko": ("Hips", "Spine", "Spine2", "Spine4", "Neck", "Head", "{S}Shoulder", "{S}Arm", "{S}ForeArm", "{S}Hand",
               "{S}Thigh", "{S}Shin", "{S}Foot", "{S}Toe"),
    "ours": ("hips", "spine", "chest", "upper_chest", "neck", "head", "{w}_shoulder", "{w}_upper_arm",
             "{w}_lower_arm",
             "{w}_hand", "{w}_upper_leg", "{w}_lower_leg", "{w}_foot", "{w}_toes"),
}  # fmt: skip
LIMBS = ("Shoulder", "UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot", "Toes")


@pytest.mark.parametrize("dialect", NAMES)
def test_names_of_every_dialect_give_the_roles(dialect):
    words = NAMES[dialect]
    names = list(words[:6])
    parents = [-1, 0, 1, 2, 3, 4]
    expected = {"hips": 0, "spine": 1, "chest": 2, "upperChest": 3, "neck": 4, "head": 5}
    for side, form in (("left", {"S": "Left", "s": "L", "d": "l", "w": "left"}),
                       ("right", {"S": "Right", "s": "R", "d": "r", "w": "right"})):  # fmt: skip
        for k, word in enumerate(words[6:]):
            expected[side + LIMBS[k]] = len(names)
            parents.append(3 if k == 0 else 0 if k == 4 else len(names) - 1)
            names.append(word.format(**form))
            if k in (0, 4) and dialect == "iclone":
                names.append(f"CC_Base_{form['s']}_{'UpperarmTwist01' if k == 0 else 'ThighTwist01'}")
                parents.append(len(names) - 2)
                names[-1], names[-2] = names[-2], names[-1]
                expected[side + LIMBS[k]] = len(names) - 1
    assert roles_of(names, parents) == expected


@needs_mocap
def test_travel_and_bend_agree_with_the_raw_capture():
    """The shared clips were made from these files by somebody else's program."""
    raw = load_capture(MOCAP / "originals" / "86_01.amc").clip.resampled(60.0)
    known = read_bvh(MOCAP / "takes" / "take_cmu_86_01.bvh").at_origin()
    ours = retarget(raw, known.skeleton).at_origin()
    count = min(len(ours), len(known))
    off = np.linalg.norm(ours.world[0][:count] - known.world[0][:count], axis=-1)
    flat = np.linalg.norm((ours.world[0][:count] - known.world[0][:count])[:, 0, [0, 2]], axis=-1)
    assert np.median(off) < 0.09  # mostly where the floor is taken to be
    assert flat.max() < 0.01
    assert np.abs(np.degrees(lean(ours)[1][:count] - lean(known)[1][:count])).max() < 1.0


CAPTURES = ("clips/walk_normal_0201.bvh", "originals/13_11_daz.bvh", "originals/007_06_iclone.bvh",
            "originals/HDM_bd_kickLFront1Reps_001_120.amc")  # fmt: skip


@needs_mocap
@pytest.mark.parametrize("name", CAPTURES)
def test_captures_go_onto_the_default_figure_with_the_feet_on_the_floor(name):
    source = load_capture(MOCAP / name).clip
    clip = retarget(source, default_figure(), floor=True)
    assert abs(floor_height(clip)) < 1e-9
    low = sole_points(clip)[:, :, :2, 1].min(axis=(1, 2))
    assert np.percentile(low, 50) > -0.03
    legs = [leg_length(s.offsets, [int(p) for p in s.parents], s.roles) for s in (clip.skeleton, source.skeleton)]
    went = [np.linalg.norm(np.diff(hips(c)[:, [0, 2]], axis=0), axis=1).sum() for c in (clip, source)]
    assert went[0] == pytest.approx(went[1] * legs[0] / legs[1], rel=0.01)
    assert np.allclose(headings(clip) - headings(source), 0.0, atol=np.radians(1.0))
    # Limbs point where the source's point.
    for start, end in (
        ("leftUpperArm", "leftLowerArm"),
        ("rightUpperLeg", "rightLowerLeg"),
        ("rightLowerArm", "rightHand"),
    ):
        bones = []
        for c in (clip, source):
            bone = c.world[0][:, c.skeleton.role(end)] - c.world[0][:, c.skeleton.role(start)]
            bones.append(bone / np.linalg.norm(bone, axis=1)[:, None])
        assert np.abs(bones[0] - bones[1]).max() < 1e-6
