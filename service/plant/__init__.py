"""The server of a fleet: cells send their documents, people ask how a robot is. Nothing here moves a robot."""

from service.plant.app import FleetServerSettings, create_plant
from service.plant.own_tokens import Senders

__all__ = ["FleetServerSettings", "Senders", "create_plant"]
