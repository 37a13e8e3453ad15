import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.default import default_figure
from bunraku.motion.clip import Clip
from bunraku.motion.motionset import Example, Module, MotionSet, MotionSetError


def _example(name: str = "a", frames: int = 5, value: float = 1.0, cycle: bool = False) -> Example:
    figure = default_figure()
    rng = np.random.default_rng(frames)
    rotations = rng.normal(size=(frames, len(figure), 4))
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    clip = Clip(name, figure, 60.0, rng.normal(size=(frames, 3)), rotations)
    contacts = rng.random((frames, 2)) < 0.5
    return Example(clip, np.array([value]), np.array([0.0, 1 / 60, (frames - 1) / 60]), contacts, cycle, True)


def _set() -> MotionSet:
    module = Module("jump_up", ("height",), (_example("low", 5, 0.1), _example("high", 9, 0.5)))
    return MotionSet("test", default_figure(), {"jump_up": module}, {"walk": _example("walk", 7, 1.2, True)})


def test_a_saved_set_reads_back(tmp_path):
    path = tmp_path / "folder" / "set.npz"
    _set().save(path)
    read = MotionSet.load(path)
    assert read.skeleton.hash == default_figure().hash
    assert read.skeleton.masses.sum() == default_figure().masses.sum()
    assert list(read.modules) == ["jump_up"]
    assert read.module("jump_up").values.ravel().tolist() == [0.1, 0.5]
    for before, after in zip(_set().examples(), read.examples(), strict=True):
        assert after.clip.name == before.clip.name
        np.testing.assert_allclose(after.clip.roots, before.clip.roots, atol=1e-6)
        np.testing.assert_allclose(after.clip.rotations, before.clip.rotations, atol=1e-4)
        np.testing.assert_array_equal(after.contacts, before.contacts)
        np.testing.assert_array_equal(after.keys, before.keys)
        assert (after.cycle, after.made) == (before.cycle, before.made)
    assert not list(path.parent.glob("*.part"))


def test_what_is_read_is_saved_the_same():
    data = _set().to_bytes()
    again = MotionSet.from_bytes(data).to_bytes()
    once = MotionSet.from_bytes(again)
    for before, after in zip(MotionSet.from_bytes(data).examples(), once.examples(), strict=True):
        np.testing.assert_allclose(after.clip.rotations, before.clip.rotations, atol=4e-5)


def test_a_missing_file_is_one_line(tmp_path):
    with pytest.raises(MotionSetError, match=r"cannot read .*nothing\.npz: No such file") as caught:
        MotionSet.load(tmp_path / "nothing.npz")
    assert "\n" not in str(caught.value)


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=64), st.integers(0, 10**9), st.integers(0, 3))
def test_a_broken_file_is_one_line_and_never_crashes(junk, position, how):
    data = bytearray(_set().to_bytes())
    position %= len(data)
    if how == 0:
        data = bytearray(junk)
    elif how == 1:
        data = data[:position]
    elif how == 2:
        data[position] ^= 0xFF
    else:
        data[position:position] = junk
    message = "x.npz: read after all"
    try:
        MotionSet.from_bytes(bytes(data), "x.npz")
    except MotionSetError as error:
        message = str(error)
    assert message.startswith("x.npz: ")
    assert "\n" not in message


def test_examples_that_do_not_fit_are_refused():
    with pytest.raises(MotionSetError, match="no example"):
        Module("m", ("height",), ())
    with pytest.raises(MotionSetError, match="1 values for 2 parameters"):
        Module("m", ("a", "b"), (_example(),))
    with pytest.raises(MotionSetError, match="cannot be blended"):
        Module("m", ("height",), (_example(cycle=True), _example()))
    clip = _example().clip
    with pytest.raises(MotionSetError, match="increasing"):
        Example(clip, np.array([1.0]), np.array([0.0, 0.0]), np.zeros((5, 2), bool))
    with pytest.raises(MotionSetError, match="must lie within"):
        Example(clip, np.array([1.0]), np.array([0.0, 9.0]), np.zeros((5, 2), bool))
    with pytest.raises(MotionSetError, match="shape"):
        Example(clip, np.array([1.0]), np.array([0.0, 0.01]), np.zeros((4, 2), bool))
    with pytest.raises(MotionSetError, match="has no module 'walk'"):
        _set().module("walk")
