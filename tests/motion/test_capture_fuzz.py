"""Whatever bytes a capture file holds: a clip or one line with the line's number, in little memory and soon."""

import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bunraku.motion.asf import parse_amc, parse_asf, read_amc
from bunraku.motion.bvh import bvh_text, parse_bvh, read_bvh
from bunraku.motion.capture import CaptureError, interpret
from bunraku.motion.synth import builtin_set

MEMORY = 60_000_000
"""bytes that a broken file of a few hundred kB may cost at most while it is read"""
SECONDS = 20.0
"""of the processor that one file may take: whole ones take hundredths, the worst below less than one"""


def _asf() -> str:
    legs = ""
    links = "root lfemur rfemur spine\nspine head larm rarm\n"
    for side, x in (("l", 1), ("r", -1)):
        for name, direction, dof in (("femur", (0.1 * x, -1, 0), "rx ry rz"), ("tibia", (0, -1, 0), "rx"),
                                     ("foot", (0, 0, 1), "rx")):  # fmt: skip
            legs += f"begin\nid 1\nname {side}{name}\ndirection {direction[0]} {direction[1]} {direction[2]}\n"
            legs += f"length 7\naxis 0 0 0 XYZ\ndof {dof}\nend\n"
        legs += f"begin\nid 1\nname {side}arm\ndirection {x} 0 0\nlength 9\naxis 0 0 0 XYZ\ndof rx ry rz\nend\n"
        links += f"{side}femur {side}tibia\n{side}tibia {side}foot\n"
    for name in ("spine", "head"):
        legs += f"begin\nid 1\nname {name}\ndirection 0 1 0\nlength 8\naxis 0 0 0 XYZ\ndof rx ry rz\nend\n"
    head = ":version 1.10\n:name T\n:units\nmass 1.0\nlength 0.45\nangle deg\n:root\norder TX TY TZ RX RY RZ\n"
    head += "axis XYZ\nposition 0 0 0\norientation 0 0 0\n"
    return f"{head}:bonedata\n{legs}:hierarchy\nbegin\n{links}end\n"


def _amc() -> str:
    out = ":FULLY-SPECIFIED\n:DEGREES\n"
    for frame in range(1, 7):
        out += f"{frame}\nroot 0 16 {frame} 0 0 0\nlfemur {3 * frame} 0 0\nltibia {frame}\nlfoot 0\nrfemur 0 0 0\n"
        out += "rtibia 3\nrfoot 0\nspine 0 0 0\nhead 0 0 0\nlarm 0 0 9\nrarm 0 0 -9\n"
    return out


GOOD = bvh_text(builtin_set().canonical["walk"].clip.slice(0, 12))
ASF, AMC = _asf(), _amc()
WORDS = [
    *("nan", "NaN", "inf", "-inf", "1e400", "-1e308", "9" * 400, "1" + "0" * 5000, "-", "+", ".", "1e", "0x10", "1_0"),
    *("\uff11\uff12", "{", "}", "\n", "\r\n", "\t", "\0", "\x1a", "\ufeff", "\u2028", "\u00e9", "\U0001f600"),
    *("MOTION", "HIERARCHY", "ROOT r", "JOINT j", "End Site", "OFFSET", "OFFSET 1 2", "CHANNELS 6"),
    *("CHANNELS -1 Xrotation", "CHANNELS 999999999999 Xrotation", "Frames:", "Frames: -5", "Frames: 1e9"),
    *(f"Frames: {10**18}", "Frame Time: 0", "Frame Time: -1", "Frame Time: nan", "Frame Time: 1e-300"),
    *(":units", "length 0", "length nan", ":bonedata", "begin", "end", "dof rx rx rx rx", "dof qq", "axis 0 0"),
    *("direction 0 0 0", "root", "999999999999", "-3", "lfemur", "lfemur 1 2 3 4", ":hierarchy", "lfemur root"),
    "spine spine",
]


