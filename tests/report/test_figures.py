"""Functions that draw into an Axes, on axes of the user as well."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pbrdf_bayes.report.arrays import (
    curves_of,
    dhr_curves_of,
    dhr_points_of,
    ensembles_of,
    places_of,
    scan_widths_of,
    scans_of,
    width_curves_of,
)
from pbrdf_bayes.report.figures import curves, incidence, posterior
from pbrdf_bayes.report.figures.axes import figure_style, new_axes, shade
from pbrdf_bayes.report.figures.of_analysis import samples_of
from pbrdf_bayes.report.figures.planes import Plane, planes_of
from pbrdf_bayes.report.figures.svg import inline_svg
from tests.report.synthetic import analysis

DEMO = analysis("demo")
SCANS, SAMPLES = scans_of(DEMO), samples_of(DEMO)


def planes() -> list[Plane]:
    return planes_of(curves_of(DEMO, measured=True), SCANS)


DRAWN: dict[str, Callable[[Axes], Axes]] = {
    "curves": lambda a: curves.plot_curves(a, planes()[1]),
    "deviations": lambda a: curves.plot_deviations(a, planes()[1].strands[0]),
    "autocorrelation": lambda a: curves.plot_autocorrelation(a, SCANS[0]),
    "dhr": lambda a: incidence.plot_dhr(a, dhr_curves_of(DEMO), dhr_points_of(DEMO)),
    "widths": lambda a: incidence.plot_widths(a, width_curves_of(DEMO), scan_widths_of(DEMO)),
    "posterior": lambda a: posterior.plot_posterior(a, SAMPLES[0]),
    "joint": lambda a: posterior.plot_joint(a, SAMPLES[0], SAMPLES[1]),
    "trace": lambda a: posterior.plot_trace(a, SAMPLES[0], ensembles_of(DEMO)),
    "places": lambda a: posterior.plot_places(a, places_of(DEMO)[0]),
}


@pytest.mark.parametrize("name", DRAWN)
def test_axes_of_the_user_are_returned_with_something_drawn(name: str) -> None:
    axes = Figure().add_subplot()
    assert DRAWN[name](axes) is axes
    assert len(axes.lines) + len(axes.collections) > 0
    FigureCanvasAgg(axes.figure).draw()  # type: ignore[arg-type]


def test_pictures_that_share_axes_hold_nothing_of_each_other() -> None:
    two = planes()[:2]
    with figure_style():
        first = [p.svg for p in curves.plane_pictures(two, name="x")]
        second = [p.svg for p in curves.plane_pictures(two[::-1], name="x")]
    without_ids = [[re.sub(r"\bx\d-", "x-", svg) for svg in drawn] for drawn in (first, second)]
    assert without_ids[0] == without_ids[1][::-1]


def test_many_draws_are_thinned_evenly() -> None:
    """A posterior of 50 MB takes no longer to draw than a small one."""
    groups = {key: node.to_dataset() for key, node in DEMO.draws.children.items()}
    groups["posterior"] = groups["posterior"].isel(draw=np.tile(np.arange(50), 100))
    large = replace(DEMO, draws=xr.DataTree.from_dict(groups))
    sample = samples_of(large)[0]
    assert sample.step == 8
    assert sample.posterior.shape == (64, 625)
    assert samples_of(DEMO)[0].step == 1


def test_equal_points_are_one_line_with_markers_at_their_places() -> None:
    with figure_style():
        (axes,) = new_axes(100.0, 100.0, (0.0, 0.0, 100.0, 100.0))
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0), xticks=(), yticks=())
        axes.plot([0.1, 0.5, 0.9], [0.2, 0.3, 0.4], "o")
        svg = inline_svg(axes.figure, name="x", label="3 points")  # type: ignore[arg-type]
    assert re.findall(r'<polyline points="([^"]*)"', svg) == ["10 80 50 70 90 60"]
    assert svg.count("<use") == svg.count("<marker") == 1


def test_an_area_keeps_its_outline_with_fewer_points() -> None:
    x = np.linspace(0.0, 1.0, 1001)
    with figure_style():
        (axes,) = new_axes(344.0, 236.0)
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        gap = np.where((x > 0.4) & (x < 0.6), np.nan, 0.8)
        shade(axes, x, 0.1 + 0.0 * x, gap, "k", 0.5)
    paths = axes.collections[0].get_paths()
    assert len(paths) == 2
    assert sum(len(np.asarray(p.vertices)) for p in paths) < 30
    ends = [p.get_extents() for p in paths]
    assert [(e.x0, e.x1) for e in ends] == [pytest.approx((0.0, 0.4)), pytest.approx((0.6, 1.0))]
    assert ends[0].y1 == pytest.approx(0.8)
