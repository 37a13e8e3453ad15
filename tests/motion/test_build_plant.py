"""Feet that slide while they stand are held on one print each."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.default import default_figure
from bunraku.motion import build_edit as edit
from bunraku.motion.analysis_contacts import foot_skate, runs
from bunraku.motion.build_plant import planted, prints
from bunraku.motion.synth import builtin_set

FIGURE = default_figure()


GENERATED = builtin_set(FIGURE)
CYCLES = {
    name: GENERATED.canonical.get(name)
    or next(e for e in GENERATED.module("locomotion").examples if e.clip.name == name)
    for name in ("walk", "run", "walk_left")
}


def sliding(example, wide, along):
    """The example with feet that drift outward (m) and ahead over each stance, and back in the air."""
    clip = example.clip
    ankles, feet = edit.feet_of(clip)
    share = np.arange(len(clip)) / (len(clip) - 1)
    for foot, sign in ((0, 1.0), (1, -1.0)):
        wave = np.cos(2.0 * np.pi * (share - 0.5 * foot))
        ankles[:, foot, 0] += sign * wide * wave
        ankles[:, foot, 2] += along * np.sin(2.0 * np.pi * (share - 0.5 * foot))
    return edit.with_legs(clip, ankles, feet)


def apart(clip, flags):
    """(stances, 2) m: the print of each whole stance, and the largest distance (m) of any frame's from it."""
    marks = prints(clip)
    places, worst = [], 0.0
    for foot in range(2):
        for first, last in runs(flags[:, foot]):
            span = marks[first:last, foot]
            places.append(span.mean(axis=0))
            worst = max(worst, float(np.linalg.norm(span - span.mean(axis=0), axis=1).max()))
    return np.array(places), worst


def test_a_generated_walk_rolls_about_its_prints():
    """So `prints` says where the foot would be flat, whatever it is pitched by."""
    for name in ("walk", "run", "march"):
        example = GENERATED.canonical[name]
        assert apart(example.clip, example.contacts)[1] < 2e-3


@given(wide=st.floats(-0.02, 0.02), along=st.floats(-0.02, 0.02), name=st.sampled_from(sorted(CYCLES)))
@settings(max_examples=12, deadline=None)
def test_sliding_feet_of_a_cycle_are_held(wide, along, name):
    example = CYCLES[name]
    slid = edit.closed(sliding(example, wide, along))
    still = planted(slid, example.contacts, cycle=True)
    assert len(still) == len(slid)
    assert apart(still, example.contacts)[1] < 2e-3
    # What is no leg stays (but that the hips may come down for a leg that became too short), and it goes on as a loop.
    others = [j for j, n in enumerate(FIGURE.names) if "leg" not in n and "foot" not in n and "toe" not in n]
    assert np.abs(np.abs(np.sum(still.rotations[:, others] * slid.rotations[:, others], -1)) - 1.0).max() < 1e-6
    assert np.abs(still.roots - slid.roots)[:, [0, 2]].max() < 1e-6
    assert edit.gap(still, 0, len(still) - 1) < 1e-6
    # A stance that goes over the cycle's end is one stance: held at both ends of the clip on the same print.
    again = edit.repeated(still, 2)
    flags = np.concatenate([example.contacts, example.contacts[1:]])
    assert apart(again, flags)[1] < 2e-3


def test_the_print_is_where_the_foot_stood_on_average():
    example = GENERATED.canonical["short_jump"]
    slid = sliding(example, 0.015, 0.01)
    still = planted(slid, example.contacts)
    before, after = apart(slid, example.contacts), apart(still, example.contacts)
    assert before[1] > 0.01 > 2e-3 > after[1]
    assert np.abs(before[0] - after[0]).max() < 1e-3
    assert foot_skate(still, example.contacts) < 0.5 * foot_skate(slid, example.contacts)


def test_a_clip_that_never_stands_stays_as_it_is():
    clip = GENERATED.canonical["run"].clip
    never = np.zeros((len(clip), 2), dtype=np.bool_)
    still = planted(clip, never)
    assert np.abs(still.world[0] - clip.world[0]).max() < 1e-3
