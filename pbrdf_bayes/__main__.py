"""``python -m pbrdf_bayes``: the same as the console script ``pbrdf-bayes``."""

from __future__ import annotations

import sys

from pbrdf_bayes.cli import main

if __name__ == "__main__":
    sys.exit(main())
