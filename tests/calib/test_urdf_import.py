"""Test robot files from URDFs.

These would catch: a frame, unit or sign that is lost on the way to modified DH numbers, for any axes; a limit, a
mass or a coupled joint written wrongly. They would also catch content that a robot file cannot hold and that is
skipped.

The URDF is built here by independent code, from its XML, as ROS does.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import DataError, forward, load_robot
from calib.arm.inverse_kinematics import arm_of
from calib.arm.kinematics import statics
from calib.array import Array
from calib.robot_file import import_urdf

QUARTER = float(np.pi / 2.0)


def joint(
    name: str, kind: str, parent: str, child: str, *, xyz: str = "0 0 0", rpy: str = "0 0 0", more: str = ""
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/>{more}</joint>'
    )


def urdf(*joints: str, links: str = "", name: str = "arm") -> str:
    names = dict.fromkeys(re.findall(r'link="(\w+)"', "".join(joints)))
    plain = "".join(f'<link name="{link}"/>' for link in names if f'name="{link}"' not in links)
    return f'<?xml version="1.0"?><robot name="{name}">{links}{plain}{"".join(joints)}</robot>'


def limit(low: float, high: float, axis: str = "0 0 1") -> str:
    return f'<axis xyz="{axis}"/><limit lower="{low!r}" upper="{high!r}" effort="1" velocity="1"/>'


def six(*, flange: str = "") -> list[str]:
    """An arm with a spherical wrist, axes along y and x as ROS-Industrial has them."""
    spec = [("0 0 0.29", "0 0 1"), ("0 0 0", "0 1 0"), ("0 0 0.27", "0 1 0")]
    spec += [("0 0 0.07", "1 0 0"), ("0.302 0 0", "0 1 0"), ("0.072 0 0", "1 0 0")]
    out = [
        joint(f"joint_{k}", "revolute", f"link_{k - 1}", f"link_{k}", xyz=xyz, more=limit(-1.9, 2.1, axis))
        for k, (xyz, axis) in enumerate(spec, start=1)
    ]
    return [*out, joint("flange", "fixed", "link_6", "tool0", rpy=f"0 {QUARTER!r} 0")] if not flange else out


def random_urdf(rng: np.random.Generator) -> str:
    """Draw a chain of 2 to 8 joints of every kind, with fixed ones between them.

    The axes are random or along the frames.
    """
    joints, last = [], "link_0"
    for k in range(1, int(rng.integers(2, 9)) + 1):
        kind = str(rng.choice(["revolute", "revolute", "continuous", "prismatic"]))
        axis = rng.normal(size=3) if rng.random() < 0.5 else np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
        turn = rng.uniform(-3.0, 3.0, 3) if rng.random() < 0.5 else rng.integers(-2, 3, 3) * QUARTER
        place = rng.uniform(-0.5, 0.5, 3) * (rng.random(3) < 0.6)
        words = [" ".join(repr(float(x)) for x in v) for v in (place, turn, axis)]
        ends = limit(-1.5, 2.5, words[2]) if kind != "continuous" else f'<axis xyz="{words[2]}"/>'
        joints.append(joint(f"j{k}", kind, last, f"link_{k}", xyz=words[0], rpy=words[1], more=ends))
        last = f"link_{k}"
        if rng.random() < 0.4:
            joints.append(joint(f"f{k}", "fixed", last, f"end_{k}", xyz="0.1 0.02 -0.3", rpy=words[1]))
            last = f"end_{k}"
    return urdf(*joints)


def reached(text: str, joints: Array) -> Array:
    """Compute the last link in the first, (n, 4, 4), mm.

    `joints` are in rad or mm, one column per moving joint, in order of the file.
    """
    pose, column = np.broadcast_to(np.eye(4), (len(joints), 4, 4)), 0
    for element in ET.fromstring(text).iter("joint"):
        at, axis = element.find("origin"), element.find("axis")
        assert at is not None
        xyz, rpy = ([float(x) for x in str(at.get(key)).split()] for key in ("xyz", "rpy"))
        here = np.eye(4)
        here[:3, :3], here[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), 1000.0 * np.array(xyz)
        pose = pose @ here
        if element.get("type") == "fixed":
            continue
        assert axis is not None
        along = np.array([float(x) for x in str(axis.get("xyz")).split()])
        along, q = along / np.linalg.norm(along), joints[:, column, None]
        move, column = np.broadcast_to(np.eye(4), (len(joints), 4, 4)).copy(), column + 1
        if element.get("type") == "prismatic":
            move[:, :3, 3] = q * along
        else:
            move[:, :3, :3] = Rotation.from_rotvec(q * along).as_matrix()
        pose = pose @ move
    return pose


def written(folder: Path, text: str) -> Path:
    (folder / "arm.urdf").write_text(text, "utf-8")
    return folder / "arm.urdf"


@pytest.mark.parametrize("seed", range(40))
def test_any_chain_is_the_same_arm(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    text = random_urdf(rng)
    found = import_urdf(written(tmp_path, text))
    (tmp_path / "arm.toml").write_text(found.draft.text, "utf-8")
    robot = load_robot("arm.toml", tmp_path)
    joints = rng.uniform(robot.lower, robot.upper, (30, robot.joints))
    ours, theirs = found.base @ forward(robot, joints) @ found.tool, reached(text, joints)
    np.testing.assert_allclose(ours[:, :3, 3], theirs[:, :3, 3], atol=1e-5)
    np.testing.assert_allclose(ours[:, :3, :3], theirs[:, :3, :3], atol=1e-9)
    assert robot.convention == "mdh"
    np.testing.assert_array_equal(found.base[:3, 2], [0.0, 0.0, 1.0])  # gravity stays what it is


def test_an_ordinary_arm_becomes_the_table_of_its_maker(tmp_path: Path) -> None:
    found = import_urdf(written(tmp_path, urdf(*six())))
    robot = found.robot
    np.testing.assert_allclose(robot.a, [0, 0, 270, 70, 0, 0], atol=1e-9)
    np.testing.assert_allclose(robot.d, [290, 0, 0, 302, 0, 72], atol=1e-9)
    np.testing.assert_allclose(np.abs(np.degrees(robot.alpha)), [0, 90, 0, 90, 90, 90], atol=1e-9)
    np.testing.assert_allclose(np.array([found.base, found.tool]), [np.eye(4)] * 2, atol=1e-9)
    assert arm_of(robot).kind == "in closed form, spherical wrist"
    assert robot.parallel_axes == (3,)
    np.testing.assert_allclose(robot.lower, -1.9, atol=1e-6)
    assert found.remarks == ()


def test_rounded_quarters_are_meant_as_quarters_and_said(tmp_path: Path) -> None:
    joints = six()
    joints[1] = joints[1].replace('rpy="0 0 0"', 'rpy="1.5708 0 0"')
    joints[2] = joints[2].replace('rpy="0 0 0"', 'rpy="-1.57 0 0"')
    found = import_urdf(written(tmp_path, urdf(*joints)))
    assert found.remarks[0] == "1.5708 rad was taken as 90 deg exactly."
    assert "-1.57 rad was taken as -90 deg exactly." in found.remarks
    assert (
        arm_of(import_urdf(written(tmp_path, urdf(*six()))).robot).kind == "in closed form, spherical wrist"
    )
    joints[2] = joints[2].replace('rpy="-1.57 0 0"', 'rpy="-1.58 0 0"')
    assert not any("1.58" in remark for remark in import_urdf(written(tmp_path, urdf(*joints))).remarks)


def test_axes_that_are_all_but_parallel_are_refused_by_name(tmp_path: Path) -> None:
    """Axes that are nearly parallel are refused by name, as in a URDF of one calibrated arm.

    A table of DH numbers would use a normal that is kilometres away.
    """
    joints = six()
    joints[2] = joints[2].replace('rpy="0 0 0"', 'rpy="0.0001 0 0"')
    with pytest.raises(
        DataError, match=r"the axes of 'joint_2' and 'joint_3' are parallel but for 0\.0057 deg"
    ):
        import_urdf(written(tmp_path, urdf(*joints)))


def test_masses_pull_at_the_joints_as_in_the_urdf(tmp_path: Path) -> None:
    """Statics of the robot file against the lever arms of the URDF's own frames."""
    heavy = '<link name="link_2"><inertial><origin xyz="0.1 0.02 0.15"/><mass value="7"/></inertial></link>'
    heavy += '<link name="link_0"><inertial><mass value="50"/></inertial></link>'
    found = import_urdf(written(tmp_path, urdf(*six(), links=heavy)))
    (load,) = found.robot.loads
    assert (load.link, load.mass_kg) == (2, 7.0)
    q = np.array([[0.3, 0.4, 0.0, 0.0, 0.0, 0.0]])
    # Axis 2 along y at [0, 0, 290]: the centre turned by 0.4 about it
    lever = 1000.0 * (np.cos(0.4) * 0.1 + np.sin(0.4) * 0.15)
    assert statics(found.robot, q).torque[0, 1] == pytest.approx(7.0 * 9.81 * lever, rel=1e-9)


