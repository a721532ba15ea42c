"""The readers of CSV and TOML under Atheris, which follows the branches an input takes.

    pip install atheris
    PYTHONPATH=. python tests/fuzz/coverage_guided.py CSV -max_total_time=120

Ends at the first input that raises anything but an error of this package.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
from pathlib import Path

try:
    import atheris
except ImportError:
    sys.exit("needs Atheris: pip install atheris")

with atheris.instrument_imports(include=["pbrdf_bayes.io", "tomllib"]):
    from pbrdf_bayes.errors import PbrdfError
    from pbrdf_bayes.io.config_toml import read_config
    from pbrdf_bayes.io.document_toml import read_document
    from pbrdf_bayes.io.limits_toml import read_limits
    from pbrdf_bayes.io.scene_toml import read_scene
    from pbrdf_bayes.io.tidy_csv import read_samples

_TOML = (lambda path: read_config(path, {}), read_limits, read_scene, read_document)
READERS = {"CSV": (read_samples,), "TOML": _TOML}
FOLDER = tempfile.TemporaryDirectory()
FILE = Path(FOLDER.name) / "input"


def once(data: bytes) -> None:
    """One input through every reader of its kind."""
    FILE.write_bytes(data)
    for read in READERS[sys.argv[1]]:
        with contextlib.suppress(PbrdfError):
            read(FILE)


if __name__ == "__main__":
    atheris.Setup([sys.argv[0], *sys.argv[2:]], once)
    atheris.Fuzz()
