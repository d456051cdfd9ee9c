"""A browser without a window, driven over the Chrome DevTools Protocol.

It evaluates scripts, types text and takes pictures.
Source: https://chromedevtools.github.io/devtools-protocol/ and RFC 6455 for the frames, of which one client that
sends and reads short texts needs little.
"""

from __future__ import annotations

import base64
import json
import os
import shutil
import socket
import struct
import subprocess
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from tests.drivers.waiting import PATIENCE_S, until

CHROMIUM = next((found for name in ("chromium", "chromium-browser") if (found := shutil.which(name))), None)
QUIET = (
    "--headless --no-sandbox --disable-gpu --disable-3d-apis --disable-quic --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync --remote-debugging-port=0 "
    "--window-size=1280,1150"
)


# The operator page takes a service for silent that has not answered for three seconds, and holds its lease for fifteen:
# a machine that is starved keeps neither. Here it waits, and holds, twenty times as long.
PATIENT = """
    AbortSignal.timeout = ((timeout) => (ms) => timeout(20 * ms))(AbortSignal.timeout.bind(AbortSignal));
    window.fetch = ((ask) => (path, options = {}) => {
      if (!/cell.lease/.test(path) || !options.body) return ask(path, options);
      return ask(path, { ...options, body: JSON.stringify({ ...JSON.parse(options.body), seconds: 300 }) });
    })(window.fetch.bind(window));
"""


class Page:
    """One tab of the browser.

    `told` lists the messages of the browser itself, a violated policy for instance. A `patient` page waits longer for
    its service than a page for a person would.
    """

    def __init__(self, address: str, *, patient: bool = True) -> None:
        self._address, self._patient = address, patient
        parts = urlsplit(address)
        self._link = socket.create_connection((parts.hostname or "", parts.port or 0), timeout=PATIENCE_S)
        key = base64.b64encode(os.urandom(16)).decode()
        self._link.sendall(
            f"GET {parts.path} HTTP/1.1\r\nHost: {parts.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        self._in = self._link.makefile("rb")
        assert b" 101 " in self._in.readline()
        while self._in.readline() != b"\r\n":
            pass
        self._number = 0
        self.told: list[dict[str, Any]] = []
        for domain in ("Page", "Runtime", "Log"):
            self.do(f"{domain}.enable")
        if patient:
            self.do("Page.addScriptToEvaluateOnNewDocument", source=PATIENT)

    def open(self, url: str) -> None:
        """Go there, and wait until it is loaded."""
        self.do("Page.navigate", url=url)
        until(lambda: self.value("location.href + document.readyState") == f"{url}complete")

    def do(self, method: str, **params: Any) -> dict[str, Any]:
        """One command and its result."""
        self._number += 1
        text = json.dumps({"id": self._number, "method": method, "params": params}).encode()
        if len(text) < 126:
            size = bytes([0x80 | len(text)])
        else:
            size = (
                struct.pack("!BH", 0xFE, len(text))
                if len(text) < 1 << 16
                else struct.pack("!BQ", 0xFF, len(text))
            )
        mask = os.urandom(4)
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(text))
        self._link.sendall(b"\x81" + size + mask + masked)
        while True:
            answer = json.loads(self._frame())
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]
            self.told.append(answer)

    def _frame(self) -> bytes:
        head = self._in.read(2)
        size = head[1] & 0x7F
        if size > 125:
            size = int.from_bytes(self._in.read(2 if size == 126 else 8), "big")
        return self._in.read(size)

    def value(self, script: str) -> Any:
        """Evaluate an expression, await it and return its value."""
        got = self.do("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in got, got
        return got["result"].get("value")

    def text(self, selector: str) -> str:
        """Return the text of the first such element; an empty text if no such element exists (yet)."""
        return self.value(f"document.querySelector({json.dumps(selector)})?.textContent ?? ''")

    def press(self, key: str, *, held: bool = False) -> None:
        """Press a key in the element that has the focus.

        A key that is `held` has been down for a while and repeats.
        """
        codes = {"Escape": 27, "Enter": 13, "Tab": 9}
        extra = {"text": "\r"} if key == "Enter" else {}
        for kind in ("keyDown", "keyUp"):
            more = extra if kind == "keyDown" else {}
            self.do(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                windowsVirtualKeyCode=codes[key],
                autoRepeat=held,
                **more,
            )

    def click(self, selector: str) -> None:
        """Click on the first such element, which must exist."""
        self.value(f"document.querySelector({json.dumps(selector)}).click()")

    def type(self, text: str) -> None:
        self.do("Input.insertText", text=text)

    def picture(self, file: Path) -> None:
        file.write_bytes(base64.b64decode(self.do("Page.captureScreenshot")["data"]))

    def width(self, pixels: int) -> None:
        """Set the width of the window in pixels."""
        size = {"width": pixels, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self.do("Emulation.setDeviceMetricsOverride", **size)

    def choose(self, selector: str, *files: Path) -> None:
        """The files that a person chooses in a file field."""
        found = self.do("Runtime.evaluate", expression=f"document.querySelector({json.dumps(selector)})")
        names = [str(file) for file in files]
        self.do("DOM.setFileInputFiles", files=names, objectId=found["result"]["objectId"])

    @contextmanager
    def another(self, url: str) -> Iterator[Page]:
        """Another tab of the same browser."""
        target = self.do("Target.createTarget", url="about:blank")["targetId"]
        page = Page(f"{self._address.rpartition('/')[0]}/{target}", patient=self._patient)
        try:
            page.open(url)
            yield page
        finally:
            page.close()

    def close(self) -> None:
        self._in.close()
        self._link.close()


@contextmanager
def browser(url: str, folder: Path, *, patient: bool = True) -> Iterator[Page]:
    """The page at `url`; `folder` for the browser's own files."""
    assert CHROMIUM is not None
    command = [CHROMIUM, *QUIET.split(), f"--user-data-dir={folder}", "about:blank"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            file = folder / "DevToolsActivePort"
            until(lambda: file.is_file() and "\n" in file.read_text("utf-8"))
            port = file.read_text("utf-8").splitlines()[0]
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=PATIENCE_S) as listed:
                (tab,) = [each for each in json.load(listed) if each["type"] == "page"]
            page = Page(tab["webSocketDebuggerUrl"], patient=patient)
            try:
                page.open(url)
                yield page
            finally:
                page.close()
        finally:
            process.terminate()
