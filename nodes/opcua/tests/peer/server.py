"""A server of OPC UA that is not ours: axes X, Y, Z and a sensor T, which say what standard input tells them to.

Arguments: port, and a JSON object: "units" (node: identifier of UNECE, or a text for another namespace), "user" and "password",
"folder" (own.der and own.pem are made there), "missing" (nodes that are not there), "cnc" (interfaces of OPC 40502 by name, each with axes
by name: "places" of PosDirect and PosIndirect, "unit", "rotational", "referenced"; "Mill.X.PosDirect" is then a node as X is).
Input: a JSON list a line, of [node, value or null, milliseconds since 1970 or null, status code]; "flood" N: that many values of each axis.
Output: "ready" when it serves, then a line for each line of input.
"""

import asyncio
import datetime
import gc
import json
import logging
import socket
import sys
from pathlib import Path

from asyncua import Server, ua
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from asyncua.crypto.permission_rules import User, UserRole
from cryptography.x509.oid import ExtendedKeyUsageOID

UNECE = "http://www.opcfoundation.org/UA/units/un/cefact"
logging.disable(logging.CRITICAL)
# It lives for moments: a third of them went into looking for garbage while the standard's nodes are made.
gc.disable()


class One:
    """Takes one user with one password; without a name, everybody."""

    def __init__(self, name, password):
        self.name, self.password = name, password

    def get_user(self, iserver, username=None, password=None, certificate=None):
        if isinstance(password, bytes):
            password = password.decode()
        if self.name is None or (username, password) == (self.name, self.password):
            return User(role=UserRole.User)
        return None


def value(number, at_ms, status):
    kind = ua.VariantType.String if isinstance(number, str) else ua.VariantType.Double
    at = None
    if at_ms is not None:
        at = datetime.datetime.fromtimestamp(0, datetime.timezone.utc) + datetime.timedelta(milliseconds=at_ms)
    return ua.DataValue(ua.Variant(number, kind) if number is not None else ua.Variant(),
                        ua.StatusCode(status), SourceTimestamp=at)


async def add_cnc(objects, space, namespace, interfaces, nodes):
    """Interfaces of OPC 40502 in a folder, with browse names as the specification has them."""
    shop = await objects.add_folder(space, "Shop")
    for interface, axes in interfaces.items():
        own = await shop.add_object(space, interface)
        every = await own.add_object(ua.NodeId(f"{interface}.axes", space), ua.QualifiedName("CncAxisList", namespace))
        for name, asked in axes.items():
            axis = await every.add_object(ua.NodeId(f"{interface}.{name}", space), ua.QualifiedName(name, space))
            for key, told in (("rotational", "IsRotational"), ("referenced", "IsReferenced")):
                if key in asked:
                    await axis.add_variable(ua.NodeId(f"{interface}.{name}.{told}", space), ua.QualifiedName(told, namespace), asked[key])
            for place in asked.get("places", ["PosDirect"]):
                text = f"{interface}.{name}.{place}"
                position = await axis.add_variable(ua.NodeId(text + ".all", space), ua.QualifiedName(place, namespace), 0.0)
                actual = await position.add_variable(
                    ua.NodeId(text, space), ua.QualifiedName("ActPos", namespace), 0.0, ua.VariantType.Double)
                if "unit" in asked:
                    told = ua.EUInformation(UNECE, asked["unit"], ua.LocalizedText(name), ua.LocalizedText(name))
                    await position.add_property(
                        ua.NodeId(text + ".unit", space), ua.QualifiedName("EngineeringUnits", namespace), told)
                nodes[text] = actual


async def main():
    port, asked = int(sys.argv[1]), json.loads(sys.argv[2])
    server = Server(user_manager=One(asked.get("user"), asked.get("password")))
    await server.init()
    server.set_endpoint(f"opc.tcp://127.0.0.1:{port}/test")
    policies = [ua.SecurityPolicyType.NoSecurity]
    if "folder" in asked:
        uri, folder = "urn:peer:server", Path(asked["folder"])
        await server.set_application_uri(uri)
        await setup_self_signed_certificate(
            folder / "own.pem", folder / "own.der", uri, "127.0.0.1",
            [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH], {"commonName": "Peer"})
        await server.load_certificate(str(folder / "own.der"))
        await server.load_private_key(str(folder / "own.pem"))
        kinds = ["Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"]
        policies = [getattr(ua.SecurityPolicyType, f"{kind}_{mode}") for kind in kinds for mode in ("Sign", "SignAndEncrypt")]
    server.set_security_policy(policies)
    if asked.get("user"):
        server.set_identity_tokens([ua.UserNameIdentityToken])
    space = await server.register_namespace("urn:peer:axes")
    nodes = {}
    for name in "XYZT":
        if name in asked.get("missing", []):
            continue
        node = await server.nodes.objects.add_variable(ua.NodeId(name, space), name, 0.0, ua.VariantType.Double)
        unit = asked.get("units", {}).get(name)
        if unit is not None:
            namespace, number = (UNECE, unit) if isinstance(unit, int) else (unit, 1)
            told = ua.EUInformation(namespace, number, ua.LocalizedText(name), ua.LocalizedText(name))
            await node.add_property(ua.NodeId(f"{name}.unit", space), ua.QualifiedName("EngineeringUnits", 0), told)
        nodes[name] = node
    if "cnc" in asked:
        namespace = await server.register_namespace("http://opcfoundation.org/UA/CNC")
        await add_cnc(server.nodes.objects, space, namespace, asked["cnc"], nodes)
    lines = asyncio.Queue()
    loop = asyncio.get_running_loop()
    async with server:
        print("ready", flush=True)
        reader = asyncio.StreamReader()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        while line := await reader.readline():
            told = json.loads(line)
            if told and told[0] == "flood":
                for k in range(told[1]):
                    for name in "XYZ":
                        await nodes[name].write_value(value(float(k), told[2] + k, 0))
            else:
                for name, number, at_ms, status in told:
                    await server.write_attribute_value(nodes[name].nodeid, value(number, at_ms, status))
            print("done", flush=True)


asyncio.run(main())
