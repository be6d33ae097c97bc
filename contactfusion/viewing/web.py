"""Serves the viewer for a browser on this machine, which then asks this machine only."""

import shutil
import subprocess
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.error import URLError
from urllib.parse import quote
from urllib.request import ProxyHandler, build_opener

from contactfusion.errors import ContactFusionError
from contactfusion.viewing.library import LOCAL, free_port, program, quiet_environment

HOST = "127.0.0.1"
POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    f"connect-src 'self' data: blob: http://{HOST}:*"
)
"""What a browser may load. In a browser rerun's analytics have no switch: it must not send them."""


def serve(rrd: Path) -> None:
    """Serve a file until somebody presses Ctrl+C.

    Raises:
        ContactFusionError: rerun cannot serve it.
        DependencyError: rerun is not installed.
    """
    page, data = free_port(), free_port()
    command = [program(), str(rrd), *LOCAL, "--port", str(data)]
    command += ["--serve-web", "--web-viewer-port", str(page)]
    environment = {**quiet_environment(), "RUST_LOG": "error"}
    with subprocess.Popen(command, env=environment) as process, _guarded(page) as server:
        source = quote(f"rerun+http://{HOST}:{data}/proxy", safe="")
        address = f"http://{HOST}:{server.server_port}/?url={source}&theme=dark"
        print(f"open {address} - Ctrl+C ends", flush=True)
        try:
            while process.poll() is None:
                server.handle_request()
        except KeyboardInterrupt:
            return
        finally:
            process.terminate()
    raise ContactFusionError(f"rerun cannot serve {rrd}; it says above why")


def _guarded(page: int) -> ThreadingHTTPServer:
    """Give a server of the page on a port, with the policy; it waits half a second at a time."""
    direct = build_opener(ProxyHandler({}))

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            try:
                with direct.open(f"http://{HOST}:{page}{self.path}") as answer:
                    self.send_response(answer.status)
                    for name in ("Content-Type", "Content-Encoding", "Content-Length"):
                        if name in answer.headers:
                            self.send_header(name, answer.headers[name])
                    self.send_header("Content-Security-Policy", POLICY)
                    self.end_headers()
                    shutil.copyfileobj(answer, self.wfile)
            except URLError as error:
                self.send_error(502, str(error))

        def log_message(self, format: str, *args: object) -> None:
            return

    server = ThreadingHTTPServer((HOST, 0), Page)
    server.timeout = 0.5
    return server
