"""Zemax tabular BSDF: incidence, azimuth and radial angle about the specular direction."""

from __future__ import annotations

from collections.abc import Iterable

from pbrdf_bayes.io.export.records import Array, Origin, SpecularGrid


def zemax_text(grid: SpecularGrid, origin: Origin, polarization: str) -> str:
    """Text of a ``.bsdf`` file, `PlaneSymmetrical`, one wavelength.

    Parameters
    ----------
    grid : SpecularGrid
    origin : Origin
    polarization : {"s", "p", "u"}
        Named in a comment: the format has no place for it.

    Returns
    -------
    str
        No line ends in a tab: Zemax refuses it.
    """
    lines = [f"# {line}" for line in (*origin.lines(), f"incident polarization {polarization}")]
    lines += [
        "Source\tMeasured",
        "Symmetry\tPlaneSymmetrical",
        "SpectralContent\tMonochrome",
        "ScatterType\tBRDF",
        "SampleRotation\t1",
        "0",
    ]
    axes = {
        "AngleOfIncidence": grid.theta_i_deg,
        "ScatterAzimuth": grid.azimuth_deg,
        "ScatterRadial": grid.radial_deg,
    }
    for name, nodes in axes.items():
        lines += [f"{name}\t{nodes.size}", _row(nodes, ".10g")]
    lines += ["", "Monochrome", "DataBegin"]
    for values, dhr in zip(grid.value, grid.dhr, strict=True):
        lines.append(f"TIS {dhr:.6f}")
        lines += [_row(row, ".6e") for row in values]
    lines.append("DataEnd")
    return "\n".join(lines) + "\n"


def _row(values: Array | Iterable[float], form: str) -> str:
    return "\t".join(format(float(value), form) for value in values)
