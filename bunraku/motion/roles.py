"""VRM roles from the joint names and the tree of any humanoid file.

Limbs are told by words in the names (of the dialects of CMU/cgspeed, Daz, iClone and Character Creator,
Mixamo, Bandai Namco, Rokoko, MakeHuman, 3ds Max biped, Xsens, ASF), hips and back by where the limbs meet.
"""

import re
from collections.abc import Sequence

_WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
_ASF = re.compile(r"^([lr])(hipjoint|femur|tibia|foot|toes|clavicle|humerus|radius|wrist|hand|fingers|thumb)$")
_NO_ROLE = frozenset(
    (
        "twist",
        "roll",
        "nub",
        "end",
        "site",
        "pole",
        "ik",
        "ctrl",
        "helper",
        "target",
        "finger",
        "fingers",
        "thumb",
        "index",
        "ring",
        "pinky",
        "middle",
        "mid",
        "little",
        "eye",
        "jaw",
        "breast",
        "hair",
        "tongue",
        "share",
        "top",
        "effector",
        "teeth",
        "tear",
        "weapon",
        "prop",
        "tail",
        "skirt",
    )
)
_LIMB_WORDS = {
    "UpperLeg": ("thigh", "upleg", "upperleg", "femur", "legupper", "legup"),
    "LowerLeg": ("shin", "calf", "lowleg", "loleg", "lowerleg", "tibia", "knee", "leglower", "leglow", "foreleg"),
    "Foot": ("foot", "ankle", "feet"),
    "Toes": ("toe", "toes", "toebase", "ball", "toe0"),
    "Shoulder": ("collar", "clavicle", "shoulder"),
    "UpperArm": ("uparm", "upperarm", "humerus", "shldr", "armupper"),
    "LowerArm": ("elbow", "forearm", "lowerarm", "lowarm", "loarm", "radius", "armlower"),
    "Hand": ("hand", "wrist"),
}
_ROLE_OF_WORD = {word: role for role, words in _LIMB_WORDS.items() for word in words}
_CHAIN = {"Leg": ("UpperLeg", "LowerLeg", "Foot", "Toes"), "Arm": ("Shoulder", "UpperArm", "LowerArm", "Hand")}


def words_of(name: str) -> list[str]:
    """The lower-case words of a joint's name, without the name of the character or the exporter before it."""
    name = name.rsplit(":", 1)[-1]
    name = re.sub(
        r"^(CC_Base_|RL_|Character\d+_|Bip\d+[ _]|mixamorig\d*_?|joint_|Robot_|Armature_|b_|ValveBiped_)", "", name
    )
    match = _ASF.match(name)
    if match:
        return [match[1], match[2]]
    return [word.lower() for word in _WORD.findall(name)]


def _side_and_word(name: str) -> tuple[str, str, bool]:
    """The side ("left", "right" or ""), the rest of the words run together without numbers, and whether it counts."""
    words = words_of(name)
    side = ""
    rest = []
    for word in words:
        if not side and word in ("left", "l"):
            side = "left"
        elif not side and word in ("right", "r"):
            side = "right"
        elif not word.isdigit():
            rest.append(word)
    if not side and rest:  # "lthigh", "leftupleg"
        for prefix, value in (("left", "left"), ("right", "right"), ("l", "left"), ("r", "right")):
            tail = rest[0].removeprefix(prefix)
            if tail != rest[0] and (tail in _ROLE_OF_WORD or tail in ("leg", "arm", "hip")):
                side, rest = value, [tail, *rest[1:]]
                break
    return side, "".join(rest), not any(word in _NO_ROLE for word in rest)


