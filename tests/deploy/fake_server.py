# SPDX-License-Identifier: Apache-2.0
"""What a proxy takes for a server, and a test asks what has come through."""
import http.server
import threading
from concurrent.futures import ThreadPoolExecutor

import grpc


class ReadyPage(http.server.BaseHTTPRequestHandler):
    """Answers every question as a server that is ready answers /readyz."""

    def do_GET(self):
        self.send_response(200)
        self.end_headers()

    def log_message(self, *_):
        pass


class FakeServer(grpc.GenericRpcHandler):
    """Has 'address' and 'metrics' as a ServerProcess has. Any call is answered with an empty message.

    'metadata' is what came with the newest call.
    """

    def __init__(self):
        self.metadata = {}
        self.server = grpc.server(ThreadPoolExecutor(2), handlers=[self])
        self.address = f"127.0.0.1:{self.server.add_insecure_port('127.0.0.1:0')}"
        self.server.start()
        self.pages = http.server.ThreadingHTTPServer(("127.0.0.1", 0), ReadyPage)
        self.metrics = f"http://127.0.0.1:{self.pages.server_port}/metrics"
        threading.Thread(target=self.pages.serve_forever, daemon=True).start()

    def service(self, handler_call_details):
        self.metadata = dict(handler_call_details.invocation_metadata)
        return grpc.unary_unary_rpc_method_handler(lambda *_: b"")

    def stop(self):
        self.server.stop(None).wait()
        self.pages.shutdown()
        self.pages.server_close()
