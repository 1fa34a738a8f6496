"""URDF files: random trees beside Pinocchio, which reads the same text, and every fault with its line."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lacet.daq.errors import UsageError
from lacet.identify.multibody.chain import Chain
from lacet.identify.multibody.chain_base_parameters import base_parameters
from lacet.identify.multibody.urdf.robot import UrdfError
from lacet.services.render.chain_text import chain_notes


def numbers(values: np.ndarray) -> str:
    """Numbers in full precision."""
    return " ".join(repr(float(v)) for v in values)


def random_urdf(rng: np.random.Generator, n: int) -> str:
    """A random tree of n joints: any axes and origins, parallel and nearly parallel ones, fixed and mimic joints."""
    parts = ['<robot name="any">', '<link name="l0"/>']
    free: list[int] = []
    above: dict[int, list[int]] = {0: []}  # Pinocchio wants the joint that is followed read first: one that carries
    for j in range(1, n + 1):
        kind = str(rng.choice(["revolute", "continuous", "prismatic", "fixed"]))
        rpy = rng.uniform(-3, 3, 3)
        if rng.random() < 0.4:  # quarter turns, and angles beside them
            rpy = rng.choice([0.0, np.pi / 2, -np.pi / 2, np.pi], 3) + rng.choice([0.0, 7e-6, 1e-9])
        axis = rng.normal(size=3) if rng.random() < 0.5 else rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(3)]
        root = rng.normal(size=(3, 3))
        inertia = root @ root.T
        mimic = ""
        parent = int(rng.integers(0, j))
        followed = [k for k in above[parent] if k in free]
        above[j] = [*above[parent], j]
        if kind != "fixed" and followed and rng.random() < 0.5:
            kind = "prismatic" if kind == "prismatic" else "revolute"
            mimic = (
                f'<mimic joint="j{rng.choice(followed)}" multiplier="{rng.uniform(-2, 2)}" offset="{rng.random()}"/>'
            )
        elif kind not in ("fixed", "continuous"):  # Pinocchio has cosine and sine of a continuous joint: none follows
            free.append(j)
        parts.append(
            f'<link name="l{j}"><inertial><origin xyz="{numbers(rng.uniform(-1, 1, 3))}" '
            f'rpy="{numbers(rng.uniform(-3, 3, 3))}"/><mass value="{rng.uniform(0.1, 3)}"/>'
            f'<inertia ixx="{inertia[0, 0]}" ixy="{inertia[0, 1]}" ixz="{inertia[0, 2]}" iyy="{inertia[1, 1]}" '
            f'iyz="{inertia[1, 2]}" izz="{inertia[2, 2]}"/></inertial></link>'
            f'<joint name="j{j}" type="{kind}"><parent link="l{parent}"/><child link="l{j}"/>'
            f'<origin xyz="{numbers(rng.uniform(-1, 1, 3))}" rpy="{numbers(rpy)}"/><axis xyz="{numbers(axis)}"/>'
            f'<limit lower="-9" upper="9" effort="1" velocity="1"/>{mimic}</joint>'
        )
    return "\n".join([*parts, "</robot>"])


def theirs(text: str, names: list[str], q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Torques (N, f) by Pinocchio at the joints of these names."""
    model = pin.buildModelFromXML(text, mimic=True)
    data = model.createData()
    joints = [model.joints[model.getJointId(name)] for name in names]
    out = np.zeros_like(q)
    for s in range(len(q)):
        x, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        for k, joint in enumerate(joints):
            x[joint.idx_q : joint.idx_q + joint.nq] = q[s, k] if joint.nq == 1 else (np.cos(q[s, k]), np.sin(q[s, k]))
            v[joint.idx_v], a[joint.idx_v] = qd[s, k], qdd[s, k]
        tau = pin.rnea(model, data, x, v, a)
        out[s] = [tau[joint.idx_v] for joint in joints]
    return out


@pytest.mark.parametrize("seed", range(40))
def test_random_trees_have_pinocchios_torques(seed: int):
    """Inverse dynamics from the file's inertias, to 1e-9 of the largest torque."""
    rng = np.random.default_rng(seed)
    text = random_urdf(rng, int(rng.integers(1, 10)))
    if text.count('type="fixed"') == text.count("<joint"):
        with pytest.raises(UrdfError, match="no joint of the robot moves"):
            Chain.from_urdf(text)
        return
    chain = Chain.from_urdf(text, gravity=(0.0, 0.0, -9.81))
    free = [chain.names[j - 1] for j in chain.coupling.free]
    q, qd, qdd = rng.uniform(-2, 2, (3, 4, len(free)))
    parameters = {name: value for name, value in chain.given.items() if not name.startswith(("FV", "FS"))}
    ours = chain.coupling.torques(chain.inverse_dynamics(*chain.coupling.states(q, qd, qdd), parameters))
    expected = theirs(text, free, q, qd, qdd)
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-9 * max(1.0, np.max(np.abs(expected))))


ARM = """<robot name="arm">
<link name="base"/>
<link name="upper"><inertial><mass value="2"/><origin xyz="0 0 0.1"/>
  <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.01"/></inertial></link>
<link name="tool"><inertial><mass value="0.5"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>
</link><joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin rpy="1.5708 0 0"/>
  <axis xyz="0 0 1"/><dynamics damping="0.7" friction="0.2"/></joint>
<joint name="flange" type="fixed"><parent link="upper"/><child link="tool"/><origin xyz="0 0 0.4"/></joint>
</robot>"""


