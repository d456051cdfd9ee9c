"""Small programs of every dialect, written from the grammars.

Robot models to correct them with are here too.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib import CalibratedModel, load_robot
from calib.arm import gravity_torques
from calib.array import Array
from tests.calib.chain import chain
from tests.calib.errant import only_geometry

EXT = "[9E9,9E9,9E9,9E9,9E9,9E9]"

RAPID = f"""%%%
  VERSION:1
  LANGUAGE:ENGLISH
%%%
MODULE CalTargets
  ! CONST robtarget fake:=[[1,2,3]];   a comment is no declaration
  CONST num zSafe:=520;
  CONST string say:="MoveL fake, v100; ! not a comment";
  PERS tooldata tGrip:=[TRUE,[[10,-20,125],[0.9238795,0,0.3826834,0]],[2.7,[50,25,100],[1,0,0,0],0,0,0]];
  TASK PERS wobjdata wTable := [FALSE,TRUE,"",[[100,-50,20],[0.999048222,0,0,0.043619387]],[[0,0,5],[1,0,0,0]]];
  CONST jointtarget j1:=[[10,-20,30,0,45,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  LOCAL CONST robtarget p1:=[[250.123,80.5,250.25],[0,0.7071068,0.7071068,0],[0,-1,1,0],{EXT}];
  CONST robtarget p2:=[[380,0,zSafe],
      [0.5,0,0.8660254,0],   ! continued
      [0,0,0,0],{EXT}];
  VAR jointtarget path{{2}}:=[[[1,2,3,4,-35,6],{EXT}],
     [[10,20,-30,40,50,60],{EXT}]];
  PROC main()
    VAR num count:=0;
    MoveAbsJ j1\\NoEOffs, v100, fine, tool0\\WObj:=wobj0;
    MOVEJ P1, v100, fine, tGrip\\WObj:=wTable;
    MoveL Offs(p2,0,0,50), v100, z10, tool0;
    FOR i FROM 1 TO 2 DO MoveAbsJ path{{i}},v50,fine,tool0; ENDFOR
    MoveAbsJ [[82.467,-17.016,48.414,85.948,96.306,-31.779],{EXT}]\\ID:=0,v50,fine,tool0;
    count:=count+1;
  ENDPROC
  PROC other(PERS tooldata t, num n)
    TPWrite "n"\\Num:=n;
  ENDPROC
ENDMODULE
"""

LS = """/PROG  CALPROG
/ATTR
OWNER\t\t= MNEDITOR;
COMMENT\t\t= "CAL";
LINE_COUNT\t= 3;
DEFAULT_GROUP\t= 1,*,*,*,*;
/APPL
/MN
   1:J P[1] 10% FINE    ;
   2:L P[2] 100mm/sec FINE    ;
   3:C P[4]
    :  P[2] 100mm/sec FINE    ;
/POS
P[1]{
   GP1:
\tUF : 0, UT : 1,\t
\tJ1=    10.500 deg,\tJ2=   -20.250 deg,\tJ3=    30.125 deg,
\tJ4=     0.000 deg,\tJ5=   -45.500 deg,\tJ6=    90.000 deg
   GP2:
\tUF : 0, UT : 1,
\tJ1=     5.000 deg
};
P[2:"name"]{
   GP1:
\tUF : 2, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =   300.000  mm,\tY =   -12.500  mm,\tZ =   100.000  mm,
\tW =   180.000 deg,\tP =     -.131 deg,\tR =   -90.000 deg
};
P[3]{
   GP1:
\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =  ********  mm,\tY =  ********  mm,\tZ =  ********  mm,
\tW =  ******** deg,\tP =  ******** deg,\tR =  ******** deg
};
P[4:bare]{
   GP1:
    UF : 0, UT : 1, CONFIG : 'F U T, 0, 0, 0',
    X = 400.000 mm, Y = 50.000 mm, Z = 100.000 mm,
    W = 170.000 deg, P = 5.000 deg, R = 20.000 deg
};
/END
"""

SCRIPT = """def prog():
  set_tcp(p[0.01, 0, 0.1, 0, 0.2, 0])
  home = [0.1, -1.57, 1.2, d2r(-40), -1.2, 0.0]   # [1,2,3,4,5,6]
  p2=p[-0.4, -0.2, 0.3, 0.0, 3.14, 0.1]
  textmsg("movej([0,0,0,0,0,0])")
  movej(home, a=1.4, v=1.05)
  movel(p2, a=1.2)
  movec(p[-0.42, -0.22, 0.32, 0.1, 3.0, 0.0], p[-0.45, -0.25, 0.35, 0.1, 3.0, 0.0], a=1.2, v=0.25, r=0.05)
  movej([0.5, -1.2, 1.0, -0.5, -1.3, 0.2])
end
"""

TABLE = """target_id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg,x_mm,y_mm,z_mm,rot_w,rot_x,rot_y,rot_z,config,comment
a,10,20,-30,40,50,60,,,,,,,,,"hello, you"
b,,,,,,,380,50,400,0,0.7071068,0.7071068,0,front/up/noflip,x
"""

PROGRAMS = {
    "abb-irb120": (("a.mod", RAPID), ("t.csv", TABLE)),
    "fanuc-lrmate200ic": (("a.ls", LS),),
    "ur5": (("a.script", SCRIPT),),
}
COUPLING = {"fanuc-lrmate200ic": "fanuc-j23"}


def model_of(name: str, seed: int = 3, scale: float = 1.0) -> CalibratedModel:
    """Return a robot's base model with errors of tenths of a mm and hundredths of a degree.

    The errors are multiplied by `scale`.
    """
    robot = load_robot(name)
    model, estimate = only_geometry(robot, seed)
    return CalibratedModel(
        model=model,
        estimate=scale * estimate,
        covariance=np.zeros((len(estimate), len(estimate))),
        loads=robot.loads,
        gravity=(0.0, 0.0, -9.81),
        coupling=COUPLING.get(name, "none"),
        data_sha256="",
        holds_for={"approach": ["from below"] * 6, "temperature_c": 22.0},
    )


def real_flange(saved: CalibratedModel, joints: Array) -> Array:
    """Calculate the pose of the real robot's flange, shape (4, 4), with the slow second chain.

    `joints` are model angles of shape (6,), rad.
    """
    add: dict[str, float] = {}
    torque = gravity_torques(saved.model.robot, joints[None])[0]
    for parameter, value in zip(saved.model.parameters, saved.estimate, strict=True):
        slot, amount = parameter.name, float(value)
        if slot[0] == "c" and slot[1:].isdigit():
            slot, amount = f"theta{slot[1:]}", amount * torque[int(slot[1:]) - 1]
        add[slot] = add.get(slot, 0.0) + amount
    return chain(saved.model.robot, joints, add).real


def write(folder: Path, name: str, text: str) -> Path:
    """A program file with its line ends as they are."""
    path = folder / name
    path.write_bytes(text.encode("utf-8"))
    return path
