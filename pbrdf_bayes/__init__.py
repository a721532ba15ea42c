"""Bayesian inference of the four-parameter polarised BRDF model.

Names are loaded when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pbrdf_bayes.analysis import Analysis, load_analysis
    from pbrdf_bayes.batch.run import fit_batch
    from pbrdf_bayes.config import RunConfig
    from pbrdf_bayes.conform.assessment import assess_conformity
    from pbrdf_bayes.design.candidates import Candidate, Costs
    from pbrdf_bayes.errors import (
        ClusterError,
        ConfigError,
        ConvergenceError,
        DataError,
        DomainError,
        FitError,
        PbrdfError,
        RunFolderError,
    )
    from pbrdf_bayes.inference.posterior import Posterior, build_posterior
    from pbrdf_bayes.io.document_toml import read_document
    from pbrdf_bayes.io.limits_toml import read_limits
    from pbrdf_bayes.io.tidy_csv import import_readings, read_measurement, write_tidy_csv
    from pbrdf_bayes.measurement import Measurement
    from pbrdf_bayes.model.diffuse_directional import ddr
    from pbrdf_bayes.model.effects import Effects
    from pbrdf_bayes.model.four_parameter import (
        Parameters,
        brdf,
        dhr,
        normalisation_error,
        reciprocity_ratio,
    )
    from pbrdf_bayes.model.polarimetry import (
        angle_of_linear_polarization_deg,
        degree_of_linear_polarization,
        mueller,
        stokes,
    )
    from pbrdf_bayes.model.reciprocity import reciprocal_brdf, reciprocity_defect
    from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement
    from pbrdf_bayes.readings.checks import check_measurement
    from pbrdf_bayes.report.page import render_report
    from pbrdf_bayes.scene.prediction import predict_scene
    from pbrdf_bayes.scenes import Scene
    from pbrdf_bayes.workflow.exporting import Exported, export_brdf
    from pbrdf_bayes.workflow.fitting import fit
    from pbrdf_bayes.workflow.next_measurement import design_next
    from pbrdf_bayes.workflow.spectral_scene import predict_spectral_scene

__version__ = "0.1.0"

_HOME = {
    "Analysis": "analysis",
    "Candidate": "design.candidates",
    "ClusterError": "errors",
    "ConfigError": "errors",
    "ConvergenceError": "errors",
    "Costs": "design.candidates",
    "DataError": "errors",
    "DomainError": "errors",
    "Effects": "model.effects",
    "Exported": "workflow.exporting",
    "FitError": "errors",
    "GREEN_PAINT": "model.simulate",
    "Measurement": "measurement",
    "Parameters": "model.four_parameter",
    "PbrdfError": "errors",
    "Posterior": "inference.posterior",
    "RunConfig": "config",
    "RunFolderError": "errors",
    "Scene": "scenes",
    "angle_of_linear_polarization_deg": "model.polarimetry",
    "assess_conformity": "conform.assessment",
    "brdf": "model.four_parameter",
    "build_posterior": "inference.posterior",
    "check_measurement": "readings.checks",
    "ddr": "model.diffuse_directional",
    "degree_of_linear_polarization": "model.polarimetry",
    "design_next": "workflow.next_measurement",
    "dhr": "model.four_parameter",
    "export_brdf": "workflow.exporting",
    "fit": "workflow.fitting",
    "fit_batch": "batch.run",
    "load_analysis": "analysis",
    "mueller": "model.polarimetry",
    "normalisation_error": "model.four_parameter",
    "import_readings": "io.tidy_csv",
    "predict_scene": "scene.prediction",
    "predict_spectral_scene": "workflow.spectral_scene",
    "read_document": "io.document_toml",
    "read_limits": "io.limits_toml",
    "read_measurement": "io.tidy_csv",
    "reciprocal_brdf": "model.reciprocity",
    "reciprocity_defect": "model.reciprocity",
    "reciprocity_ratio": "model.four_parameter",
    "render_report": "report.page",
    "simulate_measurement": "model.simulate",
    "stokes": "model.polarimetry",
    "write_tidy_csv": "io.tidy_csv",
}

__all__ = [
    "GREEN_PAINT",
    "Analysis",
    "Candidate",
    "ClusterError",
    "ConfigError",
    "ConvergenceError",
    "Costs",
    "DataError",
    "DomainError",
    "Effects",
    "Exported",
    "FitError",
    "Measurement",
    "Parameters",
    "PbrdfError",
    "Posterior",
    "RunConfig",
    "RunFolderError",
    "Scene",
    "__version__",
    "angle_of_linear_polarization_deg",
    "assess_conformity",
    "brdf",
    "build_posterior",
    "check_measurement",
    "ddr",
    "degree_of_linear_polarization",
    "design_next",
    "dhr",
    "export_brdf",
    "fit",
    "fit_batch",
    "import_readings",
    "load_analysis",
    "mueller",
    "normalisation_error",
    "predict_scene",
    "predict_spectral_scene",
    "read_document",
    "read_limits",
    "read_measurement",
    "reciprocal_brdf",
    "reciprocity_defect",
    "reciprocity_ratio",
    "render_report",
    "simulate_measurement",
    "stokes",
    "write_tidy_csv",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        msg = f"module 'pbrdf_bayes' has no attribute {name!r}"
        raise AttributeError(msg)
    value = getattr(import_module(f"pbrdf_bayes.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
