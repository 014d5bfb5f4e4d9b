# SPDX-License-Identifier: Apache-2.0
"""HTTP/2 by hand, for what no library would send: calls of gRPC whose messages have no end."""
import socket
import struct

DATA, HEADERS, RESET, SETTINGS, PING, GOAWAY, WINDOW_UPDATE = 0, 1, 3, 4, 6, 7, 8
END_STREAM = ACK = 1
END_HEADERS = 4
INITIAL_WINDOW = 4  # of SETTINGS
MOST_BYTES = 16384  # of a frame
PINGS = 20  # answered ones after which a window that is closed stays closed


def _frame(kind, flags, stream, payload=b""):
    return struct.pack(">I", len(payload))[1:] + bytes([kind, flags]) + struct.pack(">I", stream) + payload


def _field(name, value):
    """A field that the table of HPACK does not keep; texts of up to 126 bytes."""
    return b"".join([b"\0", bytes([len(name)]), name.encode(), bytes([len(value)]), value.encode()])


class Connection:
    """Sends as the other side's windows allow, and takes frames in while it waits for these."""

    def __init__(self, address):
        host, port = address.rsplit(":", 1)
        self._socket = socket.create_connection((host, int(port)), timeout=60)
        self._reader = self._socket.makefile("rb")
        self._socket.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + _frame(SETTINGS, 0, 0))
        self._window, self._initial, self._streams = 65535, 65535, {}
        self.ended = set()  # streams that the other side has ended
        self.gone = False   # the other side takes nothing more

    def close(self):
        self._reader.close()
        self._socket.close()

    def open(self, path, **metadata):
        """The number of a new call."""
        stream = 2 * len(self._streams) + 1
        fields = {":method": "POST", ":scheme": "http", ":path": path, ":authority": "test",
                  "content-type": "application/grpc", "te": "trailers", **metadata}
        self._streams[stream] = self._initial
        self._send(_frame(HEADERS, END_HEADERS, stream, b"".join(_field(*field) for field in fields.items())))
        return stream

    def announce(self, stream, size):
        """Sends a message of 'size' bytes but for the last one, as far as the other side takes it; how far that is."""
        start = struct.pack(">BI", 0, size)
        left = len(start) + size - 1
        sent, pings = 0, 0
        while left > 0 and stream not in self.ended and not self.gone and pings < PINGS:
            count = min(left, MOST_BYTES, self._window, self._streams[stream])
            if count <= 0:
                self._ping()
                pings += 1
                continue
            self._window -= count
            self._streams[stream] -= count
            self._send(_frame(DATA, 0, stream, start + bytes(count - len(start))))
            start, left, sent, pings = b"", left - count, sent + count, 0
        return sent

    def wait_for_end(self, stream):
        while stream not in self.ended and not self.gone:
            self._take()
        return stream in self.ended

    def _send(self, frame):
        try:
            self._socket.sendall(frame)
        except OSError:
            self.gone = True

    def _ping(self):
        """Returns once the other side has dealt with all that was sent."""
        self._send(_frame(PING, 0, 0, b"answered"))
        while not self.gone and not self._take():
            pass

    def _take(self):
        """Takes one frame in; whether it answers a ping."""
        try:
            head = self._reader.read(9)
            payload = self._reader.read(int.from_bytes(head[:3], "big"))
        except OSError:
            head = b""
        if len(head) < 9:
            self.gone = True
            return False
        kind, flags, stream = head[3], head[4], int.from_bytes(head[5:], "big")
        if kind == WINDOW_UPDATE and stream in self._streams:
            self._streams[stream] += int.from_bytes(payload, "big")
        elif kind == WINDOW_UPDATE:
            self._window += int.from_bytes(payload, "big")
        elif kind == SETTINGS and not flags & ACK:
            self._adjust(payload)
        elif kind == PING and not flags & ACK:
            self._send(_frame(PING, ACK, 0, payload))
        elif kind == RESET or (kind in (DATA, HEADERS) and flags & END_STREAM):
            self.ended.add(stream)
        elif kind == GOAWAY:
            self.gone = True
        return kind == PING and bool(flags & ACK)

    def _adjust(self, settings):
        for name, value in struct.iter_unpack(">HI", settings):
            if name == INITIAL_WINDOW:
                self._streams = {stream: window + value - self._initial for stream, window in self._streams.items()}
                self._initial = value
        self._send(_frame(SETTINGS, ACK, 0))
