"""Figures by name: the default one, or the body in a file."""

from pathlib import Path

from bunraku.figure.default import default_figure
from bunraku.figure.skeleton import Skeleton

DEFAULT = "default"


def figure_named(name: str) -> Skeleton:
    """The skeleton of a figure.

    Args:
        name: ``default``, or a file: a capture (.bvh, .amc), whose joints get masses and boxes that fit their bones,
            or a motion set (.npz), whose figure it is.

    Raises:
        ValueError: no such figure, or one without the limbs of a humanoid; one line with the remedy.
    """
    if name == DEFAULT:
        return default_figure()
    from bunraku.motion.capture import CaptureError
    from bunraku.motion.files import SUFFIXES, load_capture
    from bunraku.motion.motionset import MotionSet, MotionSetError

    path = Path(name)
    kind = path.suffix.lower()
    if kind not in (*SUFFIXES, ".npz"):
        raise ValueError(f"no figure is named {name!r}: give {DEFAULT}, or a .bvh, .amc or motion set (.npz) file")
    try:
        return MotionSet.load(path).skeleton if kind == ".npz" else load_capture(path).clip.skeleton
    except (CaptureError, MotionSetError) as error:
        raise ValueError(str(error)) from None
