from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bunraku.figure.capsules import capsules
from bunraku.figure.default import default_figure
from bunraku.figure.fk import fk
from bunraku.figure.mannequin import HIGH, LEFT, LOW, MEDIUM, RIGHT, Detail, build
from bunraku.figure.mesh import matrices
from bunraku.figure.skeleton import REQUIRED_ROLES, Skeleton, SkeletonError
from bunraku.figure.solids import Rows, ellipsoid, loft, monotone


def figure_with(scale=1.0, drop=(), stretch=1.0):
    """The default figure scaled, with thighs stretched and the joints of some roles taken out."""
    base = default_figure()
    gone = {base.roles[role] for role in drop}
    keep = [j for j in range(len(base)) if j not in gone]
    offsets = np.array(base.offsets) * scale
    for side in ("left", "right"):
        offsets[base.role(side + "LowerLeg")] *= stretch
    rows, parents = [], []
    for joint in keep:
        offset, parent = offsets[joint].copy(), int(base.parents[joint])
        while parent in gone:
            offset += offsets[parent]
            parent = int(base.parents[parent])
        rows.append(offset)
        parents.append(-1 if parent < 0 else keep.index(parent))
    roles = {role: keep.index(joint) for role, joint in base.roles.items() if joint in keep}
    n = len(keep)
    return Skeleton(
        tuple(base.names[j] for j in keep), np.array(parents), np.array(rows), roles, np.ones(n), np.zeros((n, 3)),
        np.zeros((n, 3)), np.zeros((n, 3)),
    )  # fmt: skip


def directed_edges(indices):
    faces = indices.astype(np.int64)
    edges = Counter()
    for a, b in ((0, 1), (1, 2), (2, 0)):
        edges.update(zip(faces[:, a].tolist(), faces[:, b].tolist(), strict=True))
    return edges


def check_surface(mesh):
    edges = directed_edges(mesh.indices)
    assert all(count == 1 for count in edges.values()), "an edge is used twice the same way round"
    assert all((b, a) in edges for a, b in edges), "a hole"
    a, b, c = (mesh.positions[mesh.indices[:, k]].astype(float) for k in range(3))
    flat = np.cross(b - a, c - a)
    assert (np.linalg.norm(flat, axis=1) > 0.0).all()
    along = np.einsum("ij,ij->i", flat, mesh.normals[mesh.indices].sum(axis=1))
    assert (along < 0.0).mean() < 0.02, "normals and winding disagree"
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)
    assert (mesh.joints[mesh.indices] == mesh.joints[mesh.indices[:, :1]]).all(), "a face spans two joints"


@pytest.mark.parametrize(("detail", "triangles"), [(LOW, 6000), (MEDIUM, 9000), (HIGH, 20000)])
def test_every_part_is_closed_and_the_levels_have_their_size(detail, triangles):
    mesh = build(default_figure(), detail)
    assert abs(len(mesh.indices) - triangles) < 0.1 * triangles
    check_surface(mesh)


def test_it_stands_on_the_ground_as_tall_as_a_person():
    mesh = build(default_figure())
    assert -0.002 <= mesh.positions[:, 1].min() <= 0.003
    assert 1.68 < mesh.positions[:, 1].max() < 1.80


def test_left_is_teal_and_right_is_coral_and_they_mirror():
    mesh = build(default_figure())
    teal, coral = (np.abs(mesh.colors - color).max(axis=1) < 1e-6 for color in (LEFT, RIGHT))
    assert mesh.positions[teal, 0].min() > 0.0
    assert mesh.positions[coral, 0].max() < 0.0
    left = mesh.positions[mesh.positions[:, 0] > 0.25]
    right = mesh.positions[mesh.positions[:, 0] < -0.25] * [-1, 1, 1]
    assert len(left) == len(right)
    for axis in range(3):
        np.testing.assert_allclose(np.sort(left[:, axis]), np.sort(right[:, axis]), atol=1e-4)


def test_the_visor_looks_ahead():
    mesh = build(default_figure())
    head = mesh.joints == default_figure().role("head")
    dark = head & (mesh.colors.sum(axis=1) < 0.5)
    skull = head & ~dark
    assert mesh.positions[dark, 2].mean() > mesh.positions[skull, 2].mean() + 0.03


