"""Characters in Blender: bones where forward kinematics says, foreign rigs, and a body that follows."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector
from perfanim.core.body.skeleton import Skeleton, forward_kinematics
from perfanim.core.body.standard_skeleton import JOINT_NAMES, default_skeleton, scaled
from perfanim.core.errors import CharacterError
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.displayed_joint_names import NAMINGS
from perfanim.perfanim_addon.capture.armature_driver import ArmatureDriver
from perfanim.perfanim_addon.character import axes, create_character
from perfanim.perfanim_addon.character.body_mesh import fitted_body
from perfanim.perfanim_addon.character.own_body import own_skeleton
from played import points_from_blender

SKELETON = default_skeleton()
BONES = list(NAMINGS["blender"].values())


@pytest.fixture(autouse=True)
def empty_scene():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


@pytest.fixture
def name(empty_scene) -> str:
    """A new character of the standard skeleton."""
    return create_character.create_character(bpy.context, SKELETON)


@pytest.fixture
def driver(name) -> ArmatureDriver:
    return ArmatureDriver(name, SKELETON)


def check_driven(driver: ArmatureDriver, name: str, seed: int, skeleton: Skeleton = SKELETON) -> np.ndarray:
    """Check that the bones stand where forward kinematics puts the joints; return where it puts their tips."""
    rotations, root = random_pose(seed)
    driver.apply(rotations, root)
    expected, world = forward_kinematics(skeleton, rotations, root)
    assert np.max(np.linalg.norm(posed_heads(name) - expected, axis=1)) < 1e-4
    return expected + rot.rotate(world, skeleton.tips_m)


def uneven_skeleton(seed: int) -> Skeleton:
    return scaled(default_skeleton(1.62), np.random.default_rng(seed).uniform(0.85, 1.2, size=29))


def random_pose(seed: int, spread: float = 0.7) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    return rot.from_rotation_vector(spread * random.normal(size=(29, 3))), random.normal(size=3)


def turned(**degrees: tuple[float, float, float]) -> np.ndarray:
    result = rot.identity((29,))
    for name, angles in degrees.items():
        result[SKELETON.index(name)] = rot.from_rotation_vector(np.radians(angles))
    return result


def evaluated(object_name: str) -> bpy.types.Object:
    return bpy.data.objects[object_name].evaluated_get(bpy.context.evaluated_depsgraph_get())


def posed_heads(object_name: str) -> np.ndarray:
    """Heads of the evaluated pose bones in the scene, product space, in the order of the joints."""
    obj = evaluated(object_name)
    return points_from_blender([obj.matrix_world @ obj.pose.bones[name].head for name in BONES])


def body_points(object_name: str) -> np.ndarray:
    """Vertices of the evaluated body in the scene, product space."""
    obj = evaluated(f"{object_name} body")
    return points_from_blender([obj.matrix_world @ vertex.co for vertex in obj.data.vertices])


def edit_bones(object_name: str, change) -> None:
    bpy.context.view_layer.objects.active = bpy.data.objects[object_name]
    bpy.ops.object.mode_set(mode="EDIT")
    change(bpy.data.objects[object_name].data.edit_bones)
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("skeleton", [SKELETON, default_skeleton(1.45), uneven_skeleton(1), uneven_skeleton(2)])
def test_bones_stand_where_forward_kinematics_puts_the_joints(skeleton):
    name = create_character.create_character(bpy.context, skeleton)
    driver = ArmatureDriver(name, skeleton)
    for seed in range(5):
        tips = check_driven(driver, name, seed, skeleton)
        tails = points_from_blender([evaluated(name).pose.bones[joint].tail for joint in BONES])
        assert np.max(np.linalg.norm(tails - tips, axis=1)) < 1e-4


def test_a_second_character_gets_a_name_of_its_own_and_leaves_edit_mode():
    first = create_character.create_character(bpy.context, SKELETON)
    bpy.ops.object.mode_set(mode="EDIT")
    second = create_character.create_character(bpy.context, SKELETON)
    assert {first, second} <= set(bpy.data.objects.keys())
    assert first != second
    assert bpy.context.view_layer.objects.active.name == second
    assert bpy.data.objects[second].mode == "OBJECT"
    assert {bone.rotation_mode for bone in bpy.data.objects[second].pose.bones} == {"QUATERNION"}
    assert create_character.own_map(bpy.data.objects[second]) is not None


def test_a_pose_is_pasted_flipped(name, driver):
    assert {bpy.utils.flip_name(bone) for bone in BONES} == set(BONES)
    rotations, _ = random_pose(4)
    driver.apply(rotations, create_character.standing_root_m(SKELETON))
    obj, mirror = bpy.data.objects[name], np.array([-1.0, 1.0, 1.0])
    before = dict(zip(BONES, posed_heads(name), strict=True))
    bpy.ops.object.mode_set(mode="POSE")
    bpy.ops.pose.select_all(action="SELECT")
    bpy.ops.pose.copy()
    for bone in obj.pose.bones:
        bone.matrix_basis.identity()
    bpy.ops.pose.paste(flipped=True)
    bpy.context.view_layer.update()
    for bone, head in zip(BONES, posed_heads(name), strict=True):
        np.testing.assert_allclose(head, mirror * before[bpy.utils.flip_name(bone)], atol=1e-4)


def test_a_character_with_the_joint_names_of_early_versions_is_driven_alike(name):
    rotations, root = random_pose(5)
    ArmatureDriver(name, SKELETON).apply(rotations, root)
    expected, obj = posed_heads(name), bpy.data.objects[name]
    for joint, bone in NAMINGS["blender"].items():
        obj.data.bones[bone].name = joint
    ArmatureDriver(name, SKELETON).apply(*random_pose(6))
    ArmatureDriver(name, SKELETON).apply(rotations, root)
    bpy.context.view_layer.update()
    heads = [obj.matrix_world @ obj.pose.bones[joint].head for joint in JOINT_NAMES]
    np.testing.assert_allclose(points_from_blender(heads), expected, atol=1e-5)
    assert own_skeleton(obj).names == JOINT_NAMES


def test_bones_without_length_survive():
    tips = SKELETON.tips_m.copy()
    tips[SKELETON.index("lthumb")] = 0.0
    tips[SKELETON.index("head")] *= 0.01
    name = create_character.create_character(
        bpy.context, Skeleton(SKELETON.names, SKELETON.parents, SKELETON.offsets_m, tips)
    )
    assert create_character.own_map(bpy.data.objects[name]) is not None


def test_knees_and_elbows_bend_the_right_way(name, driver):
    standing = create_character.standing_root_m(SKELETON)
    driver.apply(turned(ltibia=(80.0, 0.0, 0.0), rradius=(0.0, 80.0, 0.0)), standing)
    heads = posed_heads(name)
    # a positive turn about x (to the left) takes the shank back, the feet point forward, the right forearm goes forward
    assert heads[SKELETON.index("lfoot")][2] < heads[SKELETON.index("ltibia")][2] - 0.3
    assert heads[SKELETON.index("rtoes")][2] > heads[SKELETON.index("rfoot")][2] + 0.1
    assert heads[SKELETON.index("rhand")][2] > heads[SKELETON.index("rradius")][2] + 0.2
    # and the body went along: Blender's -Y is forward
    body = evaluated(f"{name} body")
    assert min(vertex.co.y for vertex in body.data.vertices) < -0.2


def roll(bones):
    random = np.random.default_rng(3)
    for bone in bones:
        bone.roll = random.uniform(-np.pi, np.pi)


def point_up(bones):
    for bone in bones:
        bone.tail = bone.head + (bone.tail - bone.head).length * Matrix.Identity(3).col[2]


@pytest.mark.parametrize("change", [roll, point_up])
def test_bones_as_importers_leave_them_are_driven_alike(name, change):
    # importers give bones rolls and tails of their own choice; joints must still stand where they belong
    edit_bones(name, change)
    check_driven(ArmatureDriver(name, SKELETON), name, 4)


def test_the_object_places_and_scales_the_performance(name):
    obj = bpy.data.objects[name]
    obj.location = (1.0, 2.0, 3.0)
    obj.rotation_euler = (0.0, 0.0, np.radians(90.0))
    obj.scale = (2.0, 2.0, 2.0)
    rotations, root = random_pose(6)
    ArmatureDriver(name, SKELETON).apply(rotations, root)
    expected, _ = forward_kinematics(SKELETON, rotations, root)
    bpy.context.view_layer.update()
    placed = [obj.matrix_world @ Vector(point) for point in axes.points_to_blender(expected).tolist()]
    assert np.max(np.abs(posed_heads(name) - points_from_blender(placed))) < 2e-4


def test_a_rig_in_centimetres_with_y_up_is_driven_alike(name):
    # as FBX files come in: the object turns and shrinks what the armature has
    obj = bpy.data.objects[name]
    obj.data.transform(Matrix(axes.BLENDER_FROM_WORLD.T.tolist()).to_4x4() @ Matrix.Scale(100.0, 4))
    obj.matrix_world = Matrix(axes.BLENDER_FROM_WORLD.tolist()).to_4x4() @ Matrix.Scale(0.01, 4)
    check_driven(ArmatureDriver(name, SKELETON), name, 7)


def test_a_rig_that_rests_in_an_a_pose_takes_the_same_poses(name):
    lowered = turned(lhumerus=(0.0, 0.0, -45.0), rhumerus=(0.0, 0.0, 45.0), lfemur=(0.0, 0.0, -18.0))
    ArmatureDriver(name, SKELETON).apply(lowered, create_character.standing_root_m(SKELETON))
    bpy.context.view_layer.objects.active = bpy.data.objects[name]
    bpy.ops.object.mode_set(mode="POSE")
    bpy.ops.pose.armature_apply(selected=False)  # the A pose becomes the rest pose
    bpy.ops.object.mode_set(mode="OBJECT")
    rotations, root = random_pose(8, spread=0.4)
    ArmatureDriver(name, SKELETON).apply(rotations, root)
    expected, _ = forward_kinematics(SKELETON, rotations, root)
    legs_and_arms = [i for i, joint in enumerate(JOINT_NAMES) if "foot" not in joint and "toes" not in joint]
    difference = np.linalg.norm(posed_heads(name) - expected, axis=1)
    assert np.max(difference[legs_and_arms]) < 1e-3


def test_euler_bones_are_switched_and_other_bones_left_alone(name):

    def add_prop(bones):
        prop = bones.new("sword")
        prop.head, prop.tail = (1.0, 0.0, 1.4), (1.0, 0.0, 2.2)
        prop.parent = bones["hand.L"]

    edit_bones(name, add_prop)
    bones = bpy.data.objects[name].pose.bones
    bones["sword"].rotation_quaternion = (0.5, 0.5, 0.5, 0.5)
    driver = ArmatureDriver(name, SKELETON)
    for bone in bones:
        bone.rotation_mode = "XYZ"
    check_driven(driver, name, 9)
    assert bones["sword"].rotation_mode == "XYZ"
    assert tuple(bones["sword"].rotation_quaternion) == (0.5, 0.5, 0.5, 0.5)


def test_a_character_that_lacks_bones_follows_with_the_others(name):
    edit_bones(name, lambda bones: [bones.remove(bones[bone]) for bone in ("thumb.L", "toes.R")])
    assert create_character.own_map(bpy.data.objects[name]) is None
    driver = ArmatureDriver(name, SKELETON)
    rotations, root = random_pose(10)
    driver.apply(rotations, root)
    expected, _ = forward_kinematics(SKELETON, rotations, root)
    joints = [SKELETON.index(joint) for joint in ("lhand", "rhand", "head", "lfemur", "rfemur")]
    bpy.context.view_layer.update()
    heads = np.array([bpy.data.objects[name].pose.bones[BONES[joint]].head for joint in joints])
    # how high its ball of the foot is above the floor is estimated from the length of the legs
    assert np.max(np.linalg.norm(heads - axes.points_to_blender(expected[joints]), axis=1)) < 2e-3


def test_a_character_without_legs_is_refused(name, driver):
    legs = ("femur", "tibia", "foot", "toes")
    edit_bones(
        name,
        lambda bones: [bones.remove(bones[bone]) for joint, bone in NAMINGS["blender"].items() if joint[1:] in legs],
    )
    with pytest.raises(CharacterError, match="neither names nor shape reveal lfemur, rfemur"):
        driver.apply(*random_pose(10))


def test_a_lost_or_wrong_object_is_a_clear_error(name, driver):
    with pytest.raises(CharacterError, match="is of type mesh, not an armature"):
        ArmatureDriver(f"{name} body", SKELETON)
    bpy.data.objects.remove(bpy.data.objects[name])
    with pytest.raises(CharacterError, match="there is no object 'Performer'"):
        driver.apply(*random_pose(11))


def test_the_driver_survives_a_file_load(name, driver, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    check_driven(driver, name, 12)


def test_the_driver_survives_undo(name, driver):
    bpy.ops.ed.undo_push(message="before")
    driver.apply(*random_pose(13))
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    check_driven(driver, name, 14)


@pytest.mark.parametrize("skeleton", [SKELETON, default_skeleton(1.2), uneven_skeleton(3)])
def test_the_body_fits_its_skeleton(skeleton):
    heads = skeleton.rest_positions_m + create_character.standing_root_m(skeleton)
    body = fitted_body(skeleton, heads)
    assert 2000 < len(body.vertices_m) < 6000
    assert np.allclose(body.weights.sum(axis=1), 1.0)
    assert np.min(body.weights) >= -1e-12
    for limb in ("humerus", "radius", "hand", "fingers", "femur", "tibia", "foot", "toes"):
        for joint in (skeleton.index(side + limb) for side in "lr"):
            carried = body.vertices_m[body.weights[:, joint] > 0.5]
            middle = heads[joint] + 0.5 * skeleton.tips_m[joint]
            assert np.min(np.linalg.norm(carried - middle, axis=1)) < 0.11
    # the soles stand on the floor and the hands reach past the finger joints
    assert abs(body.vertices_m[:, 1].min()) < 0.02
    for side in "lr":
        assert np.max(np.abs(body.vertices_m[:, 0])) > abs(heads[skeleton.index(f"{side}fingers")][0])


def test_faces_look_outward_and_sides_mirror_each_other():
    body = fitted_body(SKELETON, SKELETON.rest_positions_m + create_character.standing_root_m(SKELETON))
    corners = body.vertices_m[body.faces]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    # six times the enclosed volume by the divergence theorem: positive when the faces look outward
    volume = np.sum(normals * corners.mean(axis=1)) / 6.0
    assert 0.03 < volume < 0.12
    mirrored = body.vertices_m * [-1.0, 1.0, 1.0]
    for point in mirrored[:: len(mirrored) // 60]:
        assert np.min(np.linalg.norm(body.vertices_m - point, axis=1)) < 0.012


def test_the_body_moves_with_the_bones(name, driver):
    standing = create_character.standing_root_m(SKELETON)
    weights = fitted_body(SKELETON, SKELETON.rest_positions_m + standing).weights
    rest = body_points(name)
    rotations, root = turned(root=(10.0, 50.0, 0.0), lhumerus=(0.0, -30.0, 60.0), rfemur=(-90.0, 0.0, 0.0)), standing
    driver.apply(rotations, root)
    positions, world = forward_kinematics(SKELETON, rotations, root)
    expected = np.zeros_like(rest)
    for joint in range(29):
        bone = SKELETON.rest_positions_m[joint] + standing
        expected += weights[:, [joint]] * (positions[joint] + rot.rotate(world[joint], rest - bone))
    assert np.max(np.linalg.norm(body_points(name) - expected, axis=1)) < 3e-3


def test_deep_bends_tear_nothing(name):
    rest = body_points(name)
    faces = np.array([face.vertices for face in bpy.data.objects[f"{name} body"].data.polygons])
    squat = turned(
        lfemur=(-110.0, 0.0, 0.0), rfemur=(-110.0, 0.0, 0.0), ltibia=(130.0, 0.0, 0.0), rtibia=(130.0, 0.0, 0.0),
        lhumerus=(0.0, 0.0, -80.0), rhumerus=(0.0, 0.0, 80.0), lradius=(0.0, -130.0, 0.0), head=(0.0, 60.0, 0.0),
    )  # fmt: skip
    ArmatureDriver(name, SKELETON).apply(squat, create_character.standing_root_m(SKELETON))
    bent = body_points(name)

    def edges(points):
        return np.linalg.norm(points[faces] - points[np.roll(faces, 1, axis=1)], axis=2)

    assert np.max(edges(bent) / np.maximum(edges(rest), 0.004)) < 4.0
