"""Programs of KUKA, Yaskawa and Staubli with known joints.

They are written from the descriptions of the formats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from calib import CalibratedModel, forward
from tests.service.robot_programs import model_of

PULSES = (1435.2, -1300.5, 1511.0, -900.25, 880.0, 455.5)
TOOL = (5.0, -10.0, 120.0, 10.0, 20.0, 30.0)  # x y z, then C B A of KUKA
BASE = (50.0, 20.0, -15.0, 0.0, 5.0, 40.0)
OPTIONS = {"tool": "1=5,-10,120,10,20,30", "frame": "2=50,20,-15,0,5,40"}


def a_model(maker: str) -> CalibratedModel:
    """The erring IRB 120 under another maker's name."""
    saved = model_of("abb-irb120")
    robot = replace(saved.model.robot, maker=maker)
    return replace(saved, model=replace(saved.model, robot=robot))


def matrix(frame: Sequence[float]) -> np.ndarray:
    """Return the matrix (4, 4) of x, y, z (mm) and turns about the fixed x, y and z axes (deg)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_euler("xyz", frame[3:], degrees=True).as_matrix(), frame[:3]
    return out


def kuka_pos(joints_deg: Sequence[float], *, tool: bool = False, base: bool = False) -> str:
    """The components of an E6POS at which the nominal robot has these joints."""
    robot = model_of("abb-irb120").model.robot
    flange = forward(robot, np.radians([joints_deg]))[0]
    pose = flange @ (matrix(TOOL) if tool else np.eye(4))
    pose = np.linalg.inv(matrix(BASE) if base else np.eye(4)) @ pose
    a, b, c = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
    x, y, z = pose[:3, 3]
    turn = sum(1 << k for k, q in enumerate(joints_deg) if q < 0)
    return f"X {x:.5f},Y {y:.5f},Z {z:.5f},A {a:.5f},B {b:.5f},C {c:.5f},S 2,T {turn}"


JOINTS = ((12.0, -15.0, 20.0, 30.0, 45.0, -60.0), (-40.0, 10.0, -5.0, -80.0, -50.0, 170.0))
AXES = ((10.0, -20.0, 30.0, 0.0, 45.0, 5.0), (-5.5, 12.25, 8.0, 40.0, -30.0, 90.0))


def kuka_axes(joints_deg: Sequence[float]) -> str:
    return ",".join(f"A{k} {q:g}" for k, q in enumerate(joints_deg, start=1))


DAT = (
    "&ACCESS RVP\r\n&REL 3\r\nDEFDAT  CAL PUBLIC\r\n"
    ';FOLD EXTERNAL DECLARATIONS;%{PE}%MKUKATPBASIS ; "{X 1,Y 2}"\r\n'
    'DECL BASIS_SUGG_T LAST_BASIS={POINT1[] "P2   ",CP_PARAMS[] "CPDAT0   "}\r\n;ENDFOLD\r\n'
    "DECL E6POS XP1={" + kuka_pos(JOINTS[0], tool=True) + ",E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}\r\n"
    'DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}\r\n'
    "decl global e6pos XP2={" + kuka_pos(JOINTS[1], tool=True, base=True) + "} ; gr\u00fcn\r\n"
    'DECL FDAT FP2={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " "}\r\n'
    "DECL E6AXIS XHOME={" + kuka_axes(AXES[0]) + ",E1 0.0}\r\n"
    "DECL PDAT PPDAT1={VEL 100.000,ACC 100.000,APO_DIST 100.000}\r\nENDDAT\r\n"
)
SRC = (
    "&ACCESS RVP\nDEF CAL( )\n;FOLD INI\nBAS (#INITMOV,0 )\n;ENDFOLD (INI)\n$BASE=$NULLFRAME\nBAS(#TOOL,1)\n"
    "PTP {" + kuka_axes(AXES[1]) + "} ; {A1 0}\nLIN {" + kuka_pos(JOINTS[0], tool=True) + "} C_DIS\n"
    "$TOOL={X 0,Y 0,Z 0,A 0,B 0,C 0}\n$BASE = BASE_DATA[2]\n"
    "  SPTP {" + kuka_pos(JOINTS[1], base=True) + "}\nWAIT SEC 0.5\nEND\n"
)
JBI = (
    "/JOB\r\n//NAME CAL\r\n//POS\r\n///NPOS 2,2,0,0,0,0\r\n///TOOL 0\r\n///POSTYPE PULSE\r\n///PULSE\r\n"
    + "".join(
        f"C{i:05d}={','.join(str(round(q * p)) for q, p in zip(joints, PULSES, strict=True))}\r\n"
        for i, joints in enumerate(AXES)
    )
    + "BC00000=1000\r\nBC00001=2000\r\n//INST\r\n///DATE 2026/11/22 10:00\r\n///ATTR SC,RW\r\n///GROUP1 RB1,BS1\r\n"
    "NOP\r\n' C00000=1,2,3\r\nMOVJ C00000 BC00000 VJ=10.00\r\nMOVL C00001 BC00001 V=100.0\r\nEND\r\n"
)
DTX = (
    '<?xml version="1.0" encoding="utf-8" ?>\n'
    '<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">\n  <Datas>\n'
    '    <!-- <Data name="jOld" type="jointRx"><Value key="0" j1="1"/></Data> -->\n'
    '    <Data name="nCount" access="private" xsi:type="array" type="num" size="1">\n'
    '      <Value key="0" value="3" />\n    </Data>\n'
    '    <Data name="jHome" access="public" xsi:type="array" type="jointRx" size="2">\n'
    + "".join(
        f'      <Value key="{i}" '
        + " ".join(f'j{k}="{q:g}"' for k, q in enumerate(joints, start=1))
        + " />\n"
        for i, joints in enumerate(AXES)
    )
    + "    </Data>\n  </Datas>\n</Database>\n"
)
PROGRAMS = {
    "a.dat": ("KUKA", DAT),
    "a.src": ("KUKA", SRC),
    "a.jbi": ("Yaskawa", JBI),
    "a.dtx": ("Staubli", DTX),
}
EXPECTED = {
    "a.dat": (JOINTS[0], JOINTS[1], AXES[0]),
    "a.src": (AXES[1], JOINTS[0], JOINTS[1]),
    "a.jbi": AXES,
    "a.dtx": AXES,
}
