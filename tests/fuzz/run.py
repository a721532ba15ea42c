"""Feed the readers of files from outside with damaged input, for as long as is asked.

    python tests/fuzz/run.py --seconds 120

Prints inputs tried, crashes (anything but an error of this package) and hangs (an input that took
longer than five seconds); exits 1 where there are any.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

sys.path.insert(0, str(Path(__file__).parent))
from inputs import CSV_BYTES, PARAMS_TEXT, TOML_BYTES

from pbrdf_bayes.errors import PbrdfError
from pbrdf_bayes.inference.parameters import parameter_specs
from pbrdf_bayes.io.config_toml import read_config
from pbrdf_bayes.io.tidy_csv import read_samples
from pbrdf_bayes.parameters_json import read_parameters
from pbrdf_bayes.simulate import GREEN_PAINT, simulate_measurement

_HANG_SECONDS = 5.0
_AT_ONCE = 500


def read_csv(data: bytes, folder: Path) -> None:
    """As `check` and `batch` read it."""
    (folder / "x.csv").write_bytes(data)
    read_samples(folder / "x.csv")


def read_toml(data: bytes, folder: Path) -> None:
    """Down to the priors, which only a posterior looks into."""
    (folder / "x.toml").write_bytes(data)
    parameter_specs(_MEASUREMENT, read_config(folder / "x.toml", {}))


def read_params(text: str, _: Path) -> None:
    """As ``--params`` gives it."""
    read_parameters(text)


_MEASUREMENT = simulate_measurement(
    GREEN_PAINT, seed=1, theta_i_deg=(30.0,), theta_r_deg=[-20.0, 0.0, 20.0]
)
TARGETS = {
    "CSV": (CSV_BYTES, read_csv), "TOML": (TOML_BYTES, read_toml), "JSON": (PARAMS_TEXT, read_params),
}  # fmt: skip


def fuzz(name: str, seconds: float, folder: Path) -> tuple[int, list[str], int]:
    """Inputs tried, crashes, hangs."""
    strategy, target = TARGETS[name]
    tried, crashes, hangs = 0, [], 0
    end = time.monotonic() + seconds

    def once(value: bytes | str) -> None:
        nonlocal tried, hangs
        if time.monotonic() > end:
            return
        tried += 1
        began = time.monotonic()
        try:
            target(value, folder)
        except PbrdfError:
            pass
        except Exception:  # what it looks for
            crashes.append(f"{value!r}\n{traceback.format_exc()}")
        hangs += time.monotonic() - began > _HANG_SECONDS

    while time.monotonic() < end:
        _round(strategy, once)()
    return tried, crashes, hangs


def _round(strategy: object, once: Callable[..., None]) -> Callable[[], None]:
    chosen = settings(
        max_examples=_AT_ONCE, deadline=None, database=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    found: Callable[[], None] = seed(random.randrange(2**32))(chosen(given(strategy)(once)))
    return found


def main() -> int:
    """Print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="in all")
    seconds = parser.parse_args().seconds / len(TARGETS)
    warnings.simplefilter("error")
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in TARGETS:
            tried, crashes, hangs = fuzz(name, seconds, Path(folder))
            print(f"{name}: {tried} inputs, {len(crashes)} crashes, {hangs} hangs")
            print(*crashes[:3], sep="\n")
            bad += len(crashes) + hangs
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