def test_masses_on_rigid_side_branches_pull_too(tmp_path: Path) -> None:
    """Bodies as separate links next to the chain weigh as much as within their carriers."""

    def body(link: str, at: str, kg: float) -> str:
        return f'<link name="{link}"><inertial><origin xyz="{at}"/><mass value="{kg}"/></inertial></link>'

    beside = [
        joint("weight", "fixed", "link_2", "frame", xyz="-0.2 0 0", rpy=f"0 0 {QUARTER!r}"),
        joint("disc", "fixed", "frame", "counter", xyz="0 0.1 0"),
        joint("camera", "fixed", "tool0", "camera", xyz="0 0 0.1"),
        joint("box", "fixed", "link_0", "box"),
        joint("finger", "prismatic", "tool0", "finger", more=limit(0.0, 0.02)),
        joint("nail", "fixed", "finger", "nail"),
    ]
    bodies = body("link_2", "0.1 0 0", 4.0) + body("counter", "0 0.05 0", 6.0) + body("camera", "0 0 0", 0.5)
    bodies += body("box", "0 0 0", 30.0) + body("finger", "0 0 0", 0.2) + body("nail", "0 0 0", 0.1)
    split = import_urdf(written(tmp_path, urdf(*six(), *beside, links=bodies)), tip="tool0")
    whole = body("link_2", f"{(4.0 * 0.1 - 6.0 * 0.35) / 10.0!r} 0 0", 10.0) + body("tool0", "0 0 0.1", 0.5)
    one = import_urdf(written(tmp_path, urdf(*six(), links=whole)))
    q = np.random.default_rng(2).uniform(-1.5, 1.5, (30, 6))
    wanted = statics(one.robot, q).torque
    np.testing.assert_allclose(statics(split.robot, q).torque, wanted, atol=1e-3)  # N mm
    assert sum(load.mass_kg for load in split.robot.loads) == pytest.approx(10.5)
    assert any("joint finger carries (0.3 kg)" in remark for remark in split.remarks)


