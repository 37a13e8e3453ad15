"""The controller without any process: targets, commands and motion in, poses out."""

from math import ceil

import numpy as np
from numpy.typing import NDArray

from bunraku.figure.boxes import collision_pairs
from bunraku.figure.fk import fk_into
from bunraku.figure.jit import kernel
from bunraku.figure.limits import limits_of
from bunraku.figure.mass import center_of_mass_into, upper_body_share
from bunraku.figure.pointpose import analyse_into, default_swivel, reconstruct_into
from bunraku.figure.quat import exp, inv_mul, log, mul
from bunraku.figure.rig import Rig, pack_rig, rig_of
from bunraku.figure.skeleton import Skeleton
from bunraku.figure.spring import spring_decay_into
from bunraku.figure.support import margin_in_hull
from bunraku.nodes.controller.contacts import Contacts, pack_contacts
from bunraku.nodes.controller.stack import advance_packed
from bunraku.nodes.controller.state import (
    HELD_SIZE,
    STATE_SIZE,
    Gains,
    under_size,
    unpack_held,
    unpack_state,
    unpack_under,
)

Array = NDArray[np.float64]

LONGEST = 1.0 / 55.0
"""s: longer steps are made of several."""
SHORT = 1.0 / 120.0
"""s: the same while anything is held or parts of the body touch, so that it goes the same way at every rate.
(Over a motion, whose frames come at a rate of their own, only while parts touch.)"""
MOST_TIME = 0.5
"""s that one step catches up at most (after a pause of the process)."""
FADE_HALF_LIFE = 0.15
"""s in which a change of what the stack lies over evens out."""
PARTS = ("pelvis", "left_hand", "right_hand", "left_foot", "right_foot")
HINGES = ("left_elbow", "right_elbow", "left_knee", "right_knee")


@kernel
def differences(a: Array, b: Array, out: Array) -> None:
    """Rotation vectors (J, 3) from orientations ``b`` (J, 4) to ``a`` (J, 4)."""
    q = np.empty(4)
    for joint in range(a.shape[0]):
        inv_mul(b[joint], a[joint], q)
        log(q, out[joint])


@kernel
def add_differences(vectors: Array, turns: Array) -> None:
    """Turn orientations (J, 4) by rotation vectors (J, 3), in place."""
    q = np.empty(4)
    for joint in range(turns.shape[0]):
        exp(vectors[joint], q)
        mul(turns[joint], q, turns[joint])


def contacts_of(skeleton: Skeleton, rig: Rig) -> Contacts:
    """Which boxes of each limb must keep out of which others."""
    pairs = collision_pairs(skeleton)
    rivals: dict[int, list[int]] = {}
    for a, b in pairs.tolist():
        rivals.setdefault(a, []).append(b)
        rivals.setdefault(b, []).append(a)
    parts = np.full((4, 4), -1, dtype=np.int64)
    for limb in range(4):
        chain = [int(j) for j in rig.limbs[limb]]
        if limb >= 2:
            chain += [j for j in range(len(skeleton)) if skeleton.parents[j] == chain[2]][:1]
        for n, joint in enumerate(chain):
            if rivals.get(joint):
                parts[limb, n] = joint
    widest = max((len(r) for r in rivals.values()), default=0)
    others = np.full((4, 4, max(widest, 1)), -1, dtype=np.int64)
    for limb in range(4):
        own = set(parts[limb].tolist())
        for n in range(4):
            if parts[limb, n] >= 0:
                rest = [j for j in rivals[int(parts[limb, n])] if j not in own]
                others[limb, n, : len(rest)] = rest
    return Contacts(parts, others, limits_of(skeleton))


