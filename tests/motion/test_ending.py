"""The last step of a walk ends where its path ends, and when it does."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bunraku.motion.ending import braked, cadence_of, last_steps, room_of, speed_at, steps_left
from bunraku.motion.player import PACE, Player, path_of
from bunraku.motion.synth import builtin_set
from bunraku.motion.voice import voices

DT = 1.0 / 60.0
SET = builtin_set()
CADENCE = cadence_of(voices(SET)["locomotion"], PACE.most, PACE.brake)
LENGTHS = np.arange(1.0, 3.51, 0.1)


def _walk(player: Player, length: float, speed: float) -> tuple[float, float, float, np.ndarray]:
    """s from coming within 1 cm of the end: last lift, last footfall, standing; and the speeds (m/s) along."""
    player.reset()
    count = int(length / 0.02) + 1
    line = np.stack([np.zeros(count), np.linspace(0.0, length, count)], -1)
    player.follow(path_of(line, 0.0, np.full(count, speed)), complete=True)
    before, lift, fall, arrived = player.contacts.copy(), 0.0, 0.0, None
    places = [0.0]
    for frame in range(1200):
        player.update(DT)
        now = frame * DT
        change = player.contacts - before
        before = player.contacts.copy()
        lift, fall = (now if (change < 0).any() else lift), (now if (change > 0).any() else fall)
        places.append(player.place.z)
        if arrived is None and player.place.z >= length - 0.01:
            arrived = now
        if player.free:
            break
    assert arrived is not None
    assert player.place.z == pytest.approx(length, abs=2e-3)
    return lift - arrived, fall - arrived, now - arrived, np.diff(places) / DT


@pytest.mark.parametrize("speed", [0.5, 0.7, 1.0, 1.3, 1.8, 2.6, 3.4])
def test_a_whole_number_of_steps_ends_with_the_path(speed):
    player = Player(SET)
    for length in LENGTHS:
        lift, fall, stood, speeds = _walk(player, float(length), speed)
        assert lift < 0.1, f"a foot was lifted {lift:.2f} s after the end of {length:.1f} m"
        assert fall < 0.25, f"the last footfall came {fall:.2f} s after the end of {length:.1f} m"
        assert stood < 0.3
        assert speeds.max() < 1.25 * speed + 0.05
        assert np.diff(speeds)[:-1].min() / DT > -5.0


def test_steps_are_made_longer_or_shorter_to_fit():
    """Figure 11: of lengths over one step's length, some are walked faster and some slower than asked."""
    player = Player(SET)
    tops = [_walk(player, float(length), 1.3)[3].max() for length in np.arange(2.0, 3.4, 0.1)]
    assert max(tops) > 1.33
    late = [_walk(player, float(length), 1.3)[3][-70:-45].mean() for length in np.arange(2.0, 3.4, 0.1)]
    assert min(late) < 1.2 < 1.33 < max(late)


@given(st.floats(0.0, 6.0), st.floats(0.3, 6.0))
def test_braking_distance_is_the_inverse_of_the_speed_before_the_end(room, brake):
    assert room_of(speed_at(room, brake), brake) == pytest.approx(room, abs=1e-9)


@given(st.floats(0.2, 4.0), st.floats(1.0, 3.0))
def test_braking_ends_where_the_room_does(speed, more):
    left, now = more * room_of(speed, PACE.brake), speed
    for _ in range(4000):
        now = braked(now, 0.01, left, PACE.brake, DT)
        left -= now * DT
        if left < 1e-3:
            break
    assert -2e-3 < left < 1e-3
    assert now < 0.2


@pytest.mark.parametrize("speed", [0.4, 0.8, 1.3, 2.0, 3.0])
def test_counts_the_steps_of_braking(speed):
    """Against the integral of the cadence over the time that it takes."""
    room = room_of(speed, PACE.brake)
    seconds, steps = 2e-3, 0.0
    left, now = room, speed
    while left > 1e-4 and now > 0.02:
        steps += CADENCE.rate(now) * seconds
        left -= now * seconds
        now = speed_at(max(left, 0.0), PACE.brake)
    assert steps_left(CADENCE, room, speed, speed, PACE.start) == pytest.approx(steps, rel=0.05, abs=0.03)
    even = steps_left(CADENCE, room + 1.0, speed, speed, PACE.start)
    assert even - steps == pytest.approx(CADENCE.rate(speed) / speed, rel=0.05, abs=0.1)


@given(st.floats(0.05, 4.0), st.floats(0.0, 3.5), st.floats(0.3, 3.5), st.floats(0.0, 1.0))
def test_what_speed_and_cadence_are_multiplied_by_is_bounded_and_fits(room, speed, wanted, step):
    share, rate, more = last_steps(CADENCE, room, speed, wanted, PACE.start, step)
    assert 0.8 <= share <= 1.23
    assert more >= 0
    steps = steps_left(CADENCE, room, speed, share * wanted, PACE.start)
    if steps > 1.5:
        assert rate * steps == pytest.approx(step + more)
        assert 0.6 < rate < 1.5
