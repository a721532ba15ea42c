"""``python -m pbrdf_bayes``: the same as the console script ``pbrdf-bayes``."""

from __future__ import annotations

from pbrdf_bayes.cli import run_program

if __name__ == "__main__":
    run_program()
