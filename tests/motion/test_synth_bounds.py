import numpy as np
import pytest

from bunraku.figure.default import default_figure
from bunraku.figure.limits import limits_of, worst_excess
from bunraku.figure.metrics import floor_penetration, self_penetration
from bunraku.motion import rotation as rot
from bunraku.motion.motionset import MODULES
from bunraku.motion.synth import builtin_set
from bunraku.motion.synth_body import Frame, Plan, assemble, posed
from bunraku.motion.synth_bounds import ankles_beyond, arms_in_body, eased, pitched_more
from bunraku.motion.synth_stand import quiet_plan

MODULE_NAMES = (*MODULES, "canonical")


def _clips(name):
    motion_set = builtin_set()
    examples = motion_set.canonical.values() if name == "canonical" else motion_set.module(name).examples
    return [example.clip for example in examples]


@pytest.mark.parametrize("name", MODULE_NAMES)
def test_bodies_of_examples_are_not_in_each_other(name):
    for clip in _clips(name):
        depth = self_penetration(clip.skeleton, *clip.world)
        assert depth.max() < 0.04, (clip.name, depth.argmax(), depth.max())


@pytest.mark.parametrize("name", MODULE_NAMES)
def test_examples_keep_the_ranges_of_their_joints(name):
    limits = limits_of(default_figure())
    for clip in _clips(name):
        worst = max(worst_excess(limits, pose) for pose in np.ascontiguousarray(clip.rotations))
        assert np.degrees(worst) < 1.0, (clip.name, np.degrees(worst))


@pytest.mark.parametrize("name", MODULE_NAMES)
def test_boxes_of_examples_are_not_in_the_floor(name):
    # A foot that rolls over the ball at 60 degrees has its toe joint 15 mm lower than when it is flat.
    for clip in _clips(name):
        depth = floor_penetration(clip.skeleton, *clip.world)
        assert depth.max() < 0.015, (clip.name, depth.argmax(), depth.max())


def test_runners_carry_their_forearms_square_before_the_body():
    for clip in _clips("canonical"):
        if clip.name not in ("jog", "run"):
            continue
        skeleton, places = clip.skeleton, clip.world[0]
        for side, sign in (("left", 1.0), ("right", -1.0)):
            elbow = np.degrees(np.linalg.norm(rot.log(clip.rotations[:, skeleton.role(side + "LowerArm")]), axis=-1))
            assert 75.0 < elbow.mean() < 110.0
            hand = places[:, skeleton.role(side + "Hand")] - clip.roots
            forward = hand[:, 2].argmax()
            assert hand[forward, 2] > 0.2
            assert sign * hand[forward, 0] < 0.16  # before the chest, inside of the shoulder


def test_arms_that_hang_in_the_legs_are_lifted_aside():
    frame = Frame(default_figure())
    times = np.arange(31) / 60.0
    inside = quiet_plan(frame, times)
    inside.abduct[:] = -0.1
    before = arms_in_body(posed("inside", frame, inside))
    assert before.min() > 0.02
    free = quiet_plan(frame, times)
    free.abduct[:] = 0.6
    assert not arms_in_body(posed("free", frame, free)).any()
    clip = assemble("lifted", frame, inside)
    assert arms_in_body(clip).max() < 0.25 * before.min()
    assert self_penetration(clip.skeleton, *clip.world).max() < 0.02


@pytest.mark.parametrize("pitch", [-1.6, 1.4])
def test_a_foot_pitched_beyond_its_ankle_is_told_the_way_back(pitch):
    frame = Frame(default_figure())
    plan: Plan = quiet_plan(frame, np.arange(11) / 60.0)
    plan.foot_pitch[0] = pitch
    clip = posed("pitched", frame, plan)
    lack = ankles_beyond(clip)
    assert not lack[1].any()
    assert np.sign(lack[0]).tolist() == [-np.sign(pitch)] * 11
    plan.foot_pitch += pitched_more(clip)
    assert np.abs(ankles_beyond(posed("kept", frame, plan))).max() < 0.02


@pytest.mark.parametrize("closed", [False, True])
def test_what_is_added_is_smooth_and_never_less_than_what_lacks(closed):
    lack = np.zeros(61)
    lack[2:6] = 0.3
    if closed:
        lack[-1] = lack[0]
    more = eased(lack, 4, closed)
    assert (more >= lack - 1e-12).all()
    assert more.max() == pytest.approx(0.3)
    assert np.abs(np.diff(more)).max() < 0.1
    assert more[30] == 0.0
    assert (more[-2] > 0.0) == closed
    assert not eased(np.zeros(20), 4, closed).any()
