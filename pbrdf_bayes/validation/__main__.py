"""``python -m pbrdf_bayes.validation``."""

import sys

from pbrdf_bayes.validation.run import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
