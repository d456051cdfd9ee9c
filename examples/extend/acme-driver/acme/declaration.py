"""Declaration of the driver of Acme's controllers. It has not been run on hardware yet."""

from acme.arm import AcmeArm
from drivers import RobotDriver

DRIVERS = (RobotDriver(name="acme", make=AcmeArm),)
