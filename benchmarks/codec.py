"""Encoding and decoding a pose, validated, beside plain msgpack with lists and json.

python benchmarks/codec.py
"""

import json
import timeit
from collections.abc import Callable

import msgpack
import numpy as np

from bunraku.msgs import Pose


def best(function: Callable[[], object], number: int = 5000) -> float:
    """µs a call, the best of seven."""
    return min(timeit.repeat(function, number=number, repeat=7)) / number * 1e6


def main() -> None:
    rotations = np.random.default_rng(1).normal(size=(22, 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    pose = Pose(skeleton="a" * 16, root=[0.1, 0.9, 0.2], rotations=rotations, stamp=1, origin=2, seq=3)
    lists = {"skeleton": "a" * 16, "root": [0.1, 0.9, 0.2], "rotations": rotations.tolist(), "stamp": 1, "seq": 3}
    rows = {
        "bunraku.msgs": (pose.encode(), pose.encode, Pose.decode),
        "msgpack, lists, nothing checked": (msgpack.packb(lists), lambda: msgpack.packb(lists), msgpack.unpackb),
        "json, lists, nothing checked": (json.dumps(lists).encode(), lambda: json.dumps(lists), json.loads),
    }
    print(f"{'a pose of 22 joints':34}{'encode µs':>10}{'decode µs':>10}{'bytes':>7}")
    for name, (body, encode, decode) in rows.items():
        print(f"{name:34}{best(encode):10.2f}{best(lambda d=decode, b=body: d(b)):10.2f}{len(body):7}")


if __name__ == "__main__":
    main()
