"""The page of a report as PDF, printed by an installed Chromium or Chrome without a window.

The browser sets the page as it does on the screen, with the paged styles of the page itself
(`counter(page)` in the margin, repeated table heads, nothing cut in two), and is already there
wherever somebody looks at reports. Libraries that make PDF from HTML in Python want Pango and Cairo
of the system and know neither the grid nor the SVG that the page is made of.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from pbrdf_bayes.errors import ConfigError, RunFolderError

BROWSERS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome",
    "microsoft-edge", "msedge",
)  # fmt: skip
_ELSEWHERE = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    r"C:\Program Files\Google\Chrome\Application\chrome.exe",
    r"C:\Program Files (x86)\Microsoft\Edge\Application\msedge.exe",
)
_SECONDS = 120.0


def find_browser() -> str:
    """Path of an installed browser that prints.

    Raises
    ------
    ConfigError
        There is none; says what to install.
    """
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    found = found or next((path for path in _ELSEWHERE if Path(path).is_file()), None)
    if found is None:
        msg = (
            f"--pdf needs a browser that prints, and none is found (looked for "
            f"{', '.join(BROWSERS)}). Install Chromium or Google Chrome (Debian, Ubuntu: apt "
            "install chromium), or print report.html from any browser"
        )
        raise ConfigError(msg)
    return found


def print_pdf(html: str, *, seconds: float = _SECONDS) -> bytes:
    """A page as PDF.

    Parameters
    ----------
    html : str
        Self-contained.
    seconds : float
        How long the browser may take [s].

    Returns
    -------
    bytes

    Raises
    ------
    ConfigError
        No browser is installed.
    RunFolderError
        The browser failed or took too long.
    """
    browser = find_browser()
    with tempfile.TemporaryDirectory(prefix="pbrdf-pdf-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        page, pdf = folder / "report.html", folder / "report.pdf"
        page.write_text(html, encoding="utf-8", errors="replace")
        command = [
            browser, "--headless", "--disable-gpu", "--no-first-run", "--disable-extensions",
            "--disable-background-networking", f"--user-data-dir={folder / 'profile'}",
            "--no-pdf-header-footer", f"--print-to-pdf={pdf}", page.as_uri(),
        ]  # fmt: skip
        if hasattr(os, "geteuid") and os.geteuid() == 0:  # its sandbox does not run as root
            command.insert(1, "--no-sandbox")
        said = _run(command, seconds)
        if not pdf.is_file() or not pdf.stat().st_size:
            msg = (
                f"{browser}: made no PDF ({said or 'said nothing'}). "
                "Print report.html from any browser instead"
            )
            raise RunFolderError(msg)
        return pdf.read_bytes()


def _run(command: list[str], seconds: float) -> str:
    """Run to the end; what was said last on standard error."""
    try:
        done = subprocess.run(command, capture_output=True, timeout=seconds, check=False)
    except subprocess.TimeoutExpired:
        msg = (
            f"{command[0]}: no PDF within {seconds:g} s. Print report.html from any browser instead"
        )
        raise RunFolderError(msg) from None
    except OSError as error:
        msg = f"{command[0]}: cannot be started ({error.strerror}). Install Chromium"
        raise RunFolderError(msg) from None
    lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
    return lines[-1][:200] if lines else ""
