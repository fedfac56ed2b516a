"""Look for what sticks out of a page or overlaps in it, with a browser that prints what it has drawn.

The page is put into a frame of the wanted width, for windows of browsers are not narrower than some 500 px; a script
that is added to it says what sticks out.
"""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

_LOOK = Path(__file__).with_suffix(".js")
"""What is added to a page: it says what sticks out once everything is drawn."""
_FRAME = """<!DOCTYPE html><meta charset="utf-8"><body style="margin:0"><pre id="said"></pre>
<iframe src="page.html" style="border:0;width:{width}px;height:1600px"></iframe>
<script>
addEventListener("message", (event) => {{ document.getElementById("said").textContent = event.data; }});
</script></body>"""


def browser() -> str | None:
    """The first browser there is."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
    return next((found for name in names if (found := shutil.which(name))), None)


def problems(page: str, width: int, folder: Path, theme: str = "") -> dict[str, object]:
    """Return what sticks out, overlaps or scrolls in a page of ``width`` px, and how many names are drawn."""
    program = browser()
    assert program is not None
    script = _LOOK.read_text(encoding="utf-8").replace("THEME", json.dumps(theme))
    look = f"<script>{script}</script></body>"
    (folder / "page.html").write_text(page.replace("</body>", look, 1), encoding="utf-8")
    (folder / "frame.html").write_text(_FRAME.format(width=width), encoding="utf-8")
    options = ["--headless", "--disable-gpu", "--virtual-time-budget=90000", "--dump-dom"]
    options += [f"--user-data-dir={folder / 'profile'}", f"--window-size={max(width, 600)},1700"]
    options += ["--no-sandbox"] if os.geteuid() == 0 else []
    done = subprocess.run(
        [program, *options, (folder / "frame.html").as_uri()], capture_output=True, timeout=240, check=False
    )
    said = re.search(r'<pre id="said">(.*?)</pre>', done.stdout.decode(), re.S)
    assert said is not None, done.stderr.decode()[-500:]
    assert said[1], "the page said nothing"
    found: dict[str, object] = json.loads(html.unescape(said[1]))
    return found
