"""Print the live values of a cell over OPC UA whenever they change.

pip install asyncua
python read_opcua.py opc.tcp://127.0.0.1:4840 VIEWERS_KEY
"""

import asyncio
import sys

from asyncua import Client

NAMES = ("state", "done", "total", "prompt_text", "reading_world_mm", "result_verdict")


class Printer:
    """Receiver of the changes."""

    def datachange_notification(self, node, value, data) -> None:
        """Print one change."""
        print(node.nodeid.Identifier, value, flush=True)  # noqa: T201


async def main(address: str, key: str) -> None:
    """Subscribe until the program is interrupted."""
    client = Client(address)
    client.set_user("viewer")
    client.set_password(key)
    async with client:
        space = await client.get_namespace_index("urn:truepose:live")
        changes = await client.create_subscription(500, Printer())
        await changes.subscribe_data_change([client.get_node(f"ns={space};s={name}") for name in NAMES])
        await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:3]))
