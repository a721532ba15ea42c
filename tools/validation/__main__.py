"""``python -m tools.validation``."""

import sys

from tools.validation.run import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
