"""A local chat endpoint that gives right and wrong answers the way OpenAI-compatible servers do."""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class ChatStub:
    """Settings of the server's answers, and its requests; a test may set `content`, `status`, `body` and `is_stuck`."""

    def __init__(self) -> None:
        self.content: str | None = ""
        """The message of the assistant."""
        self.status = 200
        self.body: bytes | None = None
        """The whole body of the answer; None = a chat completion with `content`."""
        self.failures: list[tuple[int, dict[str, str]]] = []
        """Status and headers of the next answers, before the right ones."""
        self.think: Callable[[dict], str] | None = None
        """Makes `content` from a request."""
        self.tokens: tuple[int, int] | None = None
        """Tokens of prompt and answer, as the server counts them."""
        self.refusal: str | None = None
        self.finish = "stop"
        """Why the server says that the answer ends."""
        self.is_stuck = False
        """Whether the server waits for `released` instead of answering."""
        self.released = threading.Event()
        self.requests: list[dict] = []
        self.keys: list[str | None] = []
        self.url = ""

    def answer(self) -> bytes:
        if self.body is not None:
            return self.body
        content = self.think(self.requests[-1]) if self.think is not None else self.content
        message = {"role": "assistant", "content": content, "refusal": self.refusal}
        choice = {"index": 0, "message": message, "finish_reason": self.finish}
        answer = {"id": "1", "object": "chat.completion", "created": 0, "model": "stub", "choices": [choice]}
        if self.tokens is not None:
            prompt, completion = self.tokens
            usage = {"prompt_tokens": prompt, "completion_tokens": completion, "total_tokens": prompt + completion}
            answer["usage"] = usage
        return json.dumps(answer).encode()


@contextmanager
def chat_stub() -> Iterator[ChatStub]:
    """A running server that stops when the block ends."""
    stub = ChatStub()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            stub.requests.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            stub.keys.append(self.headers["Authorization"])
            if stub.is_stuck:
                stub.released.wait(30)
                return
            status, headers = stub.failures.pop(0) if stub.failures else (stub.status, {})
            answer = stub.answer()
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(answer)))
            self.end_headers()
            self.wfile.write(answer)

        def log_message(self, format: str, *args: object) -> None:
            """Prints nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    stub.url = f"http://127.0.0.1:{server.server_port}/v1"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    try:
        yield stub
    finally:
        stub.released.set()
        server.shutdown()
        thread.join()
        server.server_close()