def roles_of(names: Sequence[str], parents: Sequence[int]) -> dict[str, int]:
    """VRM role -> joint for the joints whose part can be told; an empty table for what is no humanoid.

    Args:
        names: J joint names. parents: J indices, parents first, -1 for the root.
    """
    above = [_ancestors(joint, parents) for joint in range(len(names))]
    described = [_side_and_word(name) for name in names]
    roles: dict[str, int] = {}
    for side in ("left", "right"):
        mine = [(joint, word) for joint, (its, word, counts) in enumerate(described) if its == side and counts and word]
        named: dict[str, list[int]] = {}
        for joint, word in mine:
            role = _ROLE_OF_WORD.get(word.removesuffix("joint")) or _ROLE_OF_WORD.get(word)
            if role:
                named.setdefault(role, []).append(joint)
        _name_the_rest(mine, named, above)
        for chain in _CHAIN.values():
            for role in chain:
                found = named.get(role, [])
                if role == "Hand" and len(found) > 1:
                    # A wrist before the hand is the lower half of the forearm (ASF).
                    found = [j for j in found if described[j][1] != "wrist"] or found
                if found:
                    roles[side + role] = found[0]
    middle = [(joint, word) for joint, (side, word, counts) in enumerate(described) if not side and counts]
    for role in ("head", "neck"):
        for joint, word in middle:
            if word in (role, f"{role}bone"):
                roles[role] = joint
                break
    _find_trunk(names, parents, above, roles)
    return roles


def _ancestors(joint: int, parents: Sequence[int]) -> list[int]:
    chain = []
    while joint >= 0:
        chain.append(joint)
        joint = parents[joint]
    return chain


def _name_the_rest(mine: list[tuple[int, str]], named: dict[str, list[int]], above: list[list[int]]) -> None:
    """The words that mean one thing or another according to which others are there."""
    for joint, word in mine:
        if word == "leg":
            named.setdefault("LowerLeg" if "UpperLeg" in named else "UpperLeg", []).append(joint)
        elif word == "arm":
            named.setdefault("UpperArm" if "LowerArm" in named or "UpperArm" not in named else "LowerArm", []).append(
                joint
            )
        elif word in ("hip", "hips") and "UpperLeg" not in named:
            named["UpperLeg"] = [joint]
    if "UpperArm" not in named and "Shoulder" in named:
        # "LeftShoulder, LeftElbow": joints named by their place; "LeftCollar, LeftShoulder, LeftElbow" too.
        shoulders = named.pop("Shoulder")
        named["UpperArm"] = shoulders[-1:]
        if len(shoulders) > 1:
            named["Shoulder"] = shoulders[:1]
    if len(named.get("UpperArm", [])) > 1 and "Shoulder" not in named:
        first, second = named["UpperArm"][:2]
        if first in above[second] and "LowerArm" not in named:
            named["UpperArm"], named["LowerArm"] = [first], [second]


def _find_trunk(names: Sequence[str], parents: Sequence[int], above: list[list[int]], roles: dict[str, int]) -> None:
    """Hips where the legs meet the back, the back from there to where the arms meet."""
    legs = [roles[key] for key in ("leftUpperLeg", "rightUpperLeg") if key in roles]
    tops = [roles[key] for key in ("leftUpperArm", "rightUpperArm", "neck", "head") if key in roles]
    if len(legs) < 2 or not tops:
        roles.clear()
        return
    hips = _common([*legs, *tops], above)
    if hips < 0:
        roles.clear()
        return
    roles["hips"] = hips
    arms = [roles[key] for key in ("leftUpperArm", "rightUpperArm") if key in roles] or tops[:1]
    chest = _common([*arms, *tops], above)
    if "neck" not in roles and "head" in roles:
        chain = [j for j in above[roles["head"]][1:] if chest in above[j] and j != chest]
        if chain:
            roles["neck"] = chain[-1]
    # A side joint or the neck cannot be part of the back.
    taken = {joint for role, joint in roles.items() if role != "hips"}
    back = [joint for joint in reversed(above[chest]) if hips in above[joint] and joint != hips and joint not in taken]
    if len(back) == 1:
        roles["spine"] = back[0]
    elif len(back) == 2:
        roles["spine"], roles["chest"] = back
    elif back:
        roles["spine"], roles["upperChest"] = back[0], back[-1]
        roles["chest"] = back[len(back) // 2]


def _common(joints: list[int], above: list[list[int]]) -> int:
    """The lowest joint that all of ``joints`` hang from (which may be one of them); -1 for none."""
    shared = set(above[joints[0]]).intersection(*(above[joint] for joint in joints[1:]))
    return max(shared, key=lambda joint: len(above[joint]), default=-1)
