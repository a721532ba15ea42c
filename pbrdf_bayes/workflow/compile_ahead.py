"""Compile the kernels of a posterior in a process of their own, once for each version.

A kernel that has just been compiled and the same kernel loaded from the disk differ in the last
bits: fresh code calls the functions that it shares with other kernels, stored code holds copies
that were optimised with it. A run that compiles would not be repeated bit for bit by one that does
not. So what is missing is compiled elsewhere first, and every run loads.
"""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numba import __version__ as numba_version

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.inference.likelihood.correlated import correlated_log_likelihood
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.io.locks import only_one_at_a_time
from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement
from pbrdf_bayes.physics.compiled import kernel_sources

_CHOICES = {
    "iid": RunConfig(noise="iid"),
    "correlated": RunConfig(noise="correlated"),
    "filtered": RunConfig(tails="student-t"),
}
WITH_EFFECTS = "-with-effects"
"""Appended to the name of a likelihood whose model has effects."""


def likelihood_to_compile(posterior: Posterior) -> str | None:
    """Name of the posterior's likelihood if its kernels are still to be compiled."""
    law = "iid" if posterior.discrepancy is None else "correlated"
    name = law if posterior.filtered is None else "filtered"
    name += WITH_EFFECTS if posterior.scene is not None else ""
    mark = _mark(name)
    return None if mark is None or mark.exists() else name


def compile_ahead(likelihood: str) -> None:
    """Have the kernels of a likelihood on the disk, from a process of their own.

    Parameters
    ----------
    likelihood : {"iid", "correlated", "filtered"}
        With `WITH_EFFECTS` appended where the model has some.

    Notes
    -----
    Where nothing can be stored the run compiles for itself.
    """
    mark = _mark(likelihood)
    if mark is None or mark.exists():
        return
    command = [sys.executable, "-m", "pbrdf_bayes.workflow.compile_ahead", likelihood]
    with suppress(OSError), only_one_at_a_time(mark.with_suffix(".lock")):
        if not mark.exists():
            subprocess.run(command, check=False, capture_output=True)


def _mark(likelihood: str) -> Path | None:
    """A file that says that all is stored, or None where nothing can be."""
    kernel: Any = correlated_log_likelihood
    folder = Path(kernel.stats.cache_path)
    python = f"{sys.version_info.major}{sys.version_info.minor}"
    name = f"compiled_{likelihood}_py{python}_numba{numba_version}_{kernel_sources()[:16]}.mark"
    return folder / name if folder.is_dir() else None


def main(likelihood: str) -> int:
    """Call every kernel of the likelihood once, and say that it is stored."""
    measurement = simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(30.0,), theta_r_deg=[-20.0, 0.0, 20.0]
    )
    law = likelihood.removesuffix(WITH_EFFECTS)
    effects = ("lambert",) if law != likelihood else ()
    posterior = build_posterior(measurement, replace(_CHOICES[law], effects=effects))
    x = posterior.sample_prior(np.random.default_rng(1), 2)
    posterior.predict(x)
    posterior.log_prob(x)
    posterior.log_prob_gradient(x)
    mark = _mark(likelihood)
    if mark is not None:
        mark.touch()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
