"""Credentials: who one is on the bus, and what each of the others may do there.

Zenoh does not filter a session by its own rules, so that each end has rules for the other: a car that is its own
router is held to its own name by the worker's rules alone.
"""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cryptography import x509

from lacet.daq.bus.certificates import (
    CA_FILE,
    CERTIFICATE_FILE,
    KEY_FILE,
    NAMES_FILE,
    Names,
    Role,
    common_name,
)
from lacet.daq.errors import UsageError

_DECLARE = ("declare_subscriber", "declare_queryable", "declare_liveliness_subscriber")
_ASK = ("query", "liveliness_query")
_SEND = ("put", "reply", "liveliness_token")
_ALL = (*_DECLARE, *_ASK, *_SEND)
_ADDRESS = re.compile(r"(tcp|udp|tls|quic|ws)/[^\s/]+:\d{1,5}([?#]\S*)?")
"""A Zenoh address: protocol, host and port, and options."""


@dataclass(frozen=True)
class Credentials:
    """Credentials of one holder: a folder that `lacet keys` made.

    Attributes
    ----------
    name : the name in its certificate.
    role : what it may do.
    names : everybody's names.
    """

    folder: Path
    name: str
    role: Role
    names: Names

    @staticmethod
    def load(folder: Path) -> Credentials:
        """The credentials in a folder. Raises UsageError when they are not whole, or have expired."""
        faults = [name for name in (CA_FILE, CERTIFICATE_FILE, KEY_FILE, NAMES_FILE) if not (folder / name).is_file()]
        if faults:
            raise UsageError(
                f"{folder}: no keys, {', '.join(faults)} missing: make them with `lacet keys` (docs/bus.md)"
            )
        try:
            certificate = x509.load_pem_x509_certificate((folder / CERTIFICATE_FILE).read_bytes())
        except (OSError, ValueError) as error:
            raise UsageError(f"{folder / CERTIFICATE_FILE}: cannot be read ({error})") from None
        names, name = Names.read(folder / NAMES_FILE), common_name(certificate)
        if name not in names.roles:
            raise UsageError(f"{folder}: '{name}' is not in {NAMES_FILE} (any more): make keys anew with `lacet keys`")
        if certificate.not_valid_after_utc < datetime.now(UTC):
            end = f"{certificate.not_valid_after_utc:%Y-%m-%d}"
            raise UsageError(
                f"{folder}: the certificate of '{name}' expired on {end}: make another with "
                f"`lacet keys DIR --{names.roles[name]} {name}`"
            )
        return Credentials(folder.absolute(), name, names.roles[name], names)

    def require(self, role: Role) -> Credentials:
        """These credentials, if they are of that role. Raises UsageError."""
        if self.role is not role:
            raise UsageError(
                f"{self.folder}: the keys of the {self.role} '{self.name}'; here a {role}'s are needed: "
                f"`lacet keys DIR --{role} NAME`"
            )
        return self

    def settings(self) -> dict[str, Any]:
        """Zenoh's settings: mutual TLS, and access control by the names in certificates."""
        own = {"certificate": CERTIFICATE_FILE, "private_key": KEY_FILE}
        files = {
            f"{side}_{part}": str(self.folder / file) for side in ("listen", "connect") for part, file in own.items()
        }
        tls = {
            "root_ca_certificate": str(self.folder / CA_FILE),
            **files,
            "enable_mtls": True,
            "verify_name_on_connect": False,  # that would be the address; names are held to their rules
            "close_link_on_expiration": True,
        }
        return {"transport/link/tls": tls, "access_control": access_control(self.names)}


def access_control(names: Names) -> dict[str, Any]:
    """Zenoh's access control for the session of any holder: what every other may send to it and receive from it."""
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for name, role in sorted(names.roles.items()):
        own: list[str] = []
        for flow, messages, keys in _allowed(name, role):
            own.append(f"{name} {len(own)}")
            rules.append(
                {"id": own[-1], "flows": [flow], "messages": list(messages), "key_exprs": keys, "permission": "allow"}
            )
        policies.append({"rules": own, "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": [name]} for name in sorted(names.roles)],
        "policies": policies,
    }


def _allowed(name: str, role: Role) -> list[tuple[str, tuple[str, ...], list[str]]]:
    """(flow, kinds of messages, keys) allowed between anybody and that holder; ``ingress`` is what it sends."""
    everything, runs = ["lacet/**"], f"lacet/{name}/*"
    match role:
        case Role.CAR:
            data = [f"{runs}/{part}" for part in ("start", "block/*", "ledger", "manifest", "alive", "mark")]
            return [
                ("ingress", (*_SEND, "declare_queryable"), data),
                ("ingress", ("declare_subscriber",), [f"{runs}/ack/*"]),
                ("ingress", ("query",), [f"{runs}/mark"]),  # `lacet mark` in the car itself
                ("egress", ("reply",), [f"{runs}/mark"]),
                ("egress", (*_DECLARE, *_ASK), everything),
                ("egress", ("put",), [f"{runs}/ack/*"]),
            ]
        case Role.WORKER:
            results = [f"lacet/*/*/{part}/{name}" for part in ("ack", "result", "claim", "working")]
            return [
                ("ingress", (*_DECLARE, *_ASK), everything),
                ("ingress", _SEND, results),
                ("egress", _ALL, everything),
            ]
        case Role.ROUTER:
            return [("ingress", _ALL, everything), ("egress", _ALL, everything)]


def check_endpoint(endpoint: str, credentials: Credentials | None) -> None:
    """Raise UsageError for what is no address, for one beyond this machine without keys, and without TLS with keys."""
    protocol, _, place = endpoint.partition("/")
    if not _ADDRESS.fullmatch(endpoint):
        raise UsageError(f"{endpoint} is no address of a router: write tcp/HOST:PORT, for example tcp/localhost:7447")
    if credentials is not None and protocol != "tls":
        raise UsageError(f"{endpoint}: with --keys an address begins with tls/, for example tls/{place}")
    if credentials is None and not (protocol == "tcp" and _is_loopback(place)):
        raise UsageError(
            f"{endpoint} is not on this machine alone, and without keys anybody who reaches it reads and writes "
            "everything: make keys with `lacet keys DIR --car NAME --worker NAME`, and give "
            f"tls/{place} with --keys DIR/NAME (docs/bus.md)"
        )


def _is_loopback(place: str) -> bool:
    host = place.partition("#")[0].partition("?")[0].rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
