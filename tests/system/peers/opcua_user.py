"""A client of OPC UA by others (PyPI `asyncua`) at the simulated machine.

Usage: opcua_user.py PORT

Reads and subscribes X, Y and Z, and prints as one line of JSON: namespaces, names below Objects, values with status and source
timestamp of one read, identifiers of the units, how many changes of X came within a second, and what came of a write.
"""

import asyncio
import json
import sys

from asyncua import Client, ua

NAMESPACE = "urn:abbe:simulated-machine"


class Changes:
    def __init__(self):
        self.values = []

    def datachange_notification(self, _node, value, _data):
        self.values.append(value)


async def main(port):
    async with Client(f"opc.tcp://127.0.0.1:{port}", timeout=20) as client:
        namespaces = await client.get_namespace_array()
        place = await client.get_namespace_index(NAMESPACE)
        axes = [client.get_node(f"ns={place};s={name}") for name in "XYZ"]
        children = await client.nodes.objects.get_children()
        names = [(await child.read_browse_name()).Name for child in children]
        told = await client.uaclient.read_attributes([axis.nodeid for axis in axes], ua.AttributeIds.Value)
        units = [await (await axis.get_child("0:EngineeringUnits")).read_value() for axis in axes]
        changes = Changes()
        subscription = await client.create_subscription(50, changes)
        await subscription.subscribe_data_change(axes[0])
        await asyncio.sleep(1.5)
        try:
            await axes[0].write_value(1.0)
            write = "taken"
        except ua.UaStatusCodeError as error:
            write = str(error)
        print(
            json.dumps(
                {
                    "namespaces": namespaces,
                    "names": names,
                    "values": [value.Value.Value for value in told],
                    "good": [value.StatusCode is None or value.StatusCode.is_good() for value in told],
                    "stamps": [value.SourceTimestamp.isoformat() for value in told],
                    "units": [[unit.NamespaceUri, unit.UnitId] for unit in units],
                    "changes": len(changes.values),
                    "write": write,
                }
            )
        )


asyncio.run(main(int(sys.argv[1])))
