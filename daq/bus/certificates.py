"""Certificates of the bus: an authority of one's own, and cars, workers and routers that it certifies by name.

A name is not an address: cars change theirs. `daq.bus.credentials` reads what is made here.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from lacet.daq.errors import UsageError

DAYS = 730
"""Validity of a certificate [days]."""
AUTHORITY_DAYS = 7300
"""Validity of the authority's own certificate [days]."""
AUTHORITY = "authority"
"""Folder of the authority, whose key stays where it was made."""
CA_FILE, CERTIFICATE_FILE, KEY_FILE, NAMES_FILE = "authority.pem", "certificate.pem", "key.pem", "names.json"
NAMES_FORMAT = "lacet-names 1"
EARLIER = timedelta(days=1)
"""Time by which a certificate is valid before it was made: clocks of cars differ."""

_USAGES = (
    "digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement",
    "encipher_only", "decipher_only",
)  # fmt: skip
_NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,62}")


class Role(StrEnum):
    """What a certificate's holder may do on the bus."""

    CAR = "car"
    WORKER = "worker"
    ROUTER = "router"


@dataclass(frozen=True)
class Names:
    """Names of all holders by role: one on no list may do nothing, whatever certificate it has."""

    roles: dict[str, Role]

    def of(self, role: Role) -> list[str]:
        """The names with a role."""
        return sorted(name for name, found in self.roles.items() if found is role)

    def write(self, path: Path) -> None:
        """Write the names as JSON."""
        content: dict[str, Any] = {"format": NAMES_FORMAT, **{f"{role}s": self.of(role) for role in Role}}
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")

    @staticmethod
    def read(path: Path) -> Names:
        """The names in a file that `write` wrote. Raises UsageError when it is none."""
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if content["format"] != NAMES_FORMAT:
                raise ValueError(content["format"])
            return Names({str(name): role for role in Role for name in content[f"{role}s"]})
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UsageError(f"{path}: no list of names as `lacet keys` writes it ({error})") from None


def check_name(name: str) -> str:
    """`name`, if it can stand in a certificate, a key and a path. Raises UsageError."""
    if not _NAME.fullmatch(name) or name == AUTHORITY:
        raise UsageError(f"name {name!r}: small letters, digits, '-', '_' and '.', at most 63, not '{AUTHORITY}'")
    return name


def make_authority(folder: Path) -> None:
    """Make the authority in `folder`, unless it is there."""
    if (folder / AUTHORITY / KEY_FILE).exists():
        return
    key, name = ec.generate_private_key(ec.SECP256R1()), _subject("lacet")
    usage = dict.fromkeys(_USAGES, False) | {"key_cert_sign": True, "crl_sign": True}
    certificate = (
        _builder(name, name, key, AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(x509.KeyUsage(**usage), critical=True)
        .sign(key, hashes.SHA256())
    )
    _write(folder / AUTHORITY, certificate, key)


def make_certificate(folder: Path, name: str, days: float = DAYS) -> None:
    """Certify `name` by the authority in `folder`: its folder is what its holder needs, and replaces an earlier one."""
    issuer = x509.load_pem_x509_certificate((folder / AUTHORITY / CERTIFICATE_FILE).read_bytes())
    issuer_key: Any = serialization.load_pem_private_key((folder / AUTHORITY / KEY_FILE).read_bytes(), None)
    key = ec.generate_private_key(ec.SECP256R1())
    both = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]  # whoever listens is the server
    certificate = (
        _builder(_subject(name), issuer.subject, key, days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.SubjectAlternativeName([x509.DNSName(name)]), critical=False)
        .add_extension(x509.ExtendedKeyUsage(both), critical=False)
        .sign(issuer_key, hashes.SHA256())
    )
    _write(folder / name, certificate, key)
    shutil.copyfile(folder / AUTHORITY / CERTIFICATE_FILE, folder / name / CA_FILE)


def common_name(certificate: x509.Certificate) -> str:
    """The name that a certificate certifies."""
    return "".join(str(found.value) for found in certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME))


def _subject(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, days: float
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(min(now, now + timedelta(days=days)) - EARLIER)
        .not_valid_after(now + timedelta(days=days))
    )


def _write(folder: Path, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    pem = serialization.Encoding.PEM
    secret = key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    (folder / KEY_FILE).unlink(missing_ok=True)
    with os.fdopen(os.open(folder / KEY_FILE, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(secret)
    (folder / CERTIFICATE_FILE).write_bytes(certificate.public_bytes(pem))
