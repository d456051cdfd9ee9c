"""Every robot driver on every wire, over its simulator, for tests of the common behaviour."""

from dataclasses import dataclass, field, replace
from typing import Any

from drivers import (
    AbbDeadlines,
    AbbSimpleDeadlines,
    FanucDeadlines,
    UrDeadlines,
    YaskawaDeadlines,
    open_robot,
)
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.yaskawa.controller import MAX_DEG_S, PULSES_PER_DEG


@dataclass(frozen=True)
class Bench:
    """One driver on one wire.

    A busy machine keeps the deadlines in `patient`. The end of a move must fail with `quick`, and a connection with
    `hasty`. `identity` holds the maker, model and dialect that the driver must report.
    """

    driver: str
    device: str
    identity: tuple[str, str, str]
    patient: Any
    quick: Any
    hasty: Any
    query: str = ""
    robot: str = "abb-irb120"
    stock: bool = False
    far: tuple[float, ...] = (90.0, 60.0, 30.0, 40.0, 50.0, 60.0)
    more: dict[str, Any] = field(default_factory=dict)

    def cell(self, time_scale: float) -> CellThread:
        file = CellFile(robot=self.robot, time_scale=time_scale, effects=("none",))
        return CellThread(file, stock=self.stock, devices=(self.driver,))

    def arm(self, cell: CellThread, **options: Any) -> Any:
        """The driver on its simulator, connected."""
        given = {"deadlines": self.patient, **self.more, **options}
        arm = open_robot(self.driver, cell.url(self.device) + self.query, **given)
        arm.connect()
        return arm


IRB_120 = ("ABB", "IRB 120-3/0.6", "calsrv")
ABB = Bench("abb", "abb", IRB_120, AbbDeadlines(), AbbDeadlines(), AbbDeadlines(ping_s=0.4))
SIMPLE = AbbSimpleDeadlines()
WAITS = FanucDeadlines(connect_s=30, reply_s=30, stop_s=30, settle_s=30, move_margin_s=60, gap_s=0.001)
FANUC = Bench(
    "fanuc",
    "fanuc",
    ("Fanuc", "LR Mate 200iC", "mappdk-cal"),
    WAITS,
    replace(WAITS, settle_s=0.2),
    FanucDeadlines(connect_s=0.3),
    robot="fanuc-lrmate200ic",
)
PATIENT = UrDeadlines(connect_s=30.0, reply_s=30.0, start_s=30.0, stop_s=30.0, settle_s=30.0)
UR = Bench(
    "ur",
    "ur",
    ("Universal Robots", "UR5", "rtde"),
    PATIENT,
    PATIENT,
    PATIENT,
    robot="ur5",
    far=(90.0, -60.0, 30.0, 40.0, 50.0, 60.0),
    more={"watchdog_s": 30.0},
)
CALM = YaskawaDeadlines(reply_s=5.0, start_s=30.0, settle_s=30.0, move_margin_s=60.0, gap_s=0.001)
BENCHES = {
    "abb": ABB,
    "abb-stock": replace(ABB, stock=True, identity=(*IRB_120[:2], "open_abb")),
    "abb-simple": Bench(
        "abb-simple",
        "abb-simple",
        ("ABB", "", "simple_message"),
        SIMPLE,
        replace(SIMPLE, settle_s=0.3, still_s=0.2),
        replace(SIMPLE, reply_s=0.4, takeover_s=0.2),
    ),
    "rmi": replace(
        FANUC,
        driver="fanuc-rmi",
        device="fanuc-rmi",
        identity=("Fanuc", "", "rmi"),
        hasty=FanucDeadlines(reply_s=0.3, takeover_s=0.1),
    ),
    "mappdk": replace(FANUC, stock=True, identity=("Fanuc", "", "mappdk")),
    "mappdk-cal": FANUC,
    **{
        f"modbus-{kind}": replace(
            FANUC,
            device=f"fanuc-modbus-{kind}",
            query=f"?modbus={kind}",
            identity=("Fanuc", "", f"modbus-{kind}"),
        )
        for kind in ("hmi", "io")
    },
    "ur-rtde": UR,
    "yaskawa": Bench(
        "yaskawa",
        "yaskawa",
        ("Yaskawa", "GP7", "hses"),
        CALM,
        replace(CALM, settle_s=0.2),
        YaskawaDeadlines(reply_s=0.3, tries=1),
        robot="yaskawa-gp7",
        more={"pulses_per_deg": PULSES_PER_DEG, "max_deg_s": MAX_DEG_S},
    ),
    "ur-realtime": replace(UR, query="?feed=realtime", identity=(*UR.identity[:2], "realtime")),
    "ur-primary": replace(UR, query="?feed=primary", identity=(*UR.identity[:2], "primary")),
}
FANUC_WIRES = ["mappdk", "mappdk-cal", "modbus-hmi", "modbus-io", "rmi"]
STOPPABLE = [
    "abb",
    "abb-simple",
    "mappdk-cal",
    "modbus-hmi",
    "modbus-io",
    "rmi",
    "yaskawa",
]  # of a UR: test_ur_stop.py
REPORTING = [*STOPPABLE, "abb-stock", "mappdk"]  # the end of a move; a UR's is seen in its states: test_ur.py
