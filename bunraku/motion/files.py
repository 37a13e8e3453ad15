"""Capture files of any kind, told by their names."""

from pathlib import Path

from bunraku.motion.asf import load_amc
from bunraku.motion.bvh import load_bvh
from bunraku.motion.capture import Capture, CaptureError

SUFFIXES = (".bvh", ".amc")


def load_capture(
    file: str | Path,
    *,
    asf: str | Path | None = None,
    fps: float | None = None,
    unit: float | None = None,
    up: str | None = None,
    root: str | None = None,
) -> Capture:
    """The clip in a BVH or AMC file; raises `CaptureError` with one line that says what is wrong.

    Args:
        asf, fps: for AMC files, see `bunraku.motion.asf.read_amc`. unit, up, root: see `bunraku.motion.bvh.read_bvh`.
    """
    path = Path(file)
    kind = path.suffix.lower()
    if kind == ".bvh":
        return load_bvh(path, unit=unit, up=up, root=root)
    if kind == ".amc":
        return load_amc(path, asf, fps=fps, unit=unit, up=up, root=root)
    raise CaptureError(f"{path.name}: neither a .bvh nor an .amc file")


def find_captures(folder: str | Path) -> list[Path]:
    """Every capture file below a folder, in order of their paths."""
    base = Path(folder)
    return sorted(p for p in base.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())
