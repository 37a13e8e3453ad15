"""Which joints a command's body parts are."""

from bunraku.figure.skeleton import Skeleton

_ARM = ("Shoulder", "UpperArm", "LowerArm", "Hand")
_LEG = ("UpperLeg", "LowerLeg", "Foot", "Toes")
_BACK = ("spine", "chest", "upperChest")
_PARTS: dict[str, tuple[str, ...]] = {
    "left_arm": tuple("left" + part for part in _ARM),
    "right_arm": tuple("right" + part for part in _ARM),
    "left_leg": tuple("left" + part for part in _LEG),
    "right_leg": tuple("right" + part for part in _LEG),
    "trunk": _BACK,
    "head": ("neck", "head"),
}
_PARTS["lower"] = ("hips", *_PARTS["left_leg"], *_PARTS["right_leg"])
_PARTS["upper"] = (*_PARTS["left_arm"], *_PARTS["right_arm"], *_BACK, *_PARTS["head"])
WALKS = {"whole", "lower", "left_leg", "right_leg"}
"""A command that takes the figure somewhere moves at least one of these."""


def joints_of(skeleton: Skeleton, body: list[str]) -> list[int] | None:
    """The joints that a command's ``body`` names; None for all."""
    if "whole" in body:
        return None
    return [skeleton.roles[role] for part in body for role in _PARTS[part] if role in skeleton.roles]