def test_bent_joints_keep_their_parts_in_touch():
    """Whatever the angle, the ball at a joint reaches into both of its segments."""
    figure = default_figure()
    mesh = build(figure, LOW)
    pairs = (("LowerLeg", "UpperLeg"), ("LowerArm", "UpperArm"), ("Foot", "LowerLeg"))
    for joint, parent in (("left" + lower, "left" + upper) for lower, upper in pairs):
        pivot = figure.rest_positions[figure.role(joint)]
        ball = np.linalg.norm(mesh.positions[mesh.joints == figure.role(joint)] - pivot, axis=1).min()
        upper = np.linalg.norm(mesh.positions[mesh.joints == figure.role(parent)] - pivot, axis=1).min()
        slate = (mesh.joints == figure.role(joint)) & (mesh.colors.max(axis=1) < 0.3)
        radius = np.median(np.linalg.norm(mesh.positions[slate] - pivot, axis=1))
        assert ball < radius * 1.001
        assert upper < radius, f"{parent} does not reach the ball of {joint}"


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_skinning_is_the_rigid_motion_of_each_joint(seed):
    figure = default_figure()
    mesh = build(figure, Detail(5, 1))
    random = np.random.default_rng(seed)
    rotations = random.normal(size=(len(figure), 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    positions_ws, rotations_ws = fk(figure, random.normal(size=3), rotations)
    out = mesh.skin(positions_ws, rotations_ws)
    turn = matrices(rotations_ws)[mesh.joints]
    expected = np.einsum("nij,nj->ni", turn, mesh.positions - figure.rest_positions[mesh.joints])
    np.testing.assert_allclose(out[:, :3], expected + positions_ws[mesh.joints], atol=2e-5)
    np.testing.assert_allclose(out[:, 3:], np.einsum("nij,nj->ni", turn, mesh.normals), atol=2e-5)


def test_skinning_the_rest_pose_changes_nothing():
    figure = default_figure()
    mesh = build(figure)
    out = mesh.skin(*fk(figure, *figure.rest_pose()))
    np.testing.assert_allclose(out[:, :3], mesh.positions, atol=1e-6)


@pytest.mark.parametrize(
    "figure",
    [
        figure_with(0.01),
        figure_with(2.5),
        figure_with(stretch=1.6),
        figure_with(drop=("chest", "neck", "leftShoulder", "rightShoulder", "leftToes", "rightToes")),
    ],
    ids=["a centimetre tall", "a giant", "long legs", "only what VRM demands"],
)
def test_any_humanoid_has_a_mannequin_of_its_size(figure):
    mesh = build(figure, LOW)
    check_surface(mesh)
    rest = figure.rest_positions
    tall = rest[:, 1].max() - rest[:, 1].min()
    assert tall < np.ptp(mesh.positions[:, 1]) < 1.6 * tall
    used = {figure.role(role) for role in REQUIRED_ROLES}
    assert used <= set(mesh.joints.tolist())
    assert set(capsules(figure).joints.tolist()) <= set(range(len(figure)))


def test_a_skeleton_that_is_no_humanoid_is_refused():
    with pytest.raises(SkeletonError, match="rightFoot"):
        build(figure_with(drop=("rightToes", "rightFoot")))


def test_capsules_cover_the_mesh():
    """No vertex is farther than 5 cm from a round cone of its own joint or a neighbour's."""
    figure = default_figure()
    mesh, cones = build(figure, LOW), capsules(figure)
    starts, ends = cones.placed(*fk(figure, *figure.rest_pose()))
    best = np.full(len(mesh.positions), np.inf)
    for a, b, (ra, rb) in zip(starts, ends, cones.radii, strict=True):
        axis = b - a
        t = np.clip((mesh.positions - a) @ axis / max(axis @ axis, 1e-12), 0.0, 1.0)
        gap = np.linalg.norm(mesh.positions - (a + t[:, None] * axis), axis=1) - (ra + t * (rb - ra))
        best = np.minimum(best, gap)
    assert best.max() < 0.05


@given(st.lists(st.floats(-10, 10), min_size=2, max_size=8), st.integers(0, 1000))
def test_profiles_do_not_overshoot(values, seed):
    x = np.cumsum(0.05 + np.random.default_rng(seed).random(len(values)))
    y = np.array(values)[:, None]
    at = np.linspace(x[0], x[-1], 101)
    curve = monotone(x, y, at)[:, 0]
    k = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    low, high = np.minimum(y[k, 0], y[k + 1, 0]), np.maximum(y[k, 0], y[k + 1, 0])
    assert (curve >= low - 1e-9).all()
    assert (curve <= high + 1e-9).all()
    np.testing.assert_allclose(monotone(x, y, x), y, atol=1e-9)


def test_solids_have_the_volume_of_their_shapes():
    ball = ellipsoid(np.array([1.0, 2.0, 3.0]), (0.1, 0.2, 0.3), around=48, along=48)
    assert ball.volume() == pytest.approx(4 / 3 * np.pi * 0.1 * 0.2 * 0.3, rel=0.02)
    rod = loft(
        np.zeros(3), np.array([2.0, 0.0, 0.0]), Rows.of((0, 0.1, 0.2), (1, 0.1, 0.2)), around=64, along=2,
        across=(0, 1, 0), ends=(0.0, 0.0),
    )  # fmt: skip
    assert rod.volume() == pytest.approx(np.pi * 0.1 * 0.2 * 2.0, rel=0.01)
