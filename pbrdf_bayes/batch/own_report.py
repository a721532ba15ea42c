"""Whether the report of a run is the one that the batch made, so that it may replace it.

A report that was issued by other means since, with `report`, `conform --save` or `fit`, is somebody
else's document.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path

from pbrdf_bayes.io.run_folder import PDF, REPORT, write_text

_NOTE = ".batch_report"
KEPT = (
    "Its report was made by other means since the batch made one, and is kept with its verdict. "
    f"Remove {REPORT} and {PDF} from its folder to have that of the batch with --resume."
)


def note_report(folder: Path) -> None:
    """Leave in the run folder which report the batch has made.

    Raises
    ------
    RunFolderError
    """
    write_text(folder / _NOTE, _digest(folder / REPORT))


def is_own_report(folder: Path) -> bool:
    """There is no other report than the batch's; one without a note is of a process that died."""
    if (folder / PDF).exists():
        return False
    with suppress(FileNotFoundError):
        return (folder / _NOTE).read_bytes() == _digest(folder / REPORT).encode()
    return True


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
