"""A headless Chromium without network, driven by the DevTools protocol through pipes."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Self

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
OPTIONS = (
    *("--headless=new", "--no-sandbox", "--no-first-run", "--disable-extensions"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1", "--hide-scrollbars"),
    "--mute-audio",
    *("--disable-dev-shm-usage", "--remote-debugging-pipe"),
)
PATIENCE = 180.0
"""Longest wait for an answer; the processor may be busy [s]."""

_LAUNCH = """
import os, sys
_, read, write, *words = sys.argv
os.dup2(int(read), 3)
os.dup2(int(write), 4)
os.execv(words[0], words)
"""

_MISFITS = """(() => {
  const scrolls = (e) => e && (["auto", "scroll"].includes(getComputedStyle(e).overflowX)
    || scrolls(e.parentElement));
  const name = (e) => `${e.tagName} ${e.className} ${(e.innerText ?? "").slice(0, 60)}`;
  const shown = [...document.querySelectorAll("body, body *")].filter((e) => e.clientWidth > 0);
  const wide = shown.filter((e) => (e.scrollWidth > e.clientWidth + 1
    || e.getBoundingClientRect().right > innerWidth + 1) && !scrolls(e));
  const texts = shown.filter((e) => [...e.childNodes].some((n) => n.nodeType === 3
    && n.data.trim()) && parseFloat(getComputedStyle(e).fontSize) < 11);
  const letters = (e) => 8.5 / 72 * 160 * e.clientWidth / e.naturalWidth;
  const blurred = [...document.images].filter((e) => letters(e) < 11);
  return [...wide.map((e) => "wide: " + name(e)), ...texts.map((e) => "small: " + name(e)),
    ...blurred.map((e) => `small letters: ${e.alt}, ${letters(e)} px`)];
})()"""
"""A figure has 160 dots an inch, and no letters below 8.5 points."""


def found() -> str | None:
    """Path of a Chromium, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Chromium:
    """One page of a browser: `go` somewhere, `ask` it, `press` keys, look at it.

    Everything it complains about is in `complaints`, every address it wants in `requests`.
    """

    def __init__(self, profile: Path, width: int = 640, height: int = 420) -> None:
        program = found()
        if program is None:
            raise FileNotFoundError("no Chromium")
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self._count, self._rest, self._loaded = 0, b"", False
        to_browser, from_browser = os.pipe(), os.pipe()
        # high numbers, so that 3 and 4 are free for the browser
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 20) for end in (to_browser[0], from_browser[1])]
        self._write, self._read = to_browser[1], from_browser[0]
        words = (f"--user-data-dir={profile}", f"--window-size={width},{height}", "about:blank")
        self._process = subprocess.Popen(
            [sys.executable, "-c", _LAUNCH, *map(str, ends), program, *OPTIONS, *words],
            pass_fds=ends,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for end in (to_browser[0], from_browser[1], *ends):
            os.close(end)
        self._session: str | None = None
        pages = self.send("Target.getTargets")["targetInfos"]
        page = next(one for one in pages if one["type"] == "page")
        attached = self.send("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for part in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{part}.enable")
        self.size(width, height)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._write)
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._read)

    def size(self, width: int, height: int, *, touch: bool = False, ratio: float = 1.0) -> None:
        """Size of the window [px]; a phone has a touch screen and small pixels."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=ratio,
            mobile=touch,
        )
        self.send("Emulation.setTouchEmulationEnabled", enabled=touch)

    def go(self, address: str) -> None:
        """Open an address and wait until it is loaded."""
        self._loaded = False
        if "loaderId" not in self.send("Page.navigate", url=address):  # another place of the page
            self.send("Page.reload")
        limit = time.monotonic() + PATIENCE
        while not self._loaded:
            self._hear(limit)

    def ask(self, expression: str) -> Any:
        """Value of a JavaScript expression; promises are awaited."""
        answer = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in answer:
            raise RuntimeError(str(answer["exceptionDetails"])[:500])
        return answer["result"].get("value")

    def press(self, key: str, *, shift: bool = False) -> None:
        """A key pressed and let go."""
        text = {"text": key} if len(key) == 1 else {}
        modifiers = 8 if shift else 0
        codes = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, " ": 32}
        code = {"windowsVirtualKeyCode": codes[key]} if key in codes else {}
        same = {"key": key, "modifiers": modifiers, **code}
        self.send("Input.dispatchKeyEvent", type="keyDown", **same, **text)
        self.send("Input.dispatchKeyEvent", type="keyUp", **same)

    def click(self, x: float, y: float) -> None:
        """The left button of the mouse at a place [px]."""
        for kind in ("mousePressed", "mouseReleased"):
            place = {"x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1}
            self.send("Input.dispatchMouseEvent", type=kind, **place)

    def screenshot(self, path: Path) -> Path:
        """The window as a PNG."""
        shot = self.send("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(shot["data"]))
        return path

    def misfits(self) -> list[str]:
        """Elements wider than their box, and text, also that of figures, below 11 pixels."""
        self.ask("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        found: list[str] = self.ask(_MISFITS)
        return found

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One command of the protocol, and its answer."""
        self._count += 1
        number = self._count
        message = {"id": number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        limit = time.monotonic() + PATIENCE
        while True:
            answer = self._hear(limit)
            if answer.get("id") == number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return dict(answer["result"])

    def _hear(self, limit: float) -> dict[str, Any]:
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._read], [], [], max(0.0, limit - time.monotonic()))
            part = os.read(self._read, 1 << 16) if ready else b""
            if not part:
                raise TimeoutError("Chromium said nothing")
            self._rest += part
        line, _, self._rest = self._rest.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        self._note(message.get("method", ""), message.get("params", {}))
        return message

    def _note(self, method: str, said: dict[str, Any]) -> None:
        if method == "Page.loadEventFired":
            self._loaded = True
        elif method == "Network.requestWillBeSent":
            self.requests.append(said["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.complaints.append(str(said["exceptionDetails"])[:500])
        elif method == "Log.entryAdded" and said["entry"]["level"] in ("error", "warning"):
            self.complaints.append(said["entry"]["text"])
        elif method == "Runtime.consoleAPICalled" and said["type"] in (
            "error",
            "warning",
            "assert",
        ):
            self.complaints.append(str(said["args"])[:500])
