import numpy as np
import pytest

from bunraku.figure.default import default_figure
from bunraku.figure.skeleton import Skeleton
from bunraku.motion import rotation as rot
from bunraku.motion import synth
from bunraku.motion.ground import lowest, sole_of
from bunraku.motion.motionset import CANONICAL, EVENTS, MODULES
from bunraku.motion.synth import builtin_set, cache_file, generate

TABLE_2 = {
    "locomotion": 12, "stand": 6, "step_right": 10, "step_left": 10, "jump_forward": 6, "jump_right": 4,
    "jump_back": 6, "jump_left": 4, "jump_up": 2, "turn_right": 4, "turn_left": 4,
}  # fmt: skip


@pytest.fixture(scope="module")
def motion_set():
    return builtin_set()


@pytest.fixture(scope="module")
def examples(motion_set):
    return motion_set.examples()


def _soles(example, side):
    """Places (F, 3) of heel and ball, and the foot's pitch (F)."""
    clip = example.clip
    sole = sole_of(clip.skeleton, ("left", "right")[side])
    places, turns = clip.world
    ankle, turn = places[:, sole.ankle], turns[:, sole.ankle]
    points = [ankle + rot.rotate(turn, np.array([0.0, -sole.height, z])) for z in (sole.heel, sole.ball)]
    return points, np.arcsin(rot.rotate(turn, np.array([0.0, 0.0, 1.0]))[:, 1])


def test_every_module_has_the_counts_of_table_2_or_more(motion_set):
    assert set(motion_set.modules) == set(MODULES)
    for name, count in TABLE_2.items():
        module = motion_set.module(name)
        assert len(module.examples) >= count
        assert module.parameters == MODULES[name]
        events = EVENTS["jump" if name.startswith("jump") else name]
        assert len(module.examples[0].keys) == len(events)
    assert tuple(motion_set.canonical) == CANONICAL


def test_parameters_cover_their_range(motion_set):
    values = motion_set.module("locomotion").values
    low, high = values.min(axis=0), values.max(axis=0)
    assert low[0] < 0.05
    assert high[0] > 3.5
    assert np.degrees(high[1]) > 90.0
    np.testing.assert_allclose(low[1], -high[1], atol=1e-3)
    assert np.degrees(high[2]) > 15.0
    assert np.degrees(high[3]) > 30.0
    assert high[4] > 0.7


def test_planted_feet_stand_still(examples):
    for example in examples:
        for side in range(2):
            (heel, ball), pitch = _soles(example, side)
            on = example.contacts[:, side]
            edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(int), [0]])))
            for first, last in zip(edges[::2], edges[1::2], strict=True):
                for point, bears in ((heel, pitch > -1e-3), (ball, pitch < 1e-3)):
                    span = point[first:last][bears[first:last]]
                    if len(span) > 1:
                        gap = np.linalg.norm((span - span[0])[:, [0, 2]], axis=1).max()
                        assert gap < 0.004, (example.clip.name, side, gap)
                        assert np.abs(span[:, 1]).max() < 0.012, (example.clip.name, side)


def test_no_foot_goes_under_the_floor(examples):
    for example in examples:
        clip = example.clip
        for side, name in enumerate(("left", "right")):
            sole = sole_of(clip.skeleton, name)
            _, pitch = _soles(example, side)
            toes = rot.log(clip.rotations[:, sole.toes])
            low = lowest(sole, clip.world[0][:, sole.ankle, 1], pitch, -toes[:, 0])
            assert low.min() > -0.012, (clip.name, name, low.min())


def test_legs_are_never_longer_than_they_are_and_knees_bend_forward(examples):
    for example in examples:
        clip = example.clip
        for side in ("left", "right"):
            knee = rot.log(clip.rotations[:, clip.skeleton.role(side + "LowerLeg")])
            assert knee[:, 0].min() > 0.02, clip.name
            assert np.degrees(knee[:, 0].max()) < 150.0, clip.name


def test_walking_has_double_support_that_shrinks_and_running_flies(motion_set):
    shares = {}
    for example in motion_set.module("locomotion").examples:
        on = example.contacts[:-1]
        shares[example.clip.name] = (float(on.all(axis=1).mean()), float((~on.any(axis=1)).mean()))
    assert shares["stroll"][0] > shares["walk"][0] > shares["brisk_walk"][0] > 0.10
    assert shares["walk"][1] == 0.0
    assert shares["run"][0] == 0.0
    assert shares["run"][1] > shares["jog"][1] > 0.1


