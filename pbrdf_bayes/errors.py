"""The closed list of errors this package raises on purpose.

Every message says what is wrong, where (file, row, name), the value seen, the allowed range and
the remedy. ``exit_code`` is what the command line returns for it.
"""

from __future__ import annotations


class PbrdfError(Exception):
    """Base of every error raised on purpose; catch this to catch them all."""

    exit_code = 2


class DataError(PbrdfError, ValueError):
    """A measurement file or array is not usable as it stands."""


class ConfigError(PbrdfError, ValueError):
    """A setting, a configuration file or a command-line value is not usable."""


class DomainError(PbrdfError, ValueError):
    """A model parameter or a direction lies outside the domain the model is computed on."""


class RunFolderError(PbrdfError, OSError):
    """A run folder is locked, exists already, is incomplete or does not match."""


class FitError(PbrdfError, RuntimeError):
    """No usable optimum or posterior could be computed."""

    exit_code = 3


class ConvergenceError(FitError):
    """A sampler or an iteration ran out of its budget before its thresholds were met."""


class ClusterError(PbrdfError, RuntimeError):
    """The scheduler of a batch was lost while it ran; what was done by then is kept."""

    exit_code = 3
