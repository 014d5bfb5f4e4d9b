# SPDX-License-Identifier: Apache-2.0
"""The proxies of deploy/ at work: as the files there say, on ports that the system chooses."""
import getpass
import grp
import os
import pathlib
import re
import socket
import subprocess
import tempfile
from urllib.parse import urlsplit

from tools import DEPLOY, tool, tool_environment


def unchanged(config):
    return config


class ProxyProcess:
    """Starts with the object, in front of 'servers' (two ServerProcess); stop() ends it.

    'certificate' and 'key' are paths; 'change' makes the configuration's text another one.
    """

    CONFIG = None  # of deploy/
    IDLE_LIMITS = ()  # directives of it, any of which ends a stream on which nothing has moved for so long

    def __init__(self, servers, certificate, key, change=unchanged):
        self.temporary = tempfile.TemporaryDirectory(prefix="holdfast-proxy-")
        self.directory = pathlib.Path(self.temporary.name)
        self.listener = socket.create_server(("127.0.0.1", 0))  # which the proxy inherits: nobody can take its port
        self.listener.setblocking(False)  # or a process of the proxy hangs where another one was faster to accept
        self.address = "127.0.0.1:%d" % self.listener.getsockname()[1]
        self.servers, self.certificate, self.key = servers, certificate, key
        self.config = self.directory / self.CONFIG
        self.config.write_text(change((DEPLOY / self.CONFIG).read_text()))
        self.log = open(self.directory / "log", "w+")
        command, environment = self.prepare()
        self.process = subprocess.Popen(
            command, env={**tool_environment(), **environment}, pass_fds=[self.listener.fileno()],
            stdout=self.log, stderr=self.log)

    def prepare(self):
        """Writes what the proxy reads; returns the command line, and variables of its environment."""
        raise NotImplementedError

    def words(self):
        """What the proxy has said so far."""
        return (self.directory / "log").read_text()

    def ended(self):
        """How many connections or calls, whichever the proxy looks at, it has logged as ended."""
        raise NotImplementedError

    def stop(self):
        self.process.terminate()
        self.process.wait(60)
        self.log.close()
        self.listener.close()
        self.temporary.cleanup()

    @classmethod
    def idle_limits(cls, config):
        """{directive: seconds} of IDLE_LIMITS; one that the configuration lacks is left out."""
        found = {}
        for name in cls.IDLE_LIMITS:
            for number, unit in re.findall(rf"^\s*{name}\s+(\d+)(ms|s|m|h|d);?$", config, re.MULTILINE):
                found[name] = int(number) * {"ms": 0.001, "s": 1, "m": 60, "h": 3600, "d": 86400}[unit]
        return found

    @classmethod
    def with_idle_limit(cls, config, name, seconds):
        """The configuration with another limit."""
        changed, count = re.subn(rf"^(\s*{name}\s+)\w+", rf"\g<1>{seconds}s", config, flags=re.MULTILINE)
        if count != 1:
            raise ValueError(f"{name} is there {count} times")
        return changed


class Haproxy(ProxyProcess):
    CONFIG = "haproxy.cfg"
    IDLE_LIMITS = ("timeout client", "timeout server")

    def prepare(self):
        bundle = self.directory / "holdfast.pem"
        bundle.write_text(self.certificate.read_text() + self.key.read_text())
        environment = {
            "PROXY_LISTEN": f"fd@{self.listener.fileno()}", "PROXY_CERTIFICATE": str(bundle),
            "PROXY_ADMIN_SOCKET": str(self.directory / "admin"), "PROXY_USER": getpass.getuser(),
            "PROXY_GROUP": grp.getgrgid(os.getgid()).gr_name}
        for i, server in enumerate(self.servers, 1):
            environment[f"PROXY_SERVER_{i}"] = server.address
            environment[f"PROXY_READY_PORT_{i}"] = str(urlsplit(server.metrics).port)
        return [tool("haproxy"), "-db", "-f", self.config], environment

    def ended(self):
        return self.words().count(" clients~ holdfast/server-")


class Nginx(ProxyProcess):
    CONFIG = "nginx.conf"
    IDLE_LIMITS = ("client_body_timeout", "send_timeout", "grpc_read_timeout", "grpc_send_timeout")

    def prepare(self):
        self.config.write_text(self.with_places_set(self.config.read_text()))
        # Connections that are waiting for an nginx that takes the place of another one are named so.
        return [tool("nginx"), "-c", self.config, "-g", "daemon off;"], {"NGINX": f"{self.listener.fileno()};"}

    def with_places_set(self, config):
        """The configuration with each `# SET` set, and with directories that Debian's package would have made."""
        places = {
            "user": [getpass.getuser()], "pid": [self.directory / "pid"], "error_log": ["stderr"],
            "server": [server.address for server in self.servers], "access_log": [self.directory / "access"],
            "listen": [self.address], "ssl_certificate": [self.certificate], "ssl_certificate_key": [self.key]}

        def value(match):
            return f"{match[1]}{places[match[2]].pop(0)}{match[4]}"

        config = re.sub(r"^(\s*(\w+)\s+)([^\s;]+)(.*;)\s+# SET$", value, config, flags=re.MULTILINE)
        if "# SET" in config.replace("`# SET`", "") or any(places.values()):
            raise ValueError(f"not set: {places} in {config}")
        made = "".join(f"    {name}_temp_path {self.directory / name};\n"
                       for name in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
        return config.replace("http {\n", "http {\n" + made, 1)

    def ended(self):
        return (self.directory / "access").read_text().count(" server=")

    def workers(self):
        """The numbers of the processes that take new connections."""
        master = self.process.pid
        children = pathlib.Path(f"/proc/{master}/task/{master}/children").read_text().split()
        return {child for child in children
                if b"worker process is shutting down" not in pathlib.Path(f"/proc/{child}/cmdline").read_bytes()}
