"""Motion sets built from captures: the recipe, the edits, and a set from a folder."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.default import default_figure
from bunraku.motion import build_edit as edit
from bunraku.motion import rotation as rot
from bunraku.motion.analysis import ducks, headings, hips, lean, measure
from bunraku.motion.analysis_contacts import contacts
from bunraku.motion.build import example_of, load_source, make
from bunraku.motion.build_plan import plan
from bunraku.motion.build_recipe import Piece, Recipe, RecipeError, read_recipe, recipe_text, write_recipe
from bunraku.motion.bvh import write_bvh
from bunraku.motion.motionset import EVENTS, MODULES, MotionSet, MotionSetError
from bunraku.motion.synth import builtin_set

MOCAP = Path(os.environ.get("BUNRAKU_MOCAP", Path(__file__).parents[2].parent / "shared" / "mocap"))
needs_mocap = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no motion capture at {MOCAP} (set BUNRAKU_MOCAP)")
FIGURE = default_figure()


@pytest.fixture(scope="module")
def generated():
    """The built-in set: motion whose contacts and key times are known."""
    return builtin_set(FIGURE)


@pytest.fixture(scope="module")
def walk(generated):
    return generated.canonical["walk"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, generated):
    """Captures as somebody might have them: generated motion as BVH, a walk of three cycles among it."""
    base = tmp_path_factory.mktemp("captures")
    (base / "more").mkdir()
    for name in ("walk", "run", "jog", "sneak"):
        write_bvh(edit.repeated(generated.canonical[name].clip, 3), base / f"{name}.bvh")
    for name in ("walk_left", "walk_right"):
        clip = next(e.clip for e in generated.module("locomotion").examples if e.clip.name == name)
        write_bvh(edit.repeated(clip, 3), base / "more" / f"{name}.bvh")
    write_bvh(edit.repeated(generated.module("stand").examples[0].clip, 2), base / "stand.bvh")
    for name in ("jump_up", "short_jump", "long_jump"):
        write_bvh(generated.canonical[name].clip, base / f"{name}.bvh")
    for module in ("turn_left", "turn_right", "step_left"):
        for k, example in enumerate(generated.module(module).examples[1:4]):
            write_bvh(example.clip, base / f"{module}{k}.bvh")
    (base / "broken.bvh").write_text("HIERARCHY\nROOT x\n{\n")
    return base


def planted(clip, flags):
    """m: how far ankles move while their foot is on the ground, at most, from frame to frame."""
    ankles, _ = edit.feet_of(clip)
    step = np.linalg.norm(np.diff(ankles, axis=0), axis=-1)
    return step[flags[1:] & flags[:-1]].max()


def test_leaning_keeps_the_feet_and_adds_the_lean(walk):
    clip = walk.clip
    ankles, feet = edit.feet_of(clip)
    for tilt, bend in ((0.3, 0.0), (-0.3, 0.0), (0.0, 0.5), (0.0, -0.25)):
        leant = edit.leaned(clip, tilt, bend)
        moved = edit.feet_of(leant)
        assert np.abs(moved[0] - ankles).max() < 2e-3
        assert np.abs(np.abs(np.sum(moved[1] * feet, -1)) - 1).max() < 1e-9
        was, now = [np.array([a.mean() for a in lean(c)]) for c in (clip, leant)]
        asked = np.array([tilt, bend])
        assert np.all(np.abs((now - was) - asked) < 0.02)
        head = FIGURE.role("head")
        turned = np.abs(np.sum(leant.world[1][:, head] * clip.world[1][:, head], -1))
        assert 2 * np.arccos(turned.min()) < 0.6 * np.abs(asked).max()


@given(duck=st.floats(0.0, 1.0))
@settings(max_examples=8, deadline=None)
def test_ducking_lowers_the_hips_and_keeps_the_feet(walk, duck):
    low = edit.ducked(walk.clip, duck)
    assert np.allclose(ducks(low) - ducks(walk.clip), duck, atol=1e-6)
    assert np.abs(edit.feet_of(low)[0] - edit.feet_of(walk.clip)[0]).max() < 2e-3


def test_a_jump_is_carried_sideways_with_planted_feet(generated):
    up = generated.module("jump_up").examples[1]
    off, land = up.keys[2], up.keys[4]
    there = edit.carried(up.clip, up.contacts, 0.5, -0.2, off, land)
    gone = there.roots[-1] - up.clip.roots[-1]
    assert np.allclose(gone, [0.5, 0.0, -0.2], atol=1e-9)
    assert planted(there, up.contacts) < planted(up.clip, up.contacts) + 2e-3
    assert np.allclose(there.roots[0], up.clip.roots[0])


def test_marching_lifts_the_free_feet_only(walk):
    high = edit.marched(walk.clip, walk.contacts, 0.28)
    before, after = edit.feet_of(walk.clip)[0], edit.feet_of(high)[0]
    assert (after[..., 1].max(axis=0) - before[..., 1].max(axis=0)).min() > 0.12
    on = walk.contacts
    assert np.abs(after - before)[on].max() < 2e-3


@pytest.mark.parametrize("share", [0.4, 1.0])
def test_a_slowed_walk_goes_less_far_and_stands_where_it_stood(walk, share):
    slow = edit.slowed(walk.clip, share)
    gone, was = (float(clip.roots[-1, 2] - clip.roots[0, 2]) for clip in (slow, walk.clip))
    assert gone == pytest.approx((1.0 - share) * was, abs=2e-3)
    ankles, feet = edit.feet_of(slow)
    flat = np.abs(rot.rotate(feet, np.array([0.0, 0.0, 1.0]))[..., 1]) < 0.02
    for foot in range(2):
        still = walk.contacts[:, foot] & flat[:, foot]
        assert still.sum() > 8
        assert np.linalg.norm(np.diff(ankles[:, foot, [0, 2]], axis=0), axis=1)[still[1:] & still[:-1]].max() < 2e-3
    assert edit.gap(slow, 0, len(slow) - 1) < 0.02


@pytest.mark.parametrize("angle", [0.4, -1.3])
def test_a_stand_is_spun_by_its_feet(generated, angle):
    stand = generated.module("stand").examples[0].clip.slice(0, 63)
    keys = np.array([0.0, 0.12, 0.45, 0.52, 0.85, 1.03])
    flags = edit.step_flags(np.ones((63, 2), dtype=bool), keys, 60.0, 0 if angle > 0 else 1)
    turned = edit.spun(edit.stepping(stand, flags, 0.05), flags, angle, keys[1], keys[4])
    assert headings(turned)[-1] - headings(turned)[0] == pytest.approx(angle, abs=0.01)
    ankles, _ = edit.feet_of(turned)
    for foot in range(2):
        down = flags[1:, foot] & flags[:-1, foot]
        assert np.linalg.norm(np.diff(ankles[:, foot, [0, 2]], axis=0), axis=1)[down].max() < 2e-3
        assert ankles[:, foot, 1].max() - ankles[0, foot, 1] > 0.03


def test_closing_makes_the_last_pose_the_first_one(walk):
    part = edit.repeated(walk.clip, 2).slice(3, 60)
    loop = edit.closed(part)
    assert edit.gap(part, 0, len(part) - 1) > 0.01
    assert edit.gap(loop, 0, len(loop) - 1) < 1e-6
    assert loop.roots[0, 1] == pytest.approx(loop.roots[-1, 1])
    assert len(edit.repeated(loop, 3)) == 3 * (len(loop) - 1) + 1


def test_repeating_goes_on_from_where_it_has_led(generated):
    clip = next(e.clip for e in generated.module("locomotion").examples if e.clip.name == "walk_left")
    thrice = edit.repeated(clip, 3)
    turned = headings(clip)[-1] - headings(clip)[0]
    assert headings(thrice)[-1] - headings(thrice)[0] == pytest.approx(3 * turned, abs=1e-5)
    steps = np.linalg.norm(np.diff(hips(thrice), axis=0), axis=1)
    assert steps.max() < 1.5 * np.linalg.norm(np.diff(hips(clip), axis=0), axis=1).max()


def test_arms_hang_when_calmed(generated):
    up = generated.canonical["jump_up"].clip
    calm = edit.calmed(up, 1.0)
    places = calm.world[0]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        hand = places[:, FIGURE.role(side + "Hand")] - places[:, FIGURE.role(side + "UpperArm")]
        assert hand[0, 1] < -0.4
        assert sign * hand[0, 0] > 0.0


def test_there_and_back_ends_where_it_began(walk):
    both = edit.there_and_back(walk.clip)
    assert len(both) == 2 * len(walk.clip) - 1
    assert np.allclose(both.roots[0], both.roots[-1])


PIECE = Piece("jump_left", "a b", "more/x.bvh", (0.0, 0.4, 0.6, 0.8, 1.0, 1.5), angle=90.0, distance=0.5)


def test_a_recipe_reads_back_as_written(tmp_path):
    cycle = Piece("locomotion", 'quote " and \\', "w.bvh", (0.1, 0.2, 0.3, 0.4, 1.25), loop=(0.5, 1.5), mirrored=True)
    stand = Piece("stand", "s", "s.bvh", (0.0, 2.0), loop=(0.0, 1.0), back=True, tilt=-20.0, duck=0.5, bend=3.5)
    stand = replace(stand, turn=45.0, slow=0.5)
    recipe = Recipe("a set", (cycle, stand, PIECE, replace(cycle, module="canonical", name="march", march=0.3)))
    write_recipe(recipe, tmp_path / "r.toml")
    assert read_recipe(tmp_path / "r.toml") == recipe
    assert "left_strike, right_passes" in recipe_text(recipe)


GOOD = recipe_text(Recipe("r", (PIECE,)))


@pytest.mark.parametrize(("change", "word"), [
    (lambda t: t + "junk", "r.toml"),
    (lambda t: t.replace("[[piece]]", "[piece]"), "no [[piece]]"),
    (lambda t: t.replace("distance = 0.5", "distance = nan"), "distance"),
    (lambda t: t.replace("distance = 0.5", "distance = true"), "distance"),
    (lambda t: t.replace("distance = 0.5", "distanse = 0.5"), "distanse"),
    (lambda t: t.replace('"jump_left"', '"jump_sky"'), "jump_sky"),
    (lambda t: t.replace('"more/x.bvh"', '"../x.bvh"'), "below the folder"),
    (lambda t: t.replace('"more/x.bvh"', '"/etc/x.bvh"'), "below the folder"),
    (lambda t: t.replace("0.4000, ", ""), "5 keys"),
    (lambda t: t.replace("0.4000", "0.9000"), "increasing"),
    (lambda t: t.replace("0.4000", '"a"'), "seconds"),
    (lambda t: t + t[t.rindex("[[piece]]") :], "two pieces"),
    (lambda t: t + "back = true\n", "loop"),
    (lambda t: t + "mirrored = 3\n", "mirrored"),
    (lambda t: t.replace('name = "a b"', "name = 3"), "'name'"),
])  # fmt: skip
def test_a_recipe_that_cannot_be_used_says_where(tmp_path, change, word):
    (tmp_path / "r.toml").write_text(change(GOOD))
    with pytest.raises(RecipeError) as caught:
        read_recipe(tmp_path / "r.toml")
    assert str(caught.value).startswith("r.toml")
    assert word in str(caught.value)
    assert "\n" not in str(caught.value)


@given(st.text(max_size=120))
@settings(max_examples=100, deadline=None)
def test_any_text_is_a_recipe_or_a_line(tmp_path_factory, text):
    file = tmp_path_factory.mktemp("r") / "r.toml"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(RecipeError):
        read_recipe(file)


def test_a_folder_becomes_a_set_and_its_recipe_gives_the_same_set(folder, tmp_path):
    told = []
    planned = plan(folder, FIGURE, "mine", lambda done, whole, note: told.append((done, whole, note)))
    assert len(told) >= 15
    assert any("broken.bvh: left out: broken.bvh:" in note for note in planned.notes)
    write_recipe(planned.recipe, tmp_path / "mine.toml")
    first = make(planned.recipe, folder, FIGURE)
    again = make(read_recipe(tmp_path / "mine.toml"), folder, FIGURE)
    first.save(tmp_path / "mine.npz")
    loaded = MotionSet.load(tmp_path / "mine.npz")
    assert set(first.modules) == set(MODULES)
    assert [e.clip.name for e in first.examples()] == [e.clip.name for e in loaded.examples()]
    for a, b in zip(first.examples(), again.examples(), strict=True):
        assert np.allclose(a.clip.roots, b.clip.roots, atol=0.01)
        assert np.allclose(a.values, b.values, atol=0.02)
    # What was written is found with the parameters it was made with.
    speeds = [e.values[0] for e in first.module("locomotion").examples if not e.made]
    assert min(abs(s - 1.3) for s in speeds) < 0.1
    assert max(e.values[0] for e in first.module("locomotion").examples) > 3.0
    turns = [e.values[1] for e in first.module("locomotion").examples]
    assert min(turns) < -0.7 < 0.7 < max(turns)
    for name in ("walk", "run", "jog", "sneak", "march", "jump_up", "long_jump"):
        assert name in first.canonical
    assert first.canonical["march"].made
    for module in first.modules.values():
        events = EVENTS.get(module.name, EVENTS["jump"])
        for example in module.examples:
            assert len(example.keys) == len(events)
            assert example.keys[0] == 0.0
            assert example.keys[-1] == pytest.approx(example.clip.duration)
            if example.cycle:
                assert edit.gap(example.clip, 0, len(example.clip) - 1) < 1e-3


def test_made_pieces_reach_what_they_were_asked_for(folder):
    planned = plan(folder, FIGURE)
    built = make(planned.recipe, folder, FIGURE)
    checked = 0
    pieces = {(p.module, p.name): p for p in planned.recipe.pieces}
    for module in built.modules.values():
        for example in module.examples:
            piece = pieces[module.name, example.clip.name]
            if piece.distance:
                asked = piece.distance * np.exp(1j * np.radians(piece.angle))
                got = example.values[1] * np.exp(1j * example.values[0])
                assert abs(asked - got) < 0.02
                checked += 1
    assert checked > 20


def test_pieces_that_are_not_in_the_file_are_said(folder):
    source = load_source(folder, "walk.bvh", FIGURE)
    with pytest.raises(RecipeError, match="keys up to 99"):
        example_of(Piece("locomotion", "late", "walk.bvh", (96.0, 97.0, 98.0, 98.5, 99.0)), source)
    with pytest.raises(RecipeError, match="loop"):
        example_of(Piece("stand", "late", "walk.bvh", (0.0, 2.0), loop=(50.0, 60.0), back=True), source)


def test_a_folder_without_captures_is_said(tmp_path):
    with pytest.raises(MotionSetError, match=r"no \.bvh or \.amc"):
        plan(tmp_path, FIGURE)
    (tmp_path / "a.bvh").write_text("no")
    with pytest.raises(MotionSetError, match="no file could be used"):
        plan(tmp_path, FIGURE)


@needs_mocap
def test_real_captures_fill_every_module(tmp_path):
    planned = plan(MOCAP / "clips", FIGURE)
    built = make(planned.recipe, MOCAP / "clips", FIGURE)
    built.save(tmp_path / "set.npz")
    assert (tmp_path / "set.npz").stat().st_size < 2_000_000
    counts = {"locomotion": 12, "stand": 6, "step_left": 10, "step_right": 10, "jump_forward": 6, "jump_left": 4,
              "jump_right": 4, "jump_up": 2, "turn_left": 4, "turn_right": 4}  # fmt: skip
    for name, least in counts.items():
        assert len(built.module(name).examples) >= least, name
    flawed = {"duck_dg025", "duck_dg031", "liedown_dg011", "stand_8609", "lookaround_8609", "dm_run"}
    assert not flawed & {Path(piece.file).stem for piece in planned.recipe.pieces}
    for example in built.module("locomotion").examples:
        m = measure(example.clip, example.contacts)
        assert 0.4 < example.duration < 2.3
        assert m.foot_skate < 0.5
        if not example.clip.name.endswith("_in_place"):  # its feet are drawn in, lifted less and come down flatter
            assert abs((contacts(example.clip) == example.contacts).mean()) > 0.8
