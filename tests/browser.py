"""A page in a real browser: headless Chromium runs a script in it and hands back what the script found.

The page is shown in a frame of the wanted width, because a headless window is never narrower than 500 pixels.
"""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
_DRAWN = """
<script>(function wait() {
  var drawn = document.documentElement.getAttribute("data-drawn");
  if (!drawn) { return setTimeout(wait, 50); }
  Promise.resolve().then(function () { return (async function () { %s })(); })
    .then(function (found) { parent.postMessage(JSON.stringify({ drawn: drawn, found: found }), "*"); })
    .catch(function (error) { parent.postMessage(JSON.stringify({ drawn: drawn, error: String(error) }), "*"); });
})();</script>
"""
_FRAME = """<!doctype html><body style="margin:0"><iframe src="%s" style="border:0;width:%dpx;height:900px"></iframe>
<script>addEventListener("message", function (event) {
  var said = document.createElement("pre"); said.id = "said"; said.textContent = event.data;
  document.body.appendChild(said);
});</script></body>"""


def browser() -> str | None:
    """Path of an installed Chromium, None where there is none."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


def look(page: Path, script: str, folder: Path, *, width: int = 1280, options: tuple[str, ...] = ()) -> Any:
    """What ``script`` (body of an async function in the page, after its figures are drawn) returns.

    width: of the page in pixels. Raises AssertionError where the page draws nothing or the script fails.
    """
    program = browser()
    assert program, "no browser"
    text = page.read_text(encoding="utf-8").replace("</body>", _DRAWN % script + "</body>")
    inner, outer = folder / "inner.html", folder / "outer.html"
    inner.write_text(text, encoding="utf-8")
    outer.write_text(_FRAME % (inner.name, width), encoding="utf-8")
    command = [
        program, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
        f"--user-data-dir={folder / 'profile'}", f"--window-size={max(width, 500)},900", "--virtual-time-budget=30000",
        *options, "--dump-dom", outer.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    found = re.search(r'<pre id="said">(.*?)</pre>', done.stdout, re.S)
    assert found, f"the page did not answer: {done.stdout[-300:]} {done.stderr[-300:]}"
    answer = json.loads(html.unescape(found.group(1)))
    assert answer["drawn"] == "yes" and "error" not in answer, answer
    return answer["found"]