def test_the_root_rises_over_the_standing_leg_and_arms_swing_against_it(motion_set):
    walk = next(e for e in motion_set.module("locomotion").examples if e.clip.name == "walk")
    clip, phase = walk.clip, np.linspace(0.0, 1.0, len(walk.clip))
    height = clip.roots[:, 1]
    assert 0.03 < np.ptp(height) < 0.06
    assert height[np.abs(phase - 0.33).argmin()] > height[np.abs(phase - 0.08).argmin()] + 0.02
    places = clip.world[0]
    skeleton = clip.skeleton
    for side in ("left", "right"):
        hand = places[:, skeleton.role(side + "Hand"), 2] - clip.roots[:, 2]
        foot = places[:, skeleton.role(side + "Foot"), 2] - clip.roots[:, 2]
        assert np.corrcoef(hand, foot)[0, 1] < -0.85
    # Sway toward the leg that stands.
    sway = clip.roots[:, 0]
    assert sway[np.abs(phase - 0.33).argmin()] > 0.01
    assert sway[np.abs(phase - 0.83).argmin()] < -0.01


def test_cycles_close(motion_set):
    for example in (*motion_set.module("locomotion").examples, *motion_set.module("stand").examples):
        clip = example.clip
        gap = rot.log(rot.mul(rot.inverse(clip.rotations[0, 1:]), clip.rotations[-1, 1:]))
        assert np.abs(gap).max() < 0.02, clip.name
        assert abs(clip.roots[-1, 1] - clip.roots[0, 1]) < 0.003


def test_left_and_right_are_alike(motion_set):
    for name in ("step", "turn", "jump"):
        left, right = motion_set.module(f"{name}_left"), motion_set.module(f"{name}_right")
        a, b = left.examples[-1], right.examples[-1]
        mirrored = a.clip.mirrored()
        assert len(mirrored) == len(b.clip)
        assert np.abs(mirrored.roots - b.clip.roots).max() < 0.01
        turned = rot.log(rot.mul(rot.inverse(mirrored.rotations), b.clip.rotations))
        assert np.degrees(np.linalg.norm(turned, axis=-1)).max() < 12.0


def test_flight_is_ballistic(motion_set):
    high = motion_set.module("jump_up").examples[-1]
    flying = np.flatnonzero(~high.contacts.any(axis=1))[2:-2]
    falls = np.diff(high.clip.roots[flying, 1], 2) * high.clip.fps**2
    np.testing.assert_allclose(falls, -9.81, atol=0.5)


def test_it_is_made_once_and_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    figure = default_figure()
    first = builtin_set(figure)
    path = cache_file(figure)
    assert path.is_file()
    assert path.stat().st_size < 1_500_000
    monkeypatch.setattr(synth, "generate", lambda skeleton: pytest.fail("made again"))
    second = builtin_set(figure)
    for a, b in zip(first.examples(), second.examples(), strict=True):
        assert a.clip.rotations.tobytes() == b.clip.rotations.tobytes()
        assert a.clip.roots.tobytes() == b.clip.roots.tobytes()


def test_a_damaged_cache_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    figure = default_figure()
    path = cache_file(figure)
    path.parent.mkdir(parents=True)
    path.write_bytes(b"half a fi")
    assert builtin_set(figure).modules
    assert path.stat().st_size > 100_000


@pytest.mark.parametrize("size", [0.55, 1.3])
def test_other_bodies_move_by_the_same_laws(size):
    figure = default_figure()
    other = Skeleton(
        figure.names, figure.parents, figure.offsets * size, figure.roles, figure.masses, figure.mass_centers * size,
        figure.box_centers * size, figure.box_sizes * size,
    )  # fmt: skip
    made = generate(other)
    walk = made.canonical["walk"]
    own = builtin_set().canonical["walk"]
    # Equal Froude numbers: speeds go with the root of the size, lengths with the size.
    assert walk.values[0] == pytest.approx(own.values[0] * np.sqrt(size), rel=0.03)
    assert walk.clip.roots[:, 1].mean() == pytest.approx(own.clip.roots[:, 1].mean() * size, rel=0.01)
