"""The cells of the simulation: robot, instrument, and three poses that the robot can reach."""

from __future__ import annotations

IRB = """
[robot]
model = "abb-irb120"
driver = "ROBOT"
url = "tcp://127.0.0.1:ROBOT_PORT"
speed_mm_s = 500.0
speed_deg_s = 20.0
limits_deg = [[-90, 90], [0, 110], [-80, 70], [-150, 150], [-90, 90], [-180, 180]]
table_z_mm = 20.0
[world]
nests = { N1 = [0.0, 0.0, 0.0], N2 = [600.0, 0.0, 0.0], N3 = [0.0, 600.0, 0.0] }
[tool]
targets = { T1 = [0.0, 0.0, 125.0] }
mass_kg = 2.7
cog_mm = [50.0, 25.0, 100.0]
"""
IRB_POSES = (
    (10.0, 50.0, -20.0, 20.0, 30.0, 10.0),
    (-25.0, 45.0, -10.0, -40.0, 35.0, 60.0),
    (30.0, 60.0, -30.0, 5.0, 40.0, 0.0),
)
UR = """
[robot]
model = "ur5"
driver = "ROBOT"
url = "tcp://127.0.0.1:ROBOT_PORT"
speed_mm_s = 250.0
speed_deg_s = 20.0
limits_deg = [[-120, 120], [-170, -10], [-140, 140], [-180, 180], [-170, 170], [-180, 180]]
table_z_mm = 30.0
[world]
nests = { N1 = [700.0, -500.0, 0.0], N2 = [700.0, 500.0, 0.0], N3 = [-500.0, -500.0, 0.0] }
[tool]
targets = { T1 = [55.0, 0.0, 169.5] }
mass_kg = 0.5
cog_mm = [0.0, 0.0, 80.0]
"""
UR_POSES = (
    (10.0, -80.0, 70.0, -60.0, -60.0, 10.0),
    (-25.0, -95.0, 90.0, -40.0, -80.0, 60.0),
    (30.0, -70.0, 60.0, -75.0, -70.0, 0.0),
)
REST = """
[instrument]
driver = "TRACKER"
url = "tcp://127.0.0.1:TRACKER_PORT"
station_mm = [2400.0, -900.0, 350.0]
one_smr = ONE_SMR
[simulation]
seed = 1
serial = "120-500001"
effects = ["none"]
"""
CELLS = (
    ("abb", "faro", IRB, IRB_POSES),
    ("abb", "faro", IRB, IRB_POSES),
    ("abb-simple", "leica", IRB, IRB_POSES),
    ("ur", "leica", UR, UR_POSES),
)
