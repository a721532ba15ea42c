"""Feed the readers of files from outside with damaged input, for as long as is asked.

    python tests/fuzz/run.py --seconds 120

Prints inputs tried, crashes (anything but an error of this package) and hangs (an input that took
longer than five seconds); exits 1 where there are any.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings

sys.path.insert(0, str(Path(__file__).parent))
from inputs import (
    CANDIDATES_BYTES,
    CSV_BYTES,
    DAMAGE,
    DAMAGED_DRAWS,
    DOCUMENT_BYTES,
    LIMITS_BYTES,
    PARAMS_TEXT,
    SCENE_BYTES,
    TOML_BYTES,
)

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.design.candidates import Costs
from pbrdf_bayes.errors import PbrdfError
from pbrdf_bayes.inference.parameters.table import parameter_specs
from pbrdf_bayes.io.config_toml import read_config
from pbrdf_bayes.io.document_toml import read_document
from pbrdf_bayes.io.limits_toml import read_limits
from pbrdf_bayes.io.scene_toml import read_scene
from pbrdf_bayes.io.tidy_csv import read_usable_samples, write_tidy_csv
from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement
from pbrdf_bayes.scene.prediction import predict_scene
from pbrdf_bayes.scenes import Scene
from pbrdf_bayes.workflow.candidates_csv import read_candidates
from pbrdf_bayes.workflow.fitting import fit_file
from pbrdf_bayes.workflow.parameters_json import read_parameters
from pbrdf_bayes.workflow.prediction import predict_table

_HANG_SECONDS = 5.0
_AT_ONCE = 500


def read_csv(data: bytes, folder: Path) -> None:
    """As `check` and `batch` read it."""
    (folder / "x.csv").write_bytes(data)
    read_usable_samples(folder / "x.csv")


def read_toml(data: bytes, folder: Path) -> None:
    """Down to the priors, which only a posterior looks into."""
    (folder / "x.toml").write_bytes(data)
    parameter_specs(_MEASUREMENT, read_config(folder / "x.toml", {}))


def read_params(text: str, _: Path) -> None:
    """As ``--params`` gives it."""
    read_parameters(text)


def read_limits_toml(data: bytes, folder: Path) -> None:
    """As ``--limits`` does."""
    (folder / "l.toml").write_bytes(data)
    read_limits(folder / "l.toml")


def read_document_toml(data: bytes, folder: Path) -> None:
    """As ``--document`` does."""
    (folder / "d.toml").write_bytes(data)
    read_document(folder / "d.toml")


def compute_scene(data: bytes, folder: Path) -> None:
    """As ``predict --params --scene`` does; large ones are read only."""
    (folder / "s.toml").write_bytes(data)
    scene = read_scene(folder / "s.toml")
    if scene.n_directions + len(scene.dhr_theta_i_deg) < _FEW_DIRECTIONS:
        predict_scene(GREEN_PAINT, scene)


def read_candidates_csv(data: bytes, folder: Path) -> None:
    """As ``design --candidates`` does."""
    (folder / "c.csv").write_bytes(data)
    read_candidates(folder / "c.csv", (-10.0, 0.0, 10.0), costs=Costs(), port_deg=5.0)


def use_run(damage: tuple[str, Any, str, Any], folder: Path) -> None:
    """As ``predict DIR`` does, with a damaged file."""
    name, where, how, what = damage
    run = folder / "run"
    shutil.rmtree(run, ignore_errors=True)
    shutil.copytree(finished_run(), run)
    content = (run / name).read_bytes()
    at = int(where * len(content)) if how != "value" else 0
    if how == "cut":
        content = content[:at]
    elif how == "write":
        content = content[:at] + what + content[at + len(what) :]
    else:
        table = json.loads(content)
        place: Any = table
        for step in where[:-1]:
            keys = list(place) if isinstance(place, dict) else range(len(place))
            below = place[keys[step % len(keys)]] if keys else None
            place = below if below and isinstance(below, (dict, list)) else place
        keys = list(place) if isinstance(place, dict) else range(len(place))
        place[keys[where[-1] % len(keys)]] = what
        content = json.dumps(table, default=str).encode("utf-8", "surrogatepass")
    (run / name).write_bytes(content)
    predict_table(
        folder=run, parameters=None, theta_i_deg=[30.0], theta_r_deg=[0.0, 20.0], phi_r_deg=0.0,
        dhr_theta_i_deg=[10.0], polarizations=["s"], rtol=1e-5,
    )  # fmt: skip


@cache
def finished_run() -> Path:
    """A run to be damaged, made once."""
    home = Path(tempfile.mkdtemp())
    file = home / "paint.csv"
    write_tidy_csv(simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(20.0, 50.0), theta_r_deg=list(range(-60, 61, 20)),
    ), file)  # fmt: skip
    fit_file(file, RunConfig(accuracy="draft", holdout=False), out=home / "run", seed=1)
    return home / "run"


_FEW_DIRECTIONS = 200
_MEASUREMENT = simulate_measurement(
    GREEN_PAINT, seed=1, theta_i_deg=(30.0,), theta_r_deg=[-20.0, 0.0, 20.0]
)
TARGETS = {
    "CSV": (CSV_BYTES, read_csv), "TOML": (TOML_BYTES, read_toml), "JSON": (PARAMS_TEXT, read_params),
    "limits": (LIMITS_BYTES, read_limits_toml), "document": (DOCUMENT_BYTES, read_document_toml),
    "scene": (SCENE_BYTES, compute_scene), "candidates": (CANDIDATES_BYTES, read_candidates_csv),
    "run folder": (DAMAGE, use_run),
    "draws": (DAMAGED_DRAWS, use_run),
}  # fmt: skip

BEFORE: dict[str, Callable[[], object]] = {
    "scene": lambda: predict_scene(GREEN_PAINT, Scene(dhr_theta_i_deg=(20.0,))),
    "run folder": lambda: finished_run(),
    "draws": lambda: finished_run(),
}
"""What takes its time once: kernels are compiled, a fit is made."""


def fuzz(
    name: str, folder: Path, *, seconds: float = math.inf, most: float = math.inf,
    first: int | None = None,
) -> tuple[int, list[str], int]:  # fmt: skip
    """Inputs tried, crashes, hangs; with ``first``, the seed of the first round, always the same."""
    strategy, target = TARGETS[name]
    seeds = count(random.randrange(2**32) if first is None else first)
    tried, crashes, hangs = 0, [], 0
    BEFORE.get(name, int)()
    end = time.monotonic() + seconds

    def once(value: Any) -> None:
        nonlocal tried, hangs
        if time.monotonic() > end or tried >= most:
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

    while time.monotonic() < end and tried < most:
        _round(strategy, next(seeds), once)()
    return tried, crashes, hangs


def _round(strategy: object, number: int, once: Callable[..., None]) -> Callable[[], None]:
    chosen = settings(
        max_examples=_AT_ONCE, deadline=None, database=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    found: Callable[[], None] = seed(number)(chosen(given(strategy)(once)))
    return found


def main() -> int:
    """Print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="in all")
    parser.add_argument("--only", nargs="+", choices=TARGETS, default=list(TARGETS), metavar="NAME")
    options = parser.parse_args()
    seconds = options.seconds / len(options.only)
    warnings.simplefilter("error")
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in options.only:
            tried, crashes, hangs = fuzz(name, Path(folder), seconds=seconds)
            print(f"{name}: {tried} inputs, {len(crashes)} crashes, {hangs} hangs", flush=True)
            print(*crashes[:3], sep="\n")
            bad += len(crashes) + hangs
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
