"""Ideal diffuse scatter: light that has lost its direction and its polarisation inside the paint.

    f = D / pi,    DHR = D,    null D = 0

Source: J. H. Lambert, Photometria (1760); F. E. Nicodemus et al., "Geometrical Considerations and
Nomenclature for Reflectance", NBS Monograph 160 (1977), doi:10.6028/NBS.MONO.160.
"""

from __future__ import annotations

from math import pi

from pbrdf_bayes.physics.compiled import compiled


@compiled(inline=True)
def lambert_brdf(albedo: float) -> float:
    """BRDF [sr^-1] of an albedo [1], the same for every direction and polarisation."""
    return albedo / pi
