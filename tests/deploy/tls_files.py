# SPDX-License-Identifier: Apache-2.0
"""Certificates of a test's own, made by openssl."""
import pathlib
import subprocess

NEW_KEY = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]


class Authority:
    """A certificate authority whose files lie in 'directory'."""

    def __init__(self, directory, name):
        self.directory = pathlib.Path(directory)
        self.certificate, self.key = self._request(name, ["-addext", "basicConstraints=critical,CA:TRUE"])

    def issue(self, name):
        """The paths of a certificate for this machine, and of its key."""
        return self._request(name, ["-CA", self.certificate, "-CAkey", self.key, "-addext",
                                    "subjectAltName=DNS:localhost,IP:127.0.0.1"])

    def _request(self, name, arguments):
        certificate, key = (self.directory / f"{name}.{suffix}" for suffix in ("crt", "key"))
        subprocess.run(["openssl", "req", "-x509", *NEW_KEY, "-days", "2", "-subj", f"/CN={name}", *arguments,
                        "-out", certificate, "-keyout", key], check=True, capture_output=True)
        return certificate, key