def one_line(call) -> None:
    """A result that is finite, or an error of one line with a line number, in bounded memory and time."""
    tracemalloc.start()
    begun = time.process_time()
    try:
        clip = call()
    except CaptureError as error:
        text = str(error)
        assert len(text.splitlines()) == 1
        assert len(text) < 400
        assert text.split(":")[1].split(" ")[0].isdigit() or "not a text file" in text, text
    else:
        assert np.isfinite(clip.world[0]).all()
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < MEMORY
    assert time.process_time() - begun < SECONDS


@st.composite
def damaged(draw, text: str) -> str:
    """A good text after a few cuts, repeats, swaps and words that do not belong."""
    lines = text.split("\n")
    for _ in range(draw(st.integers(1, 4))):
        kind = draw(st.sampled_from(["cut", "drop", "word", "number", "repeat", "swap", "insert", "join"]))
        k = draw(st.integers(0, len(lines) - 1))
        if kind == "cut":  # the file ends in mid-line
            lines = [*lines[:k], lines[k][: draw(st.integers(0, 40))]]
        elif kind == "drop":
            del lines[k : k + draw(st.integers(1, 6))]
        elif kind == "word":
            at = draw(st.integers(0, len(lines[k])))
            lines[k] = lines[k][:at] + draw(st.sampled_from(WORDS)) + lines[k][at:]
        elif kind == "number":
            words = lines[k].split(" ")
            words[draw(st.integers(0, len(words) - 1))] = draw(st.one_of(
                st.floats().map(repr), st.integers(-(10**20), 10**20).map(str), st.sampled_from(WORDS)))  # fmt: skip
            lines[k] = " ".join(words)
        elif kind == "repeat":
            lines[k:k] = lines[k : k + draw(st.integers(1, 4))] * draw(st.sampled_from([1, 2, 30]))
        elif kind == "swap":
            n = draw(st.integers(0, len(lines) - 1))
            lines[k], lines[n] = lines[n], lines[k]
        elif kind == "insert":
            lines.insert(k, draw(st.one_of(st.sampled_from(WORDS), st.text(max_size=30))))
        else:  # a very long line
            lines[k : k + 200] = [" ".join(lines[k : k + 200])]
        lines = lines or [""]
    return "\n".join(lines)