ELSEWHERE = {
    "wheel without limits": [joint("wheel", "revolute", "link_0", "wheel")],
    "wheel of another type": [joint("wheel", "hinge", "link_0", "wheel")],
    "gripper in degrees": [joint("finger", "revolute", "tool0", "finger", more=limit(0.0, 90.0))],
    "gripper without an axis": [joint("f", "prismatic", "tool0", "f", more=limit(0.0, 0.1, "0 0 0"))],
    "gripper as a ring of rods": [
        joint("a", "continuous", "tool0", "rod"),
        joint("b", "continuous", "tool0", "other"),
        joint("c", "fixed", "other", "rod"),
    ],
    "links that carry one another": [joint("a", "fixed", "one", "two"), joint("b", "fixed", "two", "one")],
    "a mimic of nothing": [joint("m", "revolute", "tool0", "m", more=limit(0.0, 1.0) + '<mimic joint="x"/>')],
    "a camera in mm": [joint("camera", "fixed", "link_5", "camera", xyz="0 120 0")],
}


@pytest.mark.parametrize("what", ELSEWHERE)
def test_what_is_beside_the_chosen_chain_does_not_refuse_it(what: str, tmp_path: Path) -> None:
    found = import_urdf(written(tmp_path, urdf(*six(), *ELSEWHERE[what])), base="link_0", tip="tool0")
    alone = import_urdf(written(tmp_path, urdf(*six())))
    assert found.robot == alone.robot


