"""The quality report of a run, as one self-contained HTML page."""

from pbrdf_bayes.report.page import render_report

__all__ = ["render_report"]
