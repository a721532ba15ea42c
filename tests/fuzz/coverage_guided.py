"""The readers of CSV and TOML under Atheris, which follows the branches an input takes.

    pip install atheris
    PYTHONPATH=. python tests/fuzz/coverage_guided.py CSV -max_total_time=120

Ends at the first input that raises anything but an error of this package.
"""

from __future__ import annotations

import contextlib
import importlib
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any


def main() -> None:
    """Fuzz CSV or TOML; options after the word are those of libFuzzer."""
    try:
        atheris = importlib.import_module("atheris")
    except ImportError:
        sys.exit("needs Atheris: pip install atheris")
    with atheris.instrument_imports(include=["pbrdf_bayes.io", "tomllib"]):
        readers = _readers(sys.argv[1])
    refused = importlib.import_module("pbrdf_bayes.errors").PbrdfError
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "input"

        def once(data: bytes) -> None:
            file.write_bytes(data)
            for read in readers:
                with contextlib.suppress(refused):
                    read(file)

        atheris.Setup([sys.argv[0], *sys.argv[2:]], once)
        atheris.Fuzz()


def _readers(kind: str) -> tuple[Callable[[Path], Any], ...]:
    """Imported late, so that Atheris sees their branches."""
    from pbrdf_bayes.io.config_toml import read_config
    from pbrdf_bayes.io.document_toml import read_document
    from pbrdf_bayes.io.limits_toml import read_limits
    from pbrdf_bayes.io.scene_toml import read_scene
    from pbrdf_bayes.io.tidy_csv import read_usable_samples

    if kind == "CSV":
        return (read_usable_samples,)
    return (lambda path: read_config(path, {}), read_limits, read_scene, read_document)


if __name__ == "__main__":
    main()