def test_what_a_file_says_beside_geometry():
    """Starting parameters, friction, joined links, names, and the angle that is nearly right."""
    chain = Chain.from_urdf(ARM)
    assert chain.names == ("shoulder",)
    assert {k: chain.given[k] for k in ("M1", "FV1", "FS1")} == {"M1": 2.5, "FV1": 0.7, "FS1": 0.2}
    assert chain.given["MZ1"] == pytest.approx(2 * 0.1 + 0.5 * 0.4)
    assert chain.given["XX1"] == pytest.approx(0.1 + 2 * 0.01 + 0.5 * 0.16)
    assert chain_notes(chain.notes) == [
        "link(s) tool on fixed joints are part of the body that carries them",
        "angles of joint 'shoulder' are up to 4e-06 rad off a quarter turn: taken as they are; "
        "rounding=1e-05 takes them as quarter turns",
    ]
    exact = Chain.from_urdf(ARM, rounding=1e-5)
    assert exact.joints[0].alpha == np.pi / 2
    assert len(exact.notes) == 1
    assert chain.joints[0].alpha == pytest.approx(1.5708, abs=1e-12)


def test_a_usual_arm_has_the_usual_table(tmp_path):
    """Quarter turns and offsets are the entries one would write by hand, from a file too."""
    text = """<robot name="two"><link name="a"/><link name="b"><inertial><mass value="1"/></inertial></link>
    <link name="c"><inertial><mass value="1"/></inertial></link>
    <joint name="one" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
    <joint name="two" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
    <origin xyz="0.5 0.2 0" rpy="-1.57079632679 0 0"/></joint></robot>"""
    file = tmp_path / "two.urdf"
    file.write_text(text, encoding="utf-8")
    joint = Chain.from_urdf(file).joints[1]
    assert (joint.gamma, joint.b, joint.alpha, joint.theta) == (0.0, 0.0, -np.pi / 2, 0.0)
    assert (joint.d, joint.r) == (0.5, 0.2)
    assert base_parameters(Chain.from_urdf(file)).relation(0) == "ZZ1 + YY2 + 2*r2*MZ2 + (d2**2 + r2**2)*M2"


AGAIN = '<joint name="again" type="fixed"><parent link="base"/><child link="tool"/></joint>'
FAULTS = {
    "loop": (ARM.replace("</robot>", f'{AGAIN}</robot>'),
             "line 9: link 'tool' hangs on two joints, 'flange' (line 8) and 'again': a closed loop"),
    "circle": ('<robot name="x">\n<link name="r"/><link name="a"/><link name="b"/>\n'
               '<joint name="p" type="fixed"><parent link="a"/><child link="b"/></joint>\n'
               '<joint name="q" type="fixed"><parent link="b"/><child link="a"/></joint></robot>',
               "line 3: joints 'p', 'q' carry each other in a closed loop"),
    "missing link": (ARM.replace('<child link="tool"/>', '<child link="tol"/>'),
                     "line 8: joint 'flange': its child link 'tol' is not in the file; did you mean 'tool'?"),
    "planar": (ARM.replace("revolute", "planar"), "line 6: joint 'shoulder' is planar: not supported"),
    "floating": (ARM.replace("revolute", "floating"), "line 6: joint 'shoulder' is floating: not supported"),
    "type": (ARM.replace('"revolute"', '"revolut"'), "has the type 'revolut'; did you mean 'revolute'?"),
    "axis": (ARM.replace("0 0 1\"/><dyn", "0 0 0\"/><dyn"), "line 6: joint 'shoulder': the axis has no length"),
    "number": (ARM.replace('value="2"', 'value="two"'), "line 3: <mass> value must be a number, found 'two'"),
    "mimic": (ARM.replace('<dynamics', '<mimic joint="elbow"/><dynamics'), "line 7: joint 'shoulder' follows 'elbow'"),
    "two roots": (ARM.replace('<link name="base"/>', '<link name="base"/><link name="spare"/>'),
                  "line 2: link 'spare' hangs on no joint"),
    "twice": (ARM.replace('<link name="base"/>', '<link name="base"/>\n<link name="base"/>'),
              "line 3: link 'base' is there already, in line 2"),
    "xacro": (ARM.replace("<link name=\"base\"/>", "<xacro:include/>", 1), "line 2: <xacro:include> is xacro"),
    "no XML": ("<robot>\n<link", "this is no XML"),
    "another": ("<mujoco/>", "line 1: a URDF begins with <robot>, found <mujoco>"),
    "entities": ('<!DOCTYPE x [<!ENTITY a "b">]><robot/>', "line 1: a document type is not read"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_is_named_with_its_line(name: str):
    """What was found, where, and what is nearest to it."""
    text, message = FAULTS[name]
    with pytest.raises(UrdfError) as raised:
        Chain.from_urdf(text)
    assert message in str(raised.value)


def test_a_file_that_is_not_there():
    """A path that holds nothing is no text either."""
    with pytest.raises(UsageError, match=r"nothing\.urdf"):
        Chain.from_urdf("nothing.urdf")
