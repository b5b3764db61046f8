"""A worker without viser, started by tests: it answers each message with the sender's code and its own pid.

Its last argument says how it behaves: `good`; `broken`, which cannot start; `fragile`, which ends once it is ready;
`deaf`, which goes on when the gateway is gone; `slow`, which answers only once the file `go` exists.
"""

import os
import signal
import socket
import sys
import threading
from pathlib import Path

from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from personal_viz.study_app.store_link import StoreLink
from personal_viz.study_app.worker_door import SECRET_HEADER, WorkerDoor


def main() -> None:
    """Serves until the gateway closes the socket."""
    fd, folder, kind = int(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
    link = StoreLink(socket.socket(fileno=fd))
    (folder / f"{os.getpid()}.pid").touch()
    if kind == "broken":
        link.tell_failed("scene X: cannot be read; expected a mesh. Give another.")
        return

    def answer(connection: ServerConnection) -> None:
        code = link.code_of_ticket(connection.request.path.rpartition("=")[2])
        for _ in connection:
            connection.send(f"{code} {os.getpid()}")

    def is_there(connection: ServerConnection, request: Request) -> Response | None:
        """The answer to a request that is no websocket, as viser gives it."""
        if request.headers.get("Upgrade") == "websocket":
            is_gateway = request.headers.get(SECRET_HEADER) == f"secret of {os.getpid()}"
            return None if is_gateway else connection.respond(403, "FORBIDDEN")
        if kind == "slow":
            with (folder / f"{os.getpid()}.asked").open("a") as asked:
                asked.write("once\n")
            while not (folder / "go").exists():
                threading.Event().wait(0.02)
        return connection.respond(404, "NOT FOUND")

    with serve(answer, "127.0.0.1", 0, process_request=is_there) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        link.tell_ready(WorkerDoor(server.socket.getsockname()[1], f"secret of {os.getpid()}"))
        if kind == "fragile":
            os._exit(3)
        link.is_closed.wait()
        if kind == "deaf":
            signal.pause()


if __name__ == "__main__":
    main()