class Stack:
    """One figure under control. `step` moves it by a time; all arrays are its own."""

    def __init__(self, skeleton: Skeleton, gains: Gains | None = None, place: Array | None = None, yaw: float = 0.0):
        """``place`` (3) m is where it stands on the ground, facing ``yaw`` (rad about +Y from +Z)."""
        self.skeleton = skeleton
        self.rig = rig_of(skeleton)
        self._switched = False
        self.rig_packed = pack_rig(self.rig)
        self.gains = gains or Gains()
        self.contacts = contacts_of(skeleton, self.rig)
        self.contacts_packed = pack_contacts(self.contacts)
        self.held_buffer = np.zeros(HELD_SIZE)
        self.held = unpack_held(self.held_buffer)
        self.held.turns[:, 3] = 1.0
        self.under_buffer = np.zeros(under_size(len(skeleton)))
        self.under = unpack_under(self.under_buffer, len(skeleton))
        self.lie_over_rest()
        self.mass_share = upper_body_share(skeleton)
        self.buffer = np.zeros(STATE_SIZE)
        self.state = unpack_state(self.buffer)
        joints = len(skeleton)
        self.rotations_ls = np.zeros((joints, 4))
        self.rotations_ls[:, 3] = 1.0
        self.positions_ws = np.array(self.rig.rest_positions)
        self.rotations_ws = self.rotations_ls.copy()
        self.hull = np.zeros((32, 2))
        self.hull_size = 0
        self.center = np.zeros(3)
        self.place = np.zeros(3) if place is None else np.asarray(place, dtype=np.float64)
        self.yaw = yaw
        self.fade, self.fade_rates, self.fading = np.zeros((joints, 3)), np.zeros((joints, 3)), 0.0
        self.reset()

    def reset(self) -> None:
        """Stand in the start pose."""
        self.buffer[:] = 0.0
        self.fading, self._switched = 0.0, False
        st = self.state
        st.heading[0] = self.yaw
        st.turns[:, 3] = st.goal_turns[:, 3] = st.target_turns[:, 3] = st.feet[:, 3] = 1.0
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        hips = self.rig.rest_positions[0]
        for side in range(2):
            x, _, z = self.rig.rest_positions[self.rig.limbs[2 + side, 2]] - hips
            st.points[3 + side] = self.place + np.array([c * x + s * z, self.rig.ankle_heights[side], c * z - s * x])
        st.feet_level[:] = 1.0
        self._settle()

    def _settle(self) -> None:
        for _ in range(3):
            self._advance(1.0 / 60.0)

    def hold(self, name: str, value: object | None) -> None:
        """Hold a part (m), an orientation (xyzw), the yaw (rad), an elbow or knee (m); None lets it go."""
        if name in PARTS:
            at, row, array = PARTS.index(name), PARTS.index(name), self.held.points
        elif name in HINGES:
            row = HINGES.index(name)
            at, array = 8 + row, self.held.hinges
        elif name in ("trunk", "head"):
            row = ("trunk", "head").index(name)
            at, array = 5 + row, self.held.turns
        elif name == "yaw":
            at, row, array = 7, 0, self.held.yaw
        else:
            raise ValueError(f"no part {name!r}")
        self.held.flags[at] = 0.0 if value is None else 1.0
        if value is not None:
            array[row] = np.asarray(value, dtype=np.float64)
            if name in ("trunk", "head"):
                array[row] /= max(float(np.linalg.norm(array[row])), 1e-9)

    def ask_step(self, goal: Array, heading: float | None = None, id_: int = 0) -> None:
        """Ask for a step of the pelvis to ``goal`` (3, m; its height is not used); one at a time."""
        step = self.state.step
        step[25], step[26:29], step[31] = 1.0, goal, float(id_)
        step[30] = 0.0 if heading is None else 1.0
        step[29] = heading or 0.0

    @property
    def stepping(self) -> bool:
        """Whether a step is under way or asked for."""
        return bool(self.state.step[0] != 0.0 or self.state.step[25] != 0.0)

    @property
    def gains(self) -> Gains:
        """Weights and speeds; may be replaced at any time."""
        return self._gains

    @gains.setter
    def gains(self, gains: Gains) -> None:
        self._gains = gains
        self._gains_packed = np.array(gains, dtype=np.float64)

    def lie_over_rest(self) -> None:
        """Lay the stack over no motion: the figure stands by itself."""
        under = self.under
        if under.active[0] > 0.5:
            self._switched = True
        self.under_buffer[:] = 0.0
        for array in (under.turns, under.feet, under.base.rotations_ls, under.base.rotations_ws):
            array[:, 3] = 1.0
        under.contacts[:] = 1.0
        under.base.rolls[:] = self.rig.rolls
        under.base.exact[:] = self.rig.reach[:, 1]

    def lie_over(self, root: Array, rotations_ls: Array, contacts: tuple[bool, bool]) -> None:
        """Lay the stack over a motion's pose: root (3) m, rotations (J, 4), which feet are planted."""
        rig, under = self.rig, self.under
        if under.active[0] < 0.5:
            self._switched = True
        local = under.base.rotations_ls
        local[:] = rotations_ls
        local /= np.linalg.norm(local, axis=1)[:, None]
        positions = np.empty((len(local), 3))
        fk_into(rig.parents, rig.offsets, np.asarray(root, dtype=np.float64), local, positions, under.base.rotations_ws)
        analyse_into(
            rig, local, positions, under.base.rotations_ws, under.points, under.turns, under.swivels, under.feet,
            under.base.rolls, under.base.exact, under.base.floors,
        )  # fmt: skip
        center_of_mass_into(rig.masses, rig.mass_centers, positions, under.base.rotations_ws, under.center)
        under.active[0] = 1.0
        under.contacts[:] = contacts
        for limb in range(4):
            upper = rig.limbs[limb, 0]
            under.roots[limb] = positions[upper]
            under.swivels[limb] -= default_swivel(
                rig, limb, under.points[1 + limb], positions[upper], under.base.rotations_ws[rig.parents[upper]]
            )  # fmt: skip

    def step(self, dt: float) -> None:
        """Advance by ``dt`` s; a long step is made of several, with held points going evenly to their targets."""
        dt = min(max(dt, 0.0), MOST_TIME)
        alone = self.under.active[0] < 0.5
        busy = self.state.mode[2] > 0.5 or (alone and self.held.flags.any())
        count = max(1, ceil(dt / (SHORT if busy else LONGEST) - 1e-6))
        wanted, carried = self.held.points.copy(), np.zeros(3)
        for n in range(count):
            if self.under.active[0] > 0.5 and self.state.mode[1] > 0.5:
                # What lies over a motion goes on with it at once, as all the rest of the figure does.
                carried = self.under.points[0] - self.state.goals[0]
            for row in range(5):
                if self.state.held[row] > 0.5:
                    from_ = self.state.targets[row] + carried
                    self.held.points[row] = from_ + (wanted[row] - from_) / (count - n)
            self._advance(dt / count)
        self.held.points[:] = wanted

    def _advance(self, dt: float) -> None:
        if self._switched:
            before = self.rotations_ls.copy()
        self.hull_size = int(
            advance_packed(
                *self.rig_packed, self._gains_packed, self.buffer, self.held_buffer, self.under_buffer,
                *self.contacts_packed, self.mass_share, dt, self.hull, self.center, self.rotations_ls,
                self.positions_ws, self.rotations_ws,
            )
        )  # fmt: skip
        if self._switched:
            # A new base shows at once in what no point says (wrists, rolls): let the difference fade.
            self._switched = False
            differences(before, self.rotations_ls, self.fade)
            self.fade_rates[:] = 0.0
            self.fading = 1.0
        if self.fading > 1e-4:
            spring_decay_into(self.fade.reshape(-1), self.fade_rates.reshape(-1), FADE_HALF_LIFE, dt)
            self.fading = float(np.abs(self.fade).max())
            add_differences(self.fade, self.rotations_ls)
            root = self.state.points[0]
            fk_into(
                self.rig.parents, self.rig.offsets, root, self.rotations_ls, self.positions_ws, self.rotations_ws
            )  # fmt: skip

    def balanced(self) -> bool:
        """Whether the centre of mass is over the support polygon."""
        if self.hull_size < 3:
            return False
        return margin_in_hull(self.hull, self.hull_size, self.center[0], self.center[2]) >= 0.0

    def save(self) -> bytes:
        """The state, small enough to be written after every step."""
        return self.buffer.tobytes()

    def restore(self, state: bytes) -> None:
        """Take up from what `save` gave; raises ValueError for something else."""
        buffer = np.frombuffer(state, dtype=np.float64)
        if buffer.shape != self.buffer.shape or not np.isfinite(buffer).all():
            raise ValueError("this is no state of a controller")
        self.buffer[:] = buffer
        self._show()

    def _show(self) -> None:
        """Bring the pose arrays up to the state without moving it."""
        st = self.state
        reconstruct_into(
            self.rig, self.under.base, st.points, st.turns, st.swivels, st.feet, st.feet_level, self.rotations_ls,
            self.positions_ws, self.rotations_ws,
        )  # fmt: skip
