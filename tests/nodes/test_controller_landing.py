"""A foot that is let go comes down to the ground, wherever it was, and both feet carry the figure."""

import numpy as np
import pytest

from bunraku.figure.fk import fk
from bunraku.figure.wire import from_message
from bunraku.msgs import Target
from bunraku.nodes.controller.node import Controller
from bunraku.runtime.memory import MemoryStage

SOON = 0.9
"""s in which a foot that was let go stands again: about a person's, whose leg swings through in 0.4 s and more."""
ANKLE = np.array([-0.095, 0.085, 0.0])


@pytest.mark.parametrize(
    "place", [(0.0, 0.11, 0.25), (-0.1, 0.3, 0.3), (-0.3, 0.3, -0.4), (0.1, 0.3, 0.4), (-0.6, 0.4, 0.0)]
)
def test_a_released_foot_is_planted_again(place: tuple[float, float, float]) -> None:
    stage = MemoryStage()
    stage.add(Controller)
    skeleton = from_message(stage.last("skeleton"))
    foot = skeleton.role("rightFoot")
    for k in range(40):
        share = (k + 1) / 40
        lifted = ANKLE + (np.array(place) - ANKLE) * share + [0.0, 0.2 * np.sin(np.pi * share), 0.0]
        stage.publish("target", Target(right_foot=(float(lifted[0]), float(lifted[1]), float(lifted[2]))))
        stage.advance(1 / 60)
    assert not stage.last("pose").contacts.right_foot
    stage.publish("target", Target())
    within = 0
    while not stage.last("pose").contacts.right_foot:
        within += 1
        assert within < SOON * 60
        stage.advance(1 / 60)
    stage.advance(0.5)
    pose = stage.last("pose")
    positions, _ = fk(skeleton, pose.root.astype(float), pose.rotations.astype(float))
    assert pose.contacts.right_foot
    assert pose.contacts.left_foot
    assert positions[foot, 1] == pytest.approx(ANKLE[1], abs=0.002)