@pytest.mark.parametrize(
    ("what", "tip", "words"),
    [
        ("gripper in degrees", "finger", "they are in deg"),
        ("wheel without limits", "wheel", "has no limits"),
        ("wheel of another type", "wheel", "has the type 'hinge'"),
        ("gripper as a ring of rods", "rod", "which a carries too"),
        ("a camera in mm", "camera", r"written in mm\?"),
    ],
)
def test_the_chosen_chain_is_checked(what: str, tip: str, words: str, tmp_path: Path) -> None:
    path = written(tmp_path, urdf(*six(), *ELSEWHERE[what]))
    with pytest.raises(DataError, match=words):
        import_urdf(path, base="link_0", tip=tip)


def test_a_mass_that_cannot_be_placed_refuses_the_chain_that_carries_it(tmp_path: Path) -> None:
    heavy = '<link name="camera"><inertial><mass value="2"/></inertial></link>'
    path = written(tmp_path, urdf(*six(), *ELSEWHERE["a camera in mm"], links=heavy))
    with pytest.raises(DataError, match=r"joint camera': .*written in mm"):
        import_urdf(path, tip="tool0")
    assert import_urdf(path, tip="link_4").robot.joints == 4


def test_masses_that_are_missing_or_in_other_units_are_named(tmp_path: Path) -> None:
    def arm(kg: str, at: str) -> str:
        body = f'<inertial><origin xyz="{at}"/><mass value="{kg}"/></inertial>'
        return urdf(*six(), links=f'<link name="link_1"/><link name="link_2">{body}</link>')

    remarks = import_urdf(written(tmp_path, arm("7", "0 0 0.1"))).remarks
    named = [remark.split()[3] for remark in remarks if "has a mass" in remark]
    assert named == ["joint_1", "joint_3", "joint_4", "joint_5", "joint_6"]
    assert not any("has a mass" in remark for remark in import_urdf(written(tmp_path, urdf(*six()))).remarks)
    for kg, at, words in (
        ("7000", "0 0 0.1", "7000 kg: written in g"),
        ("7", "0 0 100", "100 m away: written in mm"),
    ):
        with pytest.raises(DataError, match=words):
            import_urdf(written(tmp_path, arm(kg, at)))


def test_a_joint_that_follows_another_is_in_a_joint_matrix(tmp_path: Path) -> None:
    joints = six()
    joints[2] = joints[2].replace("</joint>", '<mimic joint="joint_2" multiplier="-1" offset="0.2"/></joint>')
    text = urdf(*joints)
    found = import_urdf(written(tmp_path, text))
    counted = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 6))
    counted[:, 2] = 0.0
    driven = counted.copy()
    driven[:, 2] = 0.2 - driven[:, 1]
    model = found.robot.model_angles(counted, "mimic")
    np.testing.assert_allclose(model, driven, atol=1e-9)
    there = found.base @ forward(found.robot, model) @ found.tool
    np.testing.assert_allclose(there, reached(text, driven), atol=1e-5)
    assert any("joint_3 follows joint_2 (x -1)" in remark for remark in found.remarks)


