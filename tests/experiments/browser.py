"""A page in headless Chromium, through its debugging pipe: what it measures, logs and shows."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_LONGEST_S = 60.0


class Page:
    """One page of a running browser; ``faults`` are its errors and warnings, and requests to other hosts."""

    def __init__(self, read: BinaryIO, write: BinaryIO) -> None:
        self._read, self._write, self._number, self._session = read, write, 0, ""
        self.faults: list[str] = []
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")

    def open(self, path: Path, width: int, height: int = 900) -> None:
        """Open a file in a window of so many pixels, and wait until it is laid out."""
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
                   mobile=width < 600)  # fmt: skip
        self._call("Page.navigate", url=path.resolve().as_uri())
        end = time.monotonic() + _LONGEST_S
        while self.evaluate("document.readyState") != "complete" and time.monotonic() < end:
            time.sleep(0.05)
        self.evaluate("Promise.all([...document.images].map(image => image.decode()))")

    def media(self, kind: str) -> None:
        """Show the page as on "screen" or in "print"."""
        self._call("Emulation.setEmulatedMedia", media=kind)

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression."""
        found = self._call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def drag(self, *points: tuple[float, float]) -> None:
        """Press the mouse at the first point of the window [px], move to the others, release at the last."""
        for kind, (x, y) in (("mousePressed", points[0]), *(("mouseMoved", point) for point in points[1:]),
                             ("mouseReleased", points[-1])):  # fmt: skip
            self._call(
                "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1
            )

    def point(self, x: float, y: float) -> None:
        """Move the mouse to a point of the window [px], with no button pressed."""
        self._call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def scripting(self, *, on: bool) -> None:
        """Let pages run scripts, or not; what is opened next follows."""
        self._call("Emulation.setScriptExecutionDisabled", value=not on)

    def picture(self) -> bytes:
        """Return the whole page as PNG."""
        found = self._call("Page.captureScreenshot", captureBeyondViewport=True)
        return base64.b64decode(found["data"])

    def printed(self) -> bytes:
        """Return the page as PDF on A4."""
        found = self._call("Page.printToPDF", paperWidth=8.27, paperHeight=11.69, printBackground=True)
        return base64.b64decode(found["data"])

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        self._write.write(json.dumps(message).encode() + b"\0")
        self._write.flush()
        while True:
            answer = json.loads(self._message())
            if answer.get("id") == self._number:
                assert "error" not in answer, answer["error"]
                return dict(answer["result"])
            self._note(answer.get("method", ""), answer.get("params", {}))

    def _message(self) -> bytes:
        parts = bytearray()
        while (byte := self._read.read(1)) != b"\0":
            assert byte, "the browser ended"
            parts += byte
        return bytes(parts)

    def _note(self, event: str, what: dict[str, Any]) -> None:
        if event == "Log.entryAdded" and what["entry"]["level"] in ("error", "warning"):
            self.faults.append(what["entry"]["text"])
        elif event == "Runtime.exceptionThrown" or (
            event == "Runtime.consoleAPICalled" and what["type"] in ("error", "warning", "assert")
        ):
            self.faults.append(json.dumps(what))
        elif event == "Network.requestWillBeSent":
            address = what["request"]["url"]
            if not address.startswith(("file:", "data:", "about:")):
                self.faults.append(f"asks for {address}")


@contextmanager
def browser(profile: Path) -> Iterator[Page]:
    """Start Chromium with a profile of its own and yield a page; it ends with the block."""
    assert CHROMIUM is not None
    there_read, here_write = os.pipe()
    here_read, there_write = os.pipe()
    command = [
        "bash", "-c", f'exec "$@" 3<&{there_read} 4>&{there_write}', "bash", CHROMIUM, "--headless",
        "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", f"--user-data-dir={profile}",
    ]  # fmt: skip
    process = subprocess.Popen(
        command, pass_fds=(there_read, there_write), stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    )
    os.close(there_read)
    os.close(there_write)
    try:
        with os.fdopen(here_read, "rb") as read, os.fdopen(here_write, "wb") as write:
            yield Page(read, write)
    finally:
        process.kill()
        process.wait()
