"""A measurement written as netCDF and read back is the same, and so is its posterior."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import pbrdf_bayes as pb
from pbrdf_bayes.io.config_toml import config_from_table, config_table
from pbrdf_bayes.io.measurement_arrays import measurement_datasets, measurement_of
from pbrdf_bayes.measurement import Measurement, Readings, measurement_from_columns, select_scans
from pbrdf_bayes.records.values import plain

WORDS = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), max_size=6)


@st.composite
def measurements(draw: st.DrawFn) -> Measurement:
    """Scans in and out of plane, repeats, labels, DHR of any kind, what was excluded and warned."""
    numbers = st.floats(1e-4, 0.5)
    scans = draw(
        st.lists(
            st.tuples(
                st.sampled_from("spu"), st.sampled_from([0.0, 20.0, 37.123456789]),
                st.sampled_from([0.0, 30.0, 180.0]), WORDS,
            ),
            max_size=3, unique=True,
        )
    )  # fmt: skip
    dhr = draw(st.lists(st.sampled_from("spu"), min_size=not scans, max_size=3))
    n_scan = 3
    n = n_scan * len(scans) + len(dhr)

    def each(of: st.SearchStrategy[float]) -> list[float]:
        return draw(st.lists(of, min_size=n, max_size=n))

    return measurement_from_columns(
        sample=draw(WORDS), wavelength_um=draw(st.floats(0.2, 20.0)),
        quantity=["brdf"] * n_scan * len(scans) + ["dhr"] * len(dhr),
        polarization=[q for q, *_ in scans for _ in range(n_scan)] + dhr,
        theta_i_deg=[i for _, i, *_ in scans for _ in range(n_scan)] + [10.0 + i for i in range(len(dhr))],
        theta_r_deg=[-7.0, 0.1, 33.3] * len(scans) + [np.nan] * len(dhr),
        phi_r_deg=[phi for *_, phi, _ in scans for _ in range(n_scan)] + [0.0] * len(dhr),
        scan=[label for *_, label in scans for _ in range(n_scan)] + [""] * len(dhr),
        value=each(numbers), sigma=each(st.just(np.nan) | st.floats(1e-6, 1e-2)),
        n_repeats=each(st.sampled_from([np.nan, 1.0, 3.0])), row=[*range(2, n + 2)],
        excluded=draw(st.dictionaries(WORDS, st.integers(1, 9), max_size=2)),
        source=draw(WORDS), sha256=draw(WORDS), warnings=tuple(draw(st.lists(WORDS, max_size=2))),
    )  # fmt: skip


@st.composite
def configs(draw: st.DrawFn) -> pb.RunConfig:
    effects = draw(st.sampled_from([(), ("lambert",), ("narrowing", "dhr_offset")]))
    priors: dict[str, Any] = {}
    if draw(st.booleans()):
        priors["n"] = {"kind": "normal", "mean": draw(st.floats(1.4, 1.7)), "sd": 0.1}
    return pb.RunConfig(
        accuracy="draft", noise=draw(st.sampled_from(["iid", "correlated"])),
        tails=draw(st.sampled_from(["normal", "student-t"])), effects=effects, priors=priors,
        discrepancy=draw(st.sampled_from(["matern-3/2", "matern-1/2"])),
        line_shape=draw(st.sampled_from(["lorentzian", "cauchy"])),
        brdf_floor=draw(st.sampled_from([0.0, 0.02])), u_brdf_cal=draw(st.sampled_from([0.0, 0.03])),
        u_dhr_cal=draw(st.floats(0.0, 0.1)),
    )  # fmt: skip


def through_bytes(measurement: Measurement) -> Measurement:
    """As it comes back out of a run folder."""
    content = bytes(
        xr.DataTree.from_dict(measurement_datasets(measurement)).to_netcdf(engine="h5netcdf")
    )
    with xr.open_datatree(content, engine="h5netcdf") as tree:
        return measurement_of(tree.load())


def assert_same(found: Measurement, wanted: Measurement) -> None:
    """Every field there is, to the last bit, of the same type."""
    for field in fields(Measurement):
        a, b = (getattr(m, field.name) for m in (found, wanted))
        if not isinstance(b, Readings):
            assert (a, type(a)) == (b, type(b)), field.name
            continue
        for column in fields(Readings):
            x, y = (getattr(r, column.name) for r in (a, b))
            assert x.dtype.kind == y.dtype.kind, (field.name, column.name)
            assert x.tolist() == y.tolist() or x.tobytes() == y.tobytes(), (field.name, column.name)


@settings(max_examples=25, deadline=None)
@given(measurements(), configs())
def test_a_posterior_is_rebuilt_to_the_last_bit(m: Measurement, config: pb.RunConfig) -> None:
    """From the readings and the choices as a run folder holds them."""
    found = through_bytes(m)
    assert_same(found, m)
    fitted = pb.build_posterior(m, config)
    stored = json.loads(json.dumps(plain(config_table(config))))
    again = pb.build_posterior(found, config_from_table(stored))
    assert again.parameter_names == fitted.parameter_names
    x = fitted.sample_prior(np.random.default_rng(1), 3)
    assert again.log_prob(x).tobytes() == fitted.log_prob(x).tobytes()


@pytest.mark.parametrize("kept", [[True, False, True, False], [False] * 4])
def test_a_part_of_a_measurement_too(kept: list[bool], small: Measurement) -> None:
    part = select_scans(small, np.array(kept), dhr=True)
    assert_same(through_bytes(part), part)
