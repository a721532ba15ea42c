"""What goes with a run beside its fit: verdicts on limits, a laboratory's items, the PDF."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pbrdf_bayes.analysis import Analysis, load_analysis
from pbrdf_bayes.conform.assessment import (
    assess_conformity,
    check_reference_wanted,
    check_specification,
    check_wavelength,
)
from pbrdf_bayes.document import Document, fill_in
from pbrdf_bayes.errors import RunFolderError
from pbrdf_bayes.io import run_folder
from pbrdf_bayes.io.print_pdf import find_browser, print_pdf
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.records.values import plain
from pbrdf_bayes.report.page import render_report
from pbrdf_bayes.specification import Specification


@dataclass(frozen=True)
class Paperwork:
    """What is wanted with a run; by default nothing.

    Attributes
    ----------
    specification : Specification or None
        Limits to be judged.
    reference : Path or None
        Run folder of the sample that differences are to.
    document : Document or None
        Items of the report.
    pdf : bool
        The report as PDF too.
    """

    specification: Specification | None = None
    reference: Path | None = None
    document: Document | None = None
    pdf: bool = False

    def check(self) -> None:
        """Refuse what cannot be had, before anything is computed.

        Raises
        ------
        ConfigError
            Differences without a reference or the other way round, or a PDF without a browser.
        RunFolderError
            The reference is no finished run.
        """
        if self.specification is not None:
            check_specification(self.specification)
        check_reference_wanted(self.specification, given=self.reference is not None)
        if self.reference is not None:
            run_folder.refuse_damage(self.reference, run_folder.load_summary(self.reference))
        if self.pdf:
            find_browser()

    def check_for(self, measurement: Measurement) -> None:
        """Refuse readings that could not be judged, before they are fitted.

        Raises
        ------
        ConfigError
            The reference is of another wavelength.
        """
        if self.reference is not None:
            of_reference = run_folder.load_summary(self.reference)["wavelength_um"]
            check_wavelength(measurement.wavelength_um, of_reference)

    @property
    def amends(self) -> bool:
        """The summary of a run changes by it."""
        return self.specification is not None or self.document is not None

    def is_in(self, summary: Mapping[str, Any]) -> bool:
        """A run has all of it already: judged by the same limits, and filled in the same."""
        if self.specification is not None:
            judged = (summary.get("conformity") or {}).get("specification_sha256")
            if judged != _digest(self.specification, self.reference):
                return False
        return self.document is None or summary.get("document") == fill_in(self.document, summary)


def _digest(specification: Specification, reference: Path | None) -> str:
    """Of the limits, and of the draws of the reference where there is one."""
    text = json.dumps(asdict(replace(specification, source="")), sort_keys=True)
    if reference is not None:
        text += str(run_folder.load_summary(reference).get("files"))
    return hashlib.sha256(text.encode()).hexdigest()


def complete(analysis: Analysis, wanted: Paperwork) -> Analysis:
    """The analysis with verdicts and items in its summary."""
    added: dict[str, Any] = {}
    if wanted.specification is not None:
        other = None if wanted.reference is None else load_analysis(wanted.reference)
        found = assess_conformity(analysis, wanted.specification, other)
        digest = _digest(wanted.specification, wanted.reference)
        added["conformity"] = {**found, "specification_sha256": digest}
    if wanted.document is not None:
        added["document"] = fill_in(wanted.document, analysis.summary)
    return replace(analysis, summary={**analysis.summary, **added}) if added else analysis


def amend_folder(folder: Path, wanted: Paperwork, *, brief: bool = False) -> Path:
    """Judge, fill in and make the report again from the run folder; returns its path.

    With ``brief`` the report has one figure alone, and nothing is written where nothing changes.

    Raises
    ------
    ConfigError, RunFolderError
    """
    wanted.check()
    found = load_analysis(folder)
    analysis = complete(found, wanted)
    if brief and plain(analysis.summary) == found.summary:
        return folder / run_folder.REPORT
    return store(folder, analysis, pdf=wanted.pdf, brief=brief)


def store(folder: Path, analysis: Analysis, *, pdf: bool = False, brief: bool = False) -> Path:
    """Replace summary and report of a finished run, and print it; returns the last file written.

    Raises
    ------
    RunFolderError
    """
    report = render_report(analysis, brief=brief)
    with run_folder.locked(folder):
        run_folder.amend_run(folder, analysis.summary, report=report)
        return write_pdf(folder, report) if pdf else folder / run_folder.REPORT


def write_pdf(folder: Path, report: str) -> Path:
    """Print a report into its folder; only with the lock in hand.

    Raises
    ------
    RunFolderError
        The browser failed; the run is complete without it.
    """
    try:
        content = print_pdf(report)
    except RunFolderError as error:
        msg = f"{error}. The run is complete; try again with pbrdf-bayes report {folder} --pdf"
        raise RunFolderError(msg) from None
    run_folder.write_bytes(folder / run_folder.PDF, content)
    return folder / run_folder.PDF
