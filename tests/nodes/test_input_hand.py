"""The hands' node: what the page's sliders or a written performance do arrives as `hands` messages."""

from pathlib import Path

import pytest

from bunraku.msgs import Event, Hand
from bunraku.nodes.input_hand.node import InputHand
from bunraku.nodes.input_hand.performance import PerformanceError, load
from bunraku.runtime.memory import MemoryStage


def test_slider_made_samples_arrive_as_they_were_made() -> None:
    stage = MemoryStage()
    stage.add(InputHand)
    left = Hand(position=(0.5, -0.5, -1.0), bend=(0.0, 0.1, 0.2, 0.3, 0.4))
    right = Hand(position=(-1.0, 0.0, 1.0), bend=(0.0, -0.1, -0.2, -0.3, -1.0))
    stage.publish("web/events", Event(device="web-ab", kind="hands", left=left, right=right), origin=10**18)
    hands = stage.last("hands")
    assert (hands.device, hands.origin) == ("web-ab", 10**18)
    assert hands.left == left
    assert hands.right == right
    device = stage.last("device/web_ab_hand")
    assert (device.kind, device.bend_unit, device.connected) == ("hand", "normalised", True)


def test_hands_are_not_seen_when_their_page_is_gone_or_silent() -> None:
    stage = MemoryStage()
    stage.add(InputHand, lost=1.0)
    one = Hand(bend=(0.0, 0.0, 0.0, 0.0, 0.0))
    stage.publish("web/events", Event(device="web-ab", kind="hands", left=one, right=one))
    stage.publish("web/events", Event(device="web-ab", kind="gone"))
    assert stage.last("hands").left is None
    assert stage.last("hands").right is None
    stage.publish("web/events", Event(device="web-cd", kind="hands", right=one))
    stage.advance(0.9)
    assert stage.last("hands").right is not None
    stage.advance(0.3)
    assert stage.last("hands").right is None
    count = len(stage.received("hands"))
    stage.advance(2.0)
    assert len(stage.received("hands")) == count


PERFORMANCE = """
[[move]]
hand = "right"
start = 0.5
position = [[0.0, 0, 0, 0], [1.0, 0.4, 0.2, -0.1]]
[[move]]
hand = "right"
start = 2.0
bend = [[0.0, 0, 0, 0, 0, 0], [0.5, 0, 1, 1, 0, 0]]
"""


def write(folder: Path, text: str) -> str:
    path = folder / "reach.hands"
    path.write_text(text)
    return str(path)


def test_a_written_performance_moves_a_hand_and_lets_go(tmp_path: Path) -> None:
    stage = MemoryStage()
    stage.add(InputHand, drivers=["script"], script=write(tmp_path, PERFORMANCE), wait_for="0", rate=50.0)
    stage.advance(3.0)
    said = stage.received("hands")
    assert stage.status == 0
    assert said[0].right.position == (0.0, 0.0, 0.0)
    assert said[0].left is None
    before = said[round(1.9 * 50)]
    assert before.right.position == pytest.approx((0.4, 0.2, -0.1))
    assert before.right.bend == (0.0,) * 5
    after = said[-2]
    assert after.right.position == pytest.approx((0.4, 0.2, -0.1))
    assert after.right.bend == pytest.approx((0.0, 1.0, 1.0, 0.0, 0.0), abs=0.05)
    assert said[-1].right is None


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "1 to 256"),
        ('unit = "furlong"', "unit is one of"),
        ('[[move]]\nhand = "middle"', "left or right"),
        ('[[move]]\nhand = "left"', "position, bend or both"),
        ('[[move]]\nhand = "left"\nbend = [[0.0, 1]]', "rows of 6"),
        ('[[move]]\nhand = "left"\nbend = [[0.0, 1, 1, 1, 1, nan]]', "rise"),
        ('[[move]]\nhand = "left"\nstart = -1\nbend = [[0.0, 1, 1, 1, 1, 1]]', "start is"),
    ],
)
def test_a_performance_that_cannot_be_played_says_why(tmp_path: Path, text: str, why: str) -> None:
    with pytest.raises(PerformanceError, match=why):
        load(write(tmp_path, text))
