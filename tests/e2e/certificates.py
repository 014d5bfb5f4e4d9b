# SPDX-License-Identifier: Apache-2.0
"""Certificate authorities of a test's own, made by openssl."""
import os
import pathlib
import subprocess

NEW_KEY = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]


def openssl(*args):
    subprocess.run(["openssl", *map(str, args)], check=True, capture_output=True)


class Authority:
    """Its own files are 'certificate' and 'key'; issue() signs those of others."""

    def __init__(self, folder, name):
        self.folder, self.name = pathlib.Path(folder), name
        self.certificate, self.key = self.folder / f"{name}.pem", self.folder / f"{name}.key"
        openssl("req", "-x509", *NEW_KEY, "-days", 1, "-subj", f"/CN={name}", "-keyout", self.key, "-out",
                self.certificate)

    def issue(self, name, alternative_names="DNS:localhost,IP:127.0.0.1", days=1):
        """Certificate and key of 'name'; with negative days it has expired."""
        cert, key, request = (self.folder / f"{self.name}-{name}.{end}" for end in ("pem", "key", "csr"))
        openssl("req", "-new", *NEW_KEY, "-subj", f"/CN={name}", "-addext", f"subjectAltName={alternative_names}",
                "-keyout", key, "-out", request)
        openssl("x509", "-req", "-in", request, "-CA", self.certificate, "-CAkey", self.key, "-days", days,
                "-copy_extensions", "copy", "-out", cert)
        return cert, key


def put(sources, targets):
    """Gives files new contents at once, as platforms that exchange secrets do."""
    for source, target in zip(sources, targets):
        fresh = target.with_suffix(".fresh")
        fresh.write_bytes(source.read_bytes())
        os.replace(fresh, target)