def test_a_continuous_joint_gets_a_turn_each_way_and_that_is_said(tmp_path: Path) -> None:
    joints = six()
    joints[5] = joints[5].replace("revolute", "continuous")
    found = import_urdf(written(tmp_path, urdf(*joints)))
    assert np.degrees(found.robot.upper[5]) == pytest.approx(360.0)
    assert any("joint_6 is continuous" in remark for remark in found.remarks)


def test_one_branch_of_a_tree_is_chosen_by_its_links(tmp_path: Path) -> None:
    path = written(tmp_path, urdf(*six(), joint("camera", "fixed", "link_5", "camera", xyz="0 0.1 0")))
    with pytest.raises(DataError, match=r"has 2 ends: camera, tool0\. .*--tip"):
        import_urdf(path)
    assert import_urdf(path, tip="tool0").robot.joints == 6
    assert import_urdf(path, tip="camera").robot.joints == 5
    part = import_urdf(path, base="link_1", tip="tool0")
    assert part.robot.joints == 5


def ends(text: str) -> str:
    return six()[1].replace('lower="-1.9" upper="2.1"', text)


BAD = {
    "limits swapped": (
        lambda: [six()[0], ends('lower="2.1" upper="-1.9"')],
        r"joint_2': has its limits swapped",
    ),
    "limits in degrees": (lambda: [six()[0], ends('lower="-110" upper="110"')], r"they are in deg"),
    "no limits": (lambda: [six()[0], ends("")], r"joint_2': has no limits"),
    "limits equal": (lambda: [six()[0], ends('lower="0" upper="0"')], r"may not move"),
    "no number": (lambda: [six()[0].replace("0.29", "0,29")], r"xyz = '0 0 0,29'"),
    "millimetres": (lambda: [six()[0].replace("0.29", "290")], r"written in mm\?"),
    "not a number": (lambda: [six()[0].replace("0.29", "nan")], r"Give 3 numbers"),
    "no axis": (lambda: [six()[0].replace('xyz="0 0 1"', 'xyz="0 0 0"')], r"axis without a direction"),
    "floating": (
        lambda: [six()[0], joint("free", "floating", "link_1", "link_2"), six()[2]],
        r"several freedoms",
    ),
    "unknown type": (lambda: [six()[0].replace("revolute", "hinge")], r"has the type 'hinge'"),
    "two parents": (
        lambda: [*six()[:2], joint("loop", "fixed", "link_0", "link_2")],
        r"which joint_2 carries too",
    ),
    "two trees": (lambda: [six()[0], joint("other", "fixed", "a", "b")], r"2 links that no joint carries"),
    "twice": (lambda: [six()[0], six()[0]], r"joint joint_1': is there twice"),
    "only fixed": (lambda: [joint("a", "fixed", "link_0", "link_1")], r"no joint that moves"),
    "mimic elsewhere": (
        lambda: [six()[0].replace("</joint>", '<mimic joint="gripper"/></joint>')],
        r"follows the joint 'gripper'",
    ),
    "mimic of itself": (
        lambda: [six()[0].replace("</joint>", '<mimic joint="joint_1"/></joint>')],
        r"follows itself",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_what_no_robot_file_can_hold_is_refused_by_its_joint(what: str, tmp_path: Path) -> None:
    joints, words = BAD[what]
    with pytest.raises(DataError, match=words):
        import_urdf(written(tmp_path, urdf(*joints())))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('<!DOCTYPE r [<!ENTITY a "b">]><robot name="&a;"/>', "document type"),
        ('<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot/>', "document type"),
        ("<robot><link></robot>", "not valid XML"),
        ("<a>" * 40 + "</a>" * 40, "nested more than"),
        ('<sdf version="1.6"/>', "not a URDF"),
        ('<robot name="x"><xacro:include xmlns:xacro="u" filename="b"/></robot>', "xacro"),
        ('<robot name="x"><link name="${prefix}a"/></robot>', "xacro"),
        ("", "not valid XML"),
    ],
)
def test_what_is_no_urdf_is_refused(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=words):
        import_urdf(written(tmp_path, text))