@given(damaged(GOOD))
@settings(max_examples=250, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_damaged_bvh(text):
    one_line(lambda: interpret(parse_bvh(text, "x.bvh")).clip)


@given(damaged(ASF), damaged(AMC), st.integers(0, 2))
@settings(max_examples=250, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_damaged_asf_and_amc(asf, amc, which):
    one_line(
        lambda: (
            interpret(
                parse_amc(AMC if which == 0 else amc, "x.amc", parse_asf(ASF if which == 1 else asf, "x.asf"))
            ).clip
        )
    )


@given(st.integers(0, 1000))
@settings(max_examples=120, deadline=None)
def test_files_cut_short(share):
    text = GOOD[: len(GOOD) * share // 1000]
    one_line(lambda: interpret(parse_bvh(text, "x.bvh")).clip)
    amc, asf = AMC[: len(AMC) * share // 1000], ASF[: len(ASF) * share // 1000]
    one_line(lambda: interpret(parse_amc(amc, "x.amc", parse_asf(ASF, "x.asf"))).clip)
    one_line(lambda: interpret(parse_amc(AMC, "x.amc", parse_asf(asf, "x.asf"))).clip)


@given(
    st.binary(max_size=2000),
    st.sampled_from(
        [b"", b"HIERARCHY\n", b"HIERARCHY\nROOT a\n{\n", GOOD[:3000].encode(), b"\xff\xfe", b"\xef\xbb\xbf"]
    ),
)
@settings(max_examples=150, deadline=None)
def test_garbage_in_files(tmp_path_factory, data, head):
    folder = tmp_path_factory.mktemp("garbage")
    for name in ("x.bvh", "x.amc", "x.asf"):
        (folder / name).write_bytes(head + data)
    one_line(lambda: read_bvh(folder / "x.bvh"))
    one_line(lambda: read_amc(folder / "x.amc"))


NUMBERS = GOOD.index("Frames:")
LAST = GOOD.rstrip("\n").rsplit("\n", 1)[-1]
HUGE = {
    "a count of 10^18 frames": (GOOD[:NUMBERS] + f"Frames: {10**18}\n" + GOOD[GOOD.index("Frame Time") :], True),
    "a count of 5000 digits": (GOOD[:NUMBERS] + f"Frames: {'9' * 5000}\n" + GOOD[GOOD.index("Frame Time") :], True),
    "a negative count": (GOOD[:NUMBERS] + "Frames: -1\n" + GOOD[GOOD.index("Frame Time") :], False),
    "a line of 400 kB": (GOOD.replace(LAST, LAST + " 1" * 200_000), None),
    "a word of 400 kB": (GOOD.replace(LAST, "1" * 400_000), None),
    "a name of 400 kB": (GOOD.replace("ROOT ", "ROOT " + "a" * 400_000, 1), None),
    "50,000 open braces": ("HIERARCHY\nROOT r\n" + "{\n" * 50_000, False),
    "50,000 closed braces": ("HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\n" + "}\n" * 50_000, False),
    "20,000 nested joints": ("HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\n" + "JOINT j\n{\nOFFSET 0 0 0\n" * 20_000, False),
    "a million empty lines": (GOOD.replace("MOTION", "\n" * 1_000_000 + "MOTION"), True),
    "no frames": (GOOD[: GOOD.index("Frame Time")] + "Frame Time: 0.01\n", False),
    "numbers of 10^300": (GOOD.replace(LAST, " ".join(["1e300"] * len(LAST.split()))), False),
}  # fmt: skip


@pytest.mark.parametrize("name", HUGE)
def test_claims_and_sizes_beyond_reason(name):
    text, good = HUGE[name]
    if good is None:
        one_line(lambda: interpret(parse_bvh(text, "x.bvh")).clip)
    elif good:
        begun = time.process_time()
        assert len(interpret(parse_bvh(text, "x.bvh")).clip) in (11, 12)
        assert time.process_time() - begun < SECONDS
    else:
        with pytest.raises(CaptureError) as caught:
            interpret(parse_bvh(text, "x.bvh"))
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 400


@pytest.mark.parametrize("amc", [
    AMC + f"{10**18}\nroot 0 0 0 0 0 0\n", AMC.replace("\n3\n", "\n9\n"), AMC + "7\n" * 20_000,
    AMC + "7\nroot " + "1 " * 200_000, AMC.replace("lfemur 3 0 0", "lfemur 1e300 1e300 1e300"), AMC + "7\nnobone 1\n",
])  # fmt: skip
def test_amc_claims_beyond_reason(amc):
    one_line(lambda: interpret(parse_amc(amc, "x.amc", parse_asf(ASF, "x.asf"))).clip)


def test_a_long_chain_of_bones_does_not_exhaust_the_stack():
    count = 5000
    bones = "".join(f"begin\nname b{k}\ndirection 0 1 0\nlength 1\naxis 0 0 0 XYZ\nend\n" for k in range(count))
    links = "root b0\n" + "".join(f"b{k} b{k + 1}\n" for k in range(count - 1))
    text = f":units\nlength 0.45\nangle deg\n:bonedata\n{bones}:hierarchy\nbegin\n{links}end\n"
    with pytest.raises(CaptureError):
        parse_asf(text, "x.asf")


def test_a_root_below_another_bone_is_said():
    with pytest.raises(CaptureError, match="the root is put below 'spine'"):
        parse_asf(ASF.replace("spine head", "spine root"), "x.asf")
