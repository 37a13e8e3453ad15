"""A skeleton survives the wire with the hash that poses refer to."""

import numpy as np
import pytest

from bunraku.figure.default import default_figure
from bunraku.figure.skeleton import Skeleton, SkeletonError
from bunraku.figure.wire import from_message, to_message
from bunraku.msgs import SkeletonMessage


def test_round_trip_keeps_everything_and_the_hash() -> None:
    skeleton = default_figure()
    message = SkeletonMessage.decode(to_message(skeleton, figure="alice").encode())
    again = from_message(message)
    assert message.figure == "alice"
    assert again.hash == skeleton.hash
    assert again.names == skeleton.names
    assert dict(again.roles) == dict(skeleton.roles)
    for key in ("offsets", "masses", "mass_centers", "box_centers", "box_sizes"):
        np.testing.assert_allclose(getattr(again, key), getattr(skeleton, key), atol=1e-6)
    assert from_message(to_message(again)).hash == skeleton.hash


def test_hash_is_of_the_float32_offsets() -> None:
    base = default_figure()

    def moved(amount: float) -> Skeleton:
        offsets = np.array(base.offsets)
        offsets[1, 1] += amount
        return Skeleton(
            base.names, base.parents, offsets, base.roles, base.masses, base.mass_centers, base.box_centers,
            base.box_sizes,
        )  # fmt: skip

    assert moved(1e-12).hash == base.hash
    assert moved(1e-3).hash != base.hash


def test_rows_that_do_not_fit_are_refused_by_name() -> None:
    message = to_message(default_figure())
    message.masses = message.masses[:-1]
    with pytest.raises(SkeletonError, match="masses"):
        from_message(message)
