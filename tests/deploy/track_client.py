# SPDX-License-Identifier: Apache-2.0
"""A client of the protocol that a test leads step by step."""
import pathlib
import queue

import grpc

from protocol import METHOD, picture

WIDTH, HEIGHT = 128, 96
CALL_SECONDS = 300  # no call of a test takes so long, even on a busy machine


class Client:
    """Has a connection of its own to 'address', by TLS where the file of an authority's certificate is given.

    A call fails at once when no connection can be made, so that a proxy's mistakes are not mended by trying again.
    'protocol' is the module point_tracking_pb2; 'metadata' goes with every call.
    """

    def __init__(self, protocol, address, authority=None, metadata=()):
        self.protocol, self.metadata = protocol, metadata
        options = [("grpc.use_local_subchannel_pool", 1), ("grpc.max_receive_message_length", -1)]
        if authority is None:
            self.channel = grpc.insecure_channel(address, options)
        else:
            trusted = grpc.ssl_channel_credentials(pathlib.Path(authority).read_bytes())
            self.channel = grpc.secure_channel(address, trusted, options)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        self.channel.close()

    def info(self):
        """What the server says of itself."""
        ask = self.channel.unary_unary(METHOD + "GetServerInfo",
                                       request_serializer=self.protocol.GetServerInfoRequest.SerializeToString,
                                       response_deserializer=self.protocol.GetServerInfoResponse.FromString)
        return ask(self.protocol.GetServerInfoRequest(), timeout=CALL_SECONDS, metadata=self.metadata)

    def session(self, **config):
        """Begins a session; see SessionConfig for what there is to say."""
        return Session(self, self.protocol.SessionConfig(
            encoding=self.protocol.FRAME_ENCODING_RGB24,
            raw_size=self.protocol.ImageSize(width=WIDTH, height=HEIGHT), **config))


class Session:
    """A stream of Track whose messages are sent and received one by one. Receiving raises grpc.RpcError at its end."""

    def __init__(self, client, config):
        self.client, self.protocol = client, client.protocol
        self.requests = queue.SimpleQueue()
        track = client.channel.stream_stream(METHOD + "Track",
                                             request_serializer=self.protocol.TrackRequest.SerializeToString,
                                             response_deserializer=self.protocol.TrackResponse.FromString)
        self.send(config=config)
        self.call = track(iter(self.requests.get, None), timeout=CALL_SECONDS, metadata=client.metadata)

    def send(self, **request):
        self.requests.put(self.protocol.TrackRequest(**request))

    def send_frames(self, frames):
        """Sends the pictures of these numbers."""
        for index in frames:
            grey = picture(index, WIDTH, HEIGHT)
            self.send(frame=self.protocol.Frame(index=index, data=bytes(grey[i // 3] for i in range(3 * len(grey)))))

    def finish(self):
        """Says that no more frames come."""
        self.requests.put(None)

    def accepted(self):
        """Waits until the session is open; returns on which terms."""
        return next(self.call).accepted

    def cancel(self):
        """Goes away without a word."""
        self.call.cancel()
        self.finish()

    def __iter__(self):
        return self.call


class FinalTracks:
    """What has become final: {id: {frame: (x, y)}}. Nothing may become final twice."""

    def __init__(self):
        self.positions = {}

    def add(self, tracks):
        for run in tracks.runs:
            positions = self.positions.setdefault(run.id, {})
            for i in range(run.final_count):
                if run.first_frame + i in positions:
                    raise ValueError(f"frame {run.first_frame + i} of point {run.id} has become final twice")
                positions[run.first_frame + i] = (run.x[i], run.y[i])
